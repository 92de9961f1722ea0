"""Counts in messages for people: "1 frame", "2 frames"."""

from __future__ import annotations


def count_of(count: int, noun: str, plural: str | None = None) -> str:
    """Say a count of things.

    Args:
        count: How many.
        noun: One of them; words may come before it: "tracked frame".
        plural: Several of them, where that is not the noun with an s.
    """
    return f"{count} {noun if count == 1 else plural or noun + 's'}"


def agree(count: int, singular: str, plural: str) -> str:
    """The form of a verb or pronoun that goes with a count: `agree(n, "has", "have")`."""
    return singular if count == 1 else plural
