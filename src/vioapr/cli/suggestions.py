"""Names that were perhaps meant, for those that are not known."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import SequenceMatcher
from pathlib import Path

_ALIKE = 0.6
"""Likeness from which a name may have been meant: one wrong letter in three."""
_MOST = 3


def similar_names(given: str, known: Iterable[str]) -> list[str]:
    """Find the known names that are most like a given one, the likeliest first.

    A name that begins with the other one counts as much as one with a letter mistyped.
    """
    plain = _plain(given)
    scores: dict[str, float] = {}
    for name in known:
        other = _plain(name)
        score = SequenceMatcher(None, plain, other).ratio()
        shorter = min(len(plain), len(other))
        if shorter >= 3 and plain[:shorter] == other[:shorter]:
            score = max(score, 0.8 + 0.2 * score)
        if score >= _ALIKE:
            scores[name] = score
    ranked = sorted(scores, key=lambda name: -scores[name])
    best = scores[ranked[0]] if ranked else 0.0
    return [name for name in ranked if scores[name] > best - 0.15][:_MOST]


def suggest(given: str, known: Iterable[str]) -> str:
    """Say which known names were perhaps meant: `; perhaps a or b`, or nothing."""
    similar = similar_names(given, known)
    return f"; perhaps {' or '.join(similar)}" if similar else ""


def suggest_choice(message: str) -> str:
    """Say which of the choices that a message lists was perhaps meant."""
    found = re.match(r"unknown \w+ '([^']+)': expected one of ([^()]+)$", message)
    return suggest(found[1], found[2].split(", ")) if found else ""


def suggest_path(path: Path) -> str:
    """Say which existing file was perhaps meant, or which folder on the way is missing."""
    parent = path.parent
    if not parent.is_dir():
        while not parent.parent.is_dir():
            parent = parent.parent
        return f"; there is no folder {parent}"
    try:
        names = [file.name for file in parent.iterdir() if not file.name.startswith(".")]
    except OSError:
        return ""
    return suggest(str(path), (str(parent / name) for name in similar_names(path.name, names)))


def _plain(name: str) -> str:
    return name.lower().lstrip("-").replace("_", "-")
