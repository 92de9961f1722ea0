"""Write the pages of docs/reference that come from the code: api.md, cli.md and schemas.md.

    python scripts/make_reference.py [--check]

--check writes nothing and fails if a page is stale.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ForwardRef

ROOT = Path(__file__).parents[1]
REFERENCE, SCHEMAS = ROOT / "docs" / "reference", ROOT / "schema"


def api_page() -> str:
    """The public names: signature and docstring of each."""
    import vioapr

    parts = [
        "# Python API\n",
        "What `import vioapr` offers, from the docstrings, by `scripts/make_reference.py`.\n",
    ]
    for name in vioapr.__all__:
        if name.startswith("__"):
            continue
        parts.append(describe(name, getattr(vioapr, name)))
    return "\n".join(parts)


def describe(name: str, thing: object) -> str:
    """One name's section."""
    if isinstance(thing, Mapping):  # of the fusion methods: a repr would show addresses
        entries = [f"- `{key}`: {getattr(value, 'summary', value)}" for key, value in thing.items()]
        return f"## {name}\n\n" + "\n".join(entries) + "\n"
    if not (inspect.isclass(thing) or inspect.isroutine(thing)):
        return f"## {name}\n\n`{thing!r}`\n"
    lines = [f"## {name}\n"]
    if inspect.isclass(thing) and issubclass(thing, BaseException):
        parent = thing.__mro__[1].__name__
        return f"## {name}\n\nAn error, a kind of `{parent}`.\n\n{docstring(thing)}\n"
    lines += [f"```python\n{name}{signature(thing)}\n```\n", docstring(thing)]
    if inspect.isclass(thing):
        for key, member in sorted(public_members(thing)):
            title = f"### {name}.{key}"
            if isinstance(member, property):
                lines += [f"\n{title}\n", docstring(member)]
            else:
                lines += [f"\n{title}\n", f"```python\n{key}{signature(member)}\n```\n"]
                lines.append(docstring(member))
    return "\n".join(lines) + "\n"


def public_members(kind: type) -> Iterator[tuple[str, object]]:
    """Methods and properties of a class, without inherited and private ones."""
    for key, member in vars(kind).items():
        unwrapped = getattr(member, "__func__", member)
        if key.startswith("_") or not getattr(unwrapped, "__doc__", None):
            continue
        if isinstance(member, property) or inspect.isroutine(unwrapped):
            yield key, unwrapped


def signature(thing: object) -> str:
    """The signature on one line, or a line a parameter where it is long."""
    try:
        found = inspect.signature(thing)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return "(...)"
    pieces: list[str] = []
    for parameter in found.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in pieces:
            pieces.append("*")
        text = parameter.name
        if parameter.annotation is not parameter.empty:
            text += f": {annotation(parameter.annotation)}"
        if parameter.default is not parameter.empty:
            shown = repr(parameter.default)
            text += f" = {'...' if shown.startswith('<') else shown}"
        pieces.append(text)
    result = found.return_annotation
    end = "" if result in (found.empty, "None", None) else f" -> {annotation(result)}"
    line = f"({', '.join(pieces)}){end}"
    if len(line) <= 80:
        return line
    return "(\n" + "".join(f"    {piece},\n" for piece in pieces) + f"){end}"


def annotation(value: object) -> str:
    """A type as it is written in the source."""
    if isinstance(value, ForwardRef):
        return value.__forward_arg__
    return value if isinstance(value, str) else getattr(value, "__name__", str(value))


def docstring(thing: object) -> str:
    """A Google-style docstring as Markdown: sections become lists."""
    lines, is_section = [], False
    for line in (inspect.getdoc(thing) or "").splitlines():
        heading = re.fullmatch(r"(Args|Attributes|Returns|Raises|Yields|Example):", line)
        if heading:
            is_section = heading.group(1) != "Example"
            lines.append(f"\n**{heading.group(1)}**\n")
            continue
        if is_section and (entry := re.fullmatch(r" {4}(\*{0,2}\w+): (.*)", line)):
            lines.append(f"- `{entry.group(1)}`: {entry.group(2)}")
        elif is_section and line.startswith("    "):
            lines.append("  " + line.strip())
        else:
            is_section = is_section and not line.strip()
            lines.append(line)
    return "\n".join(lines)


def cli_page() -> str:
    """Exit codes, statuses, and every verb's help, as the command line prints it."""
    os.environ |= {"COLUMNS": "96", "NO_COLOR": "1", "TERM": "dumb"}
    from vioapr.cli.help import describe_verb
    from vioapr.cli.verbs import VERBS, describe_verbs

    parts = [
        "# Command line\n",
        "What `vioapr --help` and `vioapr VERB --help` print. Written by "
        "`scripts/make_reference.py`.\n",
        f"```\n{describe_verbs()}\n```\n",
        "## Statuses\n\nThe column `status` of `vioapr fuse` and `vioapr localize` is a name; "
        "ONNX files say the number.\n\n" + statuses_table(),
        "## Localization states\n\nThe column `localization_state`, of methods that judge "
        "themselves.\n\n" + states_table(),
    ]
    for name, verb in VERBS.items():
        parts.append(f"## vioapr {name}\n\n```\n{describe_verb(name, verb.load())}\n```\n")
    return "\n".join(parts)


def statuses_table() -> str:
    """The table of statuses, the same wherever a page has one."""
    from vioapr.fusion.types import Status

    rows = "".join(f"| {s.value} | `{s.label}` | {s.meaning} |\n" for s in Status)
    return f"| | status | where a frame's pose comes from |\n|---|---|---|\n{rows}"


def states_table() -> str:
    """The table of localization states, the same wherever a page has one."""
    from vioapr.fusion.types import LocalizationState

    rows = "".join(f"| {s.value} | `{s.label}` | {s.meaning} |\n" for s in LocalizationState)
    return f"| | localization state | what is known |\n|---|---|---|\n{rows}"


TABLES = {"statuses": statuses_table, "localization states": states_table}


def with_tables(page: Path) -> str:
    """A page of someone's, with the tables between their two marks made again."""
    text = page.read_text(encoding="utf-8")
    for name, make in TABLES.items():
        begin, end = rf"(<!-- {name}: [^\n]*-->\n)", rf"(<!-- end of {name} -->)"
        table = f"\n{make()}\n"
        text = re.sub(f"{begin}.*?{end}", rf"\g<1>{table}\g<2>", text, flags=re.S)
    return text


def schemas_page() -> str:
    """Every JSON Schema in schema/: what the file is, and its members."""
    parts = [
        "# JSON schemas\n",
        "Every JSON or TOML file that crosses a border has a schema (JSON Schema 2020-12) in",
        "`schema/`. `scripts/make_schema.py` emits them from `vioapr.schemas`, and",
        "`scripts/make_reference.py` writes this page.\n",
    ]
    for path in sorted(SCHEMAS.glob("*.schema.json")):
        schema = json.loads(path.read_text(encoding="utf-8"))
        known = schema.get("$defs", {})
        root = known.get(schema.get("$ref", "").rpartition("/")[2], schema)
        parts += [f"## {schema.get('title') or root.get('title')}\n", f"`schema/{path.name}`\n"]
        parts += [text + "\n" for text in (schema.get("description") or "",) if text]
        parts.append(members_table(root))
        for name, record in known.items():
            if record is not root and record.get("properties"):
                parts += [f"**{name}**\n", members_table(record)]
    return "\n".join(parts)


def members_table(record: dict[str, Any]) -> str:
    """A record's members: name, type, what it is."""
    required = set(record.get("required", ()))
    lines = ["| member | type | |", "|---|---|---|"]
    for name, member in record.get("properties", {}).items():
        text = " ".join(str(member.get("description", "")).split()).replace("|", "\\|")
        optional = "" if name in required else " (optional)"
        lines.append(f"| `{name}` | {type_in_words(member)}{optional} | {text} |")
    return "\n".join(lines) + "\n"


def type_in_words(member: dict[str, Any]) -> str:
    """A JSON Schema type as a few words."""
    if "$ref" in member:
        return str(member["$ref"]).rpartition("/")[2]
    if "const" in member:
        return f"`{json.dumps(member['const'])}`"
    if "enum" in member:
        return " or ".join(f"`{json.dumps(value)}`" for value in member["enum"])
    if "anyOf" in member:
        return " or ".join(type_in_words(option) for option in member["anyOf"])
    if member.get("type") == "array":
        items = member.get("items") or (member.get("prefixItems") or [{}])[0]
        return f"list of {type_in_words(items)}" if isinstance(items, dict) and items else "list"
    if isinstance(extra := member.get("additionalProperties"), dict):
        return f"object of {type_in_words(extra)}"
    return str(member.get("type", "any"))


PAGES = {"api.md": api_page, "cli.md": cli_page, "schemas.md": schemas_page}
PAGES_WITH_TABLES = ("README.md", "docs/guide/fuse.md", "docs/reference/contract.md")


def main() -> None:
    """Write the pages, or see whether they are what would be written."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    made = {REFERENCE / name: make() for name, make in PAGES.items()}
    made |= {ROOT / name: with_tables(ROOT / name) for name in PAGES_WITH_TABLES}
    stale: list[str] = []
    for path, text in made.items():
        if options.check:
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                stale.append(path.name)
        else:
            path.write_text(text, encoding="utf-8")
    if stale:
        sys.exit(f"stale: {', '.join(stale)}: run python scripts/make_reference.py")


if __name__ == "__main__":
    main()
