"""Reading and writing typed records: JSON and TOML in, checked values out.

A record is a frozen `msgspec.Struct`. Types, required members and ranges are checked by its
annotations, so there are no validators by hand; members that a later version added are passed
over. A document is a record with a file of its own: it says its format and version.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeVar, get_args

import msgspec
import numpy as np

from vioapr.errors import FormatError, VersionError


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """Typed values that cross a border together; the base class of all schemas."""


class Document(Record, frozen=True, kw_only=True):
    """A record that is a file: it begins with its format and version.

    Attributes:
        FORMAT: What the member "format" says; "" for files that do not say theirs.
        VERSION: The newest version that this program knows.
    """

    FORMAT: ClassVar[str] = ""
    VERSION: ClassVar[int] = 1


RecordType = TypeVar("RecordType", bound=Record)
DocumentType = TypeVar("DocumentType", bound=Document)


def convert(where: object, value: object, kind: type[RecordType]) -> RecordType:
    """Check plain values and make a record of them.

    Args:
        where: The file that they are from, for messages.
        value: Of dictionaries, lists, texts, numbers, booleans and None.
        kind: The record's type.

    Raises:
        FormatError: A member is missing or of another type; the message names it.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise FormatError(str(where), _in_our_words(error, value, kind)) from None


def decode(where: object, text: str | bytes, kind: type[RecordType]) -> RecordType:
    """Read a record from JSON; see `convert`.

    Raises:
        FormatError: Not JSON, or not such a record.
        VersionError: A document of a version that is not known.
    """
    value = parse_json(where, text)
    if issubclass(kind, Document):
        check_version(where, value, kind)
    return convert(where, value, kind)


def decode_toml(where: object, text: str, kind: type[DocumentType]) -> DocumentType:
    """Read a document from TOML; see `convert`.

    Raises:
        FormatError: Not TOML, or not such a document.
        VersionError: It is of a version that is not known.
    """
    try:
        value = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r" \(at line (\d+), column \d+\)$", str(error))
        problem = str(error)[: found.start()] if found else str(error)
        line = int(found[1]) if found else None
        raise FormatError(str(where), f"expected TOML: {problem}", line) from None
    check_version(where, value, kind)
    return convert(where, value, kind)


def parse_json(where: object, text: str | bytes) -> Any:
    """Read JSON of any kind.

    Raises:
        FormatError: Not JSON; says where.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(str(where), f"expected JSON: {error.msg}", error.lineno) from None
    except (ValueError, RecursionError) as error:  # numbers too long, or nested too deep
        raise FormatError(str(where), f"expected JSON that can be read: {error}") from None


def check_version(where: object, value: object, kind: type[Document]) -> None:
    """See that plain values say the format and a known version of a document.

    Raises:
        FormatError: They say another format, or none.
        VersionError: They say a version that is not known.
    """
    if not isinstance(value, Mapping):
        raise FormatError(str(where), f"expected {kind.FORMAT or 'a document'}, got no object")
    if kind.FORMAT and value.get("format") != kind.FORMAT:
        found = value.get("format")
        raise FormatError(str(where), f'expected "format": "{kind.FORMAT}", got {found!r}')
    version = value.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise FormatError(str(where), f"expected a version of at least 1, got {version!r}")
    if version > kind.VERSION:
        raise VersionError(
            str(where),
            f"expected version {kind.VERSION}, got {version}: a newer vioapr's? Update vioapr, "
            "or make the file with this version",
        )


def encode(record: Record | Sequence[Record], indent: int | None = 2) -> str:
    """Write a record, or several, as JSON; NaN becomes null, a document says what it is.

    Args:
        record: What to write.
        indent: Spaces a level, for people; None for one line.
    """
    values = to_plain(record)
    if isinstance(record, Document):
        head = {"format": record.FORMAT} if record.FORMAT else {}
        values = {**head, "version": record.VERSION, **values}
    return json.dumps(values, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def to_plain(record: object) -> Any:
    """Turn records and what is in them into dictionaries, lists, texts and finite numbers.

    NumPy's arrays become lists, NaN and infinity None.
    """
    return _finite(msgspec.to_builtins(record, enc_hook=_from_numpy))


def _from_numpy(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no plain value")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not -float("inf") < value < float("inf"):
        return None
    return value


_KINDS: dict[str, tuple[str, type]] = {
    "str": ("text", str),
    "bool": ("true or false", bool),
    "int": ("a whole number", int),
    "float": ("a number", float),
    "array": ("a list", list),
    "object": ("a table", dict),
    "null": ("nothing", type(None)),
}
"""Msgspec's names of kinds of values, with our words and Python's types."""


def _in_our_words(error: msgspec.ValidationError, value: Any, kind: Any) -> str:
    """Msgspec's message with the member in front, and the value: `name: expected text, got 3`."""
    message, _, place = str(error).partition(" - at `$")
    mismatch = re.fullmatch(r"Expected `(.+)`, got `(\w+)`", message)
    member = ""
    for step in re.findall(r"\.[^.\[]+|\[\d+\]|\[\.{3}\]", place.strip("`")):
        if step == "[...]":  # some member of a table: the first with a value of the kind found
            found = _KINDS.get(mismatch[2], ("", object))[1] if mismatch else object
            key = next((k for k, v in value.items() if type(v) is found), None)
            if key is None:
                return f"{member.removeprefix('.')}: {message[:1].lower()}{message[1:]}"
            step = f".{key}"
        member += step
        is_index = step.startswith("[")
        value = value[int(step[1:-1]) if is_index else step[1:]]
        fields = {} if is_index or not _is_record(kind) else _fields(kind)
        kind = fields[step[1:]].type if step[1:] in fields else None
    shown = repr(value)[:80]
    if mismatch:
        kinds = [_KINDS.get(name.strip(), (name, object))[0] for name in mismatch[1].split("|")]
        message = f"expected {' or '.join(kinds)}, got {shown}"
    elif message.startswith("Invalid enum value") and (choices := get_args(kind)):
        message = f"expected {' or '.join(map(repr, choices))}, got {shown}"
    elif missing := re.fullmatch(r"Object missing required field `(.+)`", message):
        message = f"expected a member {missing[1]!r}, found none"
    elif (unknown := re.search(r"unknown field `(.+)`", message)) and _is_record(kind):
        message = f"expected only {', '.join(_fields(kind))}, got {unknown[1]!r}"
    else:
        message = message[:1].lower() + message[1:]
    member = member.removeprefix(".")
    return f"{member}: {message}" if member else message


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _fields(kind: type[msgspec.Struct]) -> dict[str, msgspec.structs.FieldInfo]:
    return {field.encode_name: field for field in msgspec.structs.fields(kind)}
