"""JSON files of other programs, of which only a few members matter: objects, lists and arrays.

Files of ours are records, see `vioapr.schemas.base`. Here an error names the entry of a list, as
a line is named in a table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.schemas.base import parse_json


def load_object(path: Path, text: str) -> dict[str, Any]:
    """The JSON object that a file holds.

    Raises:
        FormatError: Not JSON, or not an object.
    """
    value = parse_json(path, text)
    if not isinstance(value, dict):
        raise FormatError(path, f"expected a JSON object, got {_kind(value)}")
    return value


def get_list(path: Path, parent: dict[str, Any], key: str) -> list[Any]:
    """A member that is a list with something in it.

    Raises:
        FormatError: It is missing, something else, or empty.
    """
    value = parent.get(key)
    if not isinstance(value, list) or not value:
        found = "an empty list" if value == [] else "none" if value is None else _kind(value)
        raise FormatError(path, f'expected a list "{key}" with an entry a frame, got {found}')
    return value


def as_numbers(
    path: Path, value: object, shape: tuple[int, ...], what: str, entry: int
) -> NDArray[np.float64]:
    """Nested lists of numbers as an array.

    Args:
        path: For messages.
        value: What JSON held.
        shape: The shape that it must have.
        what: What it is, for messages.
        entry: 1-based number of the frame that it belongs to.

    Raises:
        FormatError: Something else, or numbers too large.
    """
    if not _has_shape(value, shape):
        dimensions = "x".join(str(size) for size in shape)
        raise FormatError(path, f"expected {what} as a list of {dimensions} numbers", entry)
    try:
        return np.array(value, dtype=np.float64)
    except OverflowError:
        raise FormatError(path, f"expected finite numbers in {what}", entry) from None


def _has_shape(value: object, shape: tuple[int, ...]) -> bool:
    if not shape:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return (
        isinstance(value, list)
        and len(value) == shape[0]
        and all(_has_shape(item, shape[1:]) for item in value)
    )


def _kind(value: object) -> str:
    kinds = {dict: "an object", list: "a list", str: "text", bool: "true or false"}
    return kinds.get(type(value), "a number" if isinstance(value, int | float) else "null")
