"""Counts in messages for people: "1 frame", "2 frames"."""

from __future__ import annotations

from typing import SupportsIndex


def count_of(count: SupportsIndex, noun: str, plural: str | None = None) -> str:
    """Say a count of things.

    Args:
        count: How many.
        noun: One of them; words may come before and after it: "frame has".
        plural: Several of them, where that is not the noun with an s: "frames have".
    """
    return f"{count} {noun if count == 1 else plural or noun + 's'}"
