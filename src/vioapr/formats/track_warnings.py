"""A warning about a track: one sentence, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "time-unit", "clock", "same", "swapped", "convention", "device", "scale", "no-fit", "axes",
    "rotations", "speed", "no-vio", "few", "frozen",
    "camera",
]  # fmt: skip
"""Which check found it."""


@dataclass(frozen=True)
class TrackWarning:
    """Something that looks wrong with a track, or with two of one walk.

    Attributes:
        kind: Which check found it.
        sentence: What looks wrong.
        remedy: What to do; parameters of the library stand in backticks.
    """

    kind: Kind
    sentence: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.sentence}: {self.remedy}"
