"""Columns that say whether the tracker tracked: their names, their words, and which rows are lost.

ARKit, ARCore, AR Foundation, ORB-SLAM3 and people's loggers write words or numbers. Words are
clear. Numbers are not: 0 is "not available" for ARKit and AR Foundation, but "tracking" for ARCore.
They are used where only one meaning makes sense, and named where they are not.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vioapr.files.tables import RowProblem, Rows, is_number
from vioapr.formats.base import ReadOptions
from vioapr.formats.left_out import NOT_TRACKED
from vioapr.plurals import count_of

_STATES = ("trackingstate", "trackingstatus", "trackstate", "trackstatus", "trackerstate")
_FLAGS = ("tracking", "istracking", "tracked", "istracked", "trackingok", "istrackingok")
_OTHER_STATES = ("state", "status", "camerastate", "slamstate", "viostate", "viostatus")
_OTHER_FLAGS = ("valid", "isvalid", "posevalid", "isposevalid", "validpose", "islocalized")
_LOSS = ("lost", "islost", "trackinglost", "istrackinglost")
_RANKED = (*_STATES, *_FLAGS, *_LOSS, *_OTHER_FLAGS, *_OTHER_STATES)

_TRACKED_WORDS = frozenset(
    (
        *("normal", "tracking", "tracked", "ok", "good", "true", "yes", "valid", "active"),
        *("extended", "extendedtracked", "running", "success", "localized", "reset"),
        *("keyframe", "optimized", "predicted"),
    )
)
_LOST_WORDS = frozenset(
    (
        *("notavailable", "unavailable", "none", "lost", "recentlylost", "trackinglost"),
        *("nottracking", "notracking", "nottracked", "untracked", "paused", "stopped", "false"),
        *("no", "invalid", "bad", "fail", "failed", "failure", "init", "initializing"),
        *("notinitialized", "uninitialized", "systemnotready", "noimagesyet", "unlocalized"),
    )
)
_NOTHING_WORDS = frozenset(("", "nan", "null", "na"))
_MAX_LISTED = 4


@dataclass(frozen=True)
class TrackingStates:
    """What a column says of the tracking.

    Attributes:
        lost: Indices of the rows that are not tracked.
        limited: How many rows have a doubtful pose.
        unclear: Why the column is not used; "" if it is.
    """

    lost: tuple[int, ...] = ()
    limited: int = 0
    unclear: str = ""


def find_tracking_column(words: Sequence[tuple[str, ...]]) -> int | None:
    """Find the column that says whether the tracker tracked; the one of the clearest name.

    Args:
        words: Of each column's name, in lower case.
    """
    ranks = [(_rank("".join(name)), i) for i, name in enumerate(words)]
    rank, column = min(ranks, default=(len(_RANKED), 0))
    return column if rank < len(_RANKED) else None


def _rank(name: str) -> int:
    if name in _RANKED:
        return _RANKED.index(name)
    return 0 if name.endswith(_STATES[:2]) else len(_RANKED)  # arkit_tracking_state


def read_tracking_states(name: str, fields: Sequence[str]) -> TrackingStates:
    """Find the rows that are not tracked.

    Args:
        name: Of the column.
        fields: Its text, one a row.
    """
    plain = re.sub(r"[^a-z]", "", name.lower())
    fields = [field.strip() for field in fields]
    if all(is_number(field) or _word_of(field) in _NOTHING_WORDS for field in fields):
        return _of_numbers(plain, fields)
    words = [_word_of(field) for field in fields]
    known = _TRACKED_WORDS | _LOST_WORDS | _NOTHING_WORDS | {"limited"}
    if unknown := [f for f, word in zip(fields, words, strict=True) if word not in known]:
        listed = [repr(field[:20]) for field in dict.fromkeys(unknown)][:_MAX_LISTED]
        return TrackingStates(unclear=f"the meaning of {', '.join(listed)} is not known")
    gone = {"true", "yes", "lost", "trackinglost"} if plain in _LOSS else _LOST_WORDS
    lost = tuple(i for i, word in enumerate(words) if word in gone)
    return TrackingStates(lost, words.count("limited"))


def _word_of(field: str) -> str:
    """A state without the name of its type and its reason: `ARTrackingState.Normal` is normal."""
    word = re.sub(r"[^a-z]", "", field.lower())
    if "limited" in word:
        return "limited"
    return re.sub(r"^.*tracking(state|status)", "", word)


def _of_numbers(name: str, fields: Sequence[str]) -> TrackingStates:
    values = [float(field) if is_number(field) else None for field in fields]
    counts = Counter(value for value in values if value is not None and value == value)
    listed = ", ".join(f"{value:g}" for value in sorted(counts)[:_MAX_LISTED])
    unclear = TrackingStates(unclear=f"it does not tell which of {listed} is tracked")
    is_state = name in _OTHER_STATES or name.endswith(_STATES)
    best = 2 if is_state and 2 in counts else 0 if name in _LOSS else 1
    if not counts or not set(counts) <= ({0, 1, 2} if is_state else {0, 1}):
        return unclear
    # Most rows of a log are tracked. Where they are not, 0 may as well be ARCore's "tracking".
    if 2 * counts[best] <= sum(counts.values()):
        return unclear
    lost = 1 if name in _LOSS else 0
    rows = tuple(i for i, value in enumerate(values) if value == lost)
    return TrackingStates(rows, counts[1] if best == 2 else 0)


def mark_lost_rows(
    path: Path, rows: Rows, name: str, fields: Sequence[str], options: ReadOptions
) -> None:
    """Note as problems the rows that a column says are not tracked, and say how it was used.

    Args:
        path: For notes.
        rows: Of the file.
        name: Of the column.
        fields: Its text, one a row.
        options: Where notes go.
    """
    states = read_tracking_states(name, fields)
    if states.unclear:
        text = f"{name} was passed over: {states.unclear}: write normal and notAvailable"
        options.note(path, text, is_warning="track" in name.lower())
        return
    for row in states.lost:
        text = f"expected a tracked pose, got {name} {fields[row].strip()[:40]!r}"
        rows.problems.setdefault(rows.lines[row], RowProblem(text, NOT_TRACKED))
    if states.limited:
        count = count_of(states.limited, "row")
        text = f"{count} of limited tracking {'are' if states.limited > 1 else 'is'} kept"
        options.note(path, text, is_warning=False)
