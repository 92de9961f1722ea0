"""Which columns of a table hold a rotation matrix or a whole pose as a matrix, by their names.

Entries are named by row and column (`r11`, `m00`, `R(1,2)`, `T[0][3]`, `pose_2_1`), counted from 0
or 1, or by one number (`transform_0` to `transform_15`). Programs that store matrices column by
column also name them so: which it is, the values of a 4x4 tell by their row 0 0 0 1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_ENTRY = re.compile(
    r"(?P<group>(?:.*[a-z])?)[_.\- ]*[\[(]?(?P<first>\d{1,2})"
    r"(?:[\]),;:_.\- \[(]+(?P<second>\d))?[\])]?"
)
_NO_POSE_WORDS = frozenset(("cov", "covariance", "k", "intrinsic", "intrinsics", "info"))


def find_matrix_columns(names: Sequence[str]) -> tuple[int, ...] | None:
    """Find the columns of a pose's matrix among named ones.

    Args:
        names: One a column.

    Returns:
        Columns of the entries in the order of their names, row by row: 12 of a 3x4, 16 of a 4x4,
        or 9 of a rotation alone; None if no matrix is complete, or it is not clear which is meant.
    """
    groups: dict[str, dict[str, int]] = {}
    for column, name in enumerate(names):
        match = _ENTRY.fullmatch(name.strip().strip("\"'").lstrip("#% ").lower())
        if match is None:
            continue
        words = re.split(r"[_.\- ]+", match["group"])
        if not _NO_POSE_WORDS & set(words):
            digits = match["first"] + (match["second"] or "")
            groups.setdefault(match["group"], {}).setdefault(digits, column)
    found = [order for members in groups.values() if (order := _order_of(members)) is not None]
    whole = [order for order in found if len(order) > 9] or found
    return whole[0] if len(whole) == 1 else None


def _order_of(members: dict[str, int]) -> tuple[int, ...] | None:
    """The columns of entries by the digits that name them, row by row."""
    for base in (0, 1):
        for rows, columns in ((4, 4), (3, 4), (4, 3), (3, 3)):
            names = [f"{i + base}{j + base}" for i in range(rows) for j in range(columns)]
            if set(members) == set(names):
                if rows > columns:  # named by column and row
                    names = [f"{j + base}{i + base}" for i in range(columns) for j in range(rows)]
                return tuple(members[name] for name in names)
        for count in (16, 12):
            names = [str(k + base) for k in range(count)]
            padded = [f"{k + base:02d}" for k in range(count)]
            for numbers in (names, padded):
                if set(members) == set(numbers):
                    return tuple(members[number] for number in numbers)
    return None
