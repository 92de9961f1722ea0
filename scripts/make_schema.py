"""Emit the JSON Schema of every file that crosses a border: `python scripts/make_schema.py`.

A file `schema/NAME.schema.json` (JSON Schema 2020-12) for every document of `vioapr.schemas`, and
for every record there that no other one holds. They come from the types and docstrings alone.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import json
import pkgutil
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import vioapr.schemas
from vioapr.schemas.base import Document, Record

FOLDER = Path(__file__).parents[1] / "schema"
DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = dict[str, Any]


def all_records() -> list[type[Record]]:
    """Every record that a module of `vioapr.schemas` defines, by name."""
    for module in pkgutil.iter_modules(vioapr.schemas.__path__, "vioapr.schemas."):
        importlib.import_module(module.name)
    return sorted(set(subclasses(Record)) - {Document}, key=lambda kind: kind.__name__)


def subclasses(kind: type[Record]) -> Iterator[type[Record]]:
    """The subclasses of a record, and theirs, that `vioapr.schemas` defines."""
    for child in kind.__subclasses__():
        if child.__module__.startswith("vioapr.schemas."):
            yield child
        yield from subclasses(child)


def records_in(kind: type[Record]) -> set[type[Record]]:
    """The record itself, and those that it holds."""
    found: set[type[Record]] = set()
    left: list[Any] = [msgspec.inspect.type_info(kind)]
    while left:
        node = left.pop()
        if isinstance(node, tuple):
            left += node
        elif isinstance(node, msgspec.inspect.Type | msgspec.inspect.Field):
            if isinstance(node, msgspec.inspect.StructType):
                if node.cls in found:
                    continue
                found.add(node.cls)
            left += [getattr(node, name) for name in node.__struct_fields__]
    return found


def make_texts() -> dict[str, str]:
    """The content of every file, by its name."""
    records = all_records()
    inner = {part for kind in records for part in records_in(kind) - {kind}}
    texts = {}
    for kind in records:
        if issubclass(kind, Document) or kind not in inner:
            name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", kind.__name__).lower() + ".schema.json"
            schema = schema_of(kind, name)
            texts[name] = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    return texts


def schema_of(kind: type[Record], name: str) -> Schema:
    """The schema of a file that holds one record."""
    _, components = msgspec.json.schema_components(
        [kind], ref_template="#/$defs/{name}", schema_hook=schema_of_array
    )
    for record in records_in(kind):
        describe(components[record.__name__], record)
    root = components.pop(kind.__name__)
    if issubclass(kind, Document):
        version = {
            "description": "Of the format; readers refuse a later one than they know.",
            "type": "integer",
            "minimum": 1,
            "maximum": kind.VERSION,
        }
        head: Schema = {"format": {"const": kind.FORMAT}} if kind.FORMAT else {}
        head["version"] = version
        root["properties"] = head | root["properties"]
        root["required"] = [*head, *root.get("required", [])]
    schema = {"$schema": DIALECT, "$id": name, **root}
    return schema | ({"$defs": components} if components else {})


def schema_of_array(kind: type) -> Schema:
    """NumPy's arrays are lists in files."""
    if issubclass(kind, np.ndarray):
        return {"type": "array"}
    raise NotImplementedError(f"no schema is known for {kind}")


def describe(schema: Schema, kind: type[Record]) -> None:
    """Put the words of a record where they belong: its own, and its members'.

    Words on a member stand in the section "Attributes" of the docstring, or below the member.
    """
    docstring, _, attributes = inspect.cleandoc(kind.__doc__ or "").partition("Attributes:\n")
    schema["description"] = " ".join(docstring.split())
    words = dict(re.findall(r"(?m)^    (\w+): ((?:.*\n?)(?: {6,}.*\n?)*)", attributes))
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(definition, ast.ClassDef)
    for member, below in itertools.pairwise(definition.body):
        match member, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                words[name] = text
    for name, member in schema["properties"].items():
        if name in words:
            schema["properties"][name] = {"description": " ".join(words[name].split()), **member}


def main() -> None:
    """Write all files, and remove those of records that are no more."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    texts = make_texts()
    for path in folder.glob("*.schema.json"):
        if path.name not in texts:
            path.unlink()
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
