"""The metadata of an ONNX file, read without ONNX: a few bytes of a file of many megabytes.

An ONNX file is a protobuf message, `ModelProto`, whose field 14 is `metadata_props`: pairs of a
key (field 1) and a value (field 2). All other fields, the graph above all, are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from vioapr.errors import FormatError, UnreadableError

_METADATA_PROPS, _KEY, _VALUE = 14, 1, 2
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_MAX_METADATA_BYTES = 16 << 20


def read_onnx_metadata(path: Path) -> dict[str, str]:
    """Read the metadata of an ONNX file.

    Raises:
        FileMissingError: It is not there.
        UnreadableError: It cannot be read.
        FormatError: It is no ONNX file, or is cut off.
    """
    found: dict[str, str] = {}
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            for number, content in _fields(file, size):
                if number == _METADATA_PROPS and content is not None:
                    pair = dict(_fields_of(content))
                    key, value = pair.get(_KEY), pair.get(_VALUE)
                    if key is not None and value is not None:
                        found[key.decode()] = value.decode()
    except OSError as error:
        raise UnreadableError.of(path, error) from None
    except ValueError:  # also of text that is no UTF-8
        raise FormatError(path, "expected an ONNX file, found something else, or a part") from None
    return found


def _fields(file: BinaryIO, end: int) -> Iterator[tuple[int, bytes | None]]:
    """The fields of the file's message: number, and content where it may be metadata."""
    while file.tell() < end:
        tag = _read_varint(file)
        number, kind = tag >> 3, tag & 7
        if kind == _VARINT:
            _read_varint(file)
            yield number, None
            continue
        lengths = {_FIXED64: 8, _FIXED32: 4}
        length = _read_varint(file) if kind == _BYTES else lengths.get(kind)
        if number == 0 or length is None or file.tell() + length > end:
            raise ValueError("no protobuf message")
        if number == _METADATA_PROPS and kind == _BYTES and length <= _MAX_METADATA_BYTES:
            yield number, file.read(length)
        else:
            file.seek(length, 1)
            yield number, None


def _fields_of(content: bytes) -> Iterator[tuple[int, bytes]]:
    """The fields of a pair, both of which are text."""
    at = 0
    while at < len(content):
        tag, at = _varint_in(content, at)
        length, at = _varint_in(content, at)
        if tag & 7 != _BYTES or at + length > len(content):
            raise ValueError("no pair of texts")
        yield tag >> 3, content[at : at + length]
        at += length


def _varint_in(content: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(content) and shift < 64:
        byte = content[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
    raise ValueError("a number is cut off")


def _read_varint(file: BinaryIO) -> int:
    value = shift = 0
    while shift < 64 and (byte := file.read(1)):
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
        shift += 7
    raise ValueError("a number is cut off")
