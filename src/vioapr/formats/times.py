"""Times of files in seconds: their unit is given, fixed by the format, or found from the values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions, TimeUnit

PER_SECOND: dict[TimeUnit, int] = {"s": 1, "ms": 1000, "us": 1_000_000, "ns": 1_000_000_000}
UNIT_OF: dict[int, TimeUnit] = {1: "s", 1000: "ms", 1_000_000: "us", 1_000_000_000: "ns"}
UNIT_NAMES: dict[TimeUnit, str] = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
}

_UNIX_S = (9e8, 4.2e9)
"""Dates of 1998 to 2103, in seconds since 1970."""

_MAX_UNIX_STEP_S = 60.0
_LEAST_SURE = 1e11
"""Larger times are no seconds of any clock."""
_LARGEST_STEP: tuple[tuple[TimeUnit, float], ...] = (("s", 10.0), ("ms", 2e3), ("us", 2e6))
_LARGEST_VALUE: tuple[tuple[TimeUnit, float], ...] = (("s", 1e10), ("ms", 1e13), ("us", 1e16))

_LEAST_STEP_S, _MOST_STEP_S, _LEAST_STEPS = 1e-4, 3600.0, 2
"""No camera has frames less or more apart."""


class FoundUnit(NamedTuple):
    """A unit of times, found from their values.

    Attributes:
        unit: The unit.
        is_date: Whether the values are then dates of our days, which leaves little doubt.
    """

    unit: TimeUnit
    is_date: bool


def find_time_unit(values: NDArray[np.float64]) -> FoundUnit:
    """Find the unit of a camera's times.

    Times since 1970 tell by their size. Of other clocks the step tells: frames are 1 ms to
    10 s apart.

    Args:
        values: Shape (n,), in the file's unit.
    """
    sizes = np.abs(values[np.isfinite(values)])
    if not len(sizes):
        return FoundUnit("s", is_date=False)
    with np.errstate(all="ignore"):  # any numbers of a file, up to the largest
        size = float(np.median(sizes))
        steps = np.diff(values)
        steps = steps[np.isfinite(steps) & (steps > 0)]
        step = float(np.median(steps)) if len(steps) else None
    for unit, ticks in PER_SECOND.items():
        is_date = _UNIX_S[0] <= size / ticks <= _UNIX_S[1]
        if is_date and (step is None or step / ticks <= _MAX_UNIX_STEP_S):
            return FoundUnit(unit, is_date=True)
    value, limits = (size, _LARGEST_VALUE) if step is None else (step, _LARGEST_STEP)
    for unit, largest in limits:
        if value < largest:
            return FoundUnit(unit, is_date=False)
    return FoundUnit("ns", is_date=False)


def require_plausible_rate(path: Path, values: NDArray[np.float64], unit: TimeUnit) -> None:
    """See that times in a unit that a user, a header or a format states are those of frames.

    Args:
        path: For the message.
        values: Shape (n,), in that unit.
        unit: The unit.

    Raises:
        FormatError: Frames would be less than 0.1 ms or more than an hour apart, and are not in
            another unit.
    """
    best = find_time_unit(values).unit
    # Times that are none of frames in any unit are no matter of the unit: see `check_speed`.
    if has_plausible_rate(values, unit) or not has_plausible_rate(values, best):
        return
    raise FormatError(
        path,
        f"expected frames 0.1 ms to an hour apart, got {_step_of(values) / PER_SECOND[unit]:.3g} s "
        f"from one to the next in {UNIT_NAMES[unit]}: give `time_unit` {best}",
    )


def has_plausible_rate(values: NDArray[np.float64], unit: TimeUnit) -> bool:
    """Whether times in a unit may be those of frames; also where they are too few to tell."""
    step_s = _step_of(values) / PER_SECOND[unit]
    return not (step_s < _LEAST_STEP_S or step_s > _MOST_STEP_S)


def _step_of(values: NDArray[np.float64]) -> float:
    """The median step onward, in the values' unit; NaN where there are too few."""
    with np.errstate(all="ignore"):
        steps = np.diff(values)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.median(steps)) if len(steps) >= _LEAST_STEPS else float("nan")


def seconds_of(
    path: Path,
    ticks: NDArray[np.float64] | Sequence[float | int],
    options: ReadOptions,
    fixed: TimeUnit | None = None,
) -> NDArray[np.float64]:
    """Convert a file's times to seconds, and note their unit where it was found.

    Args:
        path: For notes.
        ticks: Shape (n,), in the file's unit. Whole numbers too large for a double are better
            given as int, and then rounded once.
        options: Their `time_unit` counts before all else.
        fixed: The unit that the format or its header says.

    Raises:
        FormatError: In the unit that is said, the times are none of frames.
    """
    values = np.asarray(ticks, dtype=np.float64)
    unit = options.time_unit or fixed
    if unit is None:
        unit, is_date = find_time_unit(values)
        if unit != "s":
            with np.errstate(all="ignore"):
                is_sure = is_date or float(np.nanmedian(np.abs(values))) > _LEAST_SURE
            name = UNIT_NAMES[unit]
            guess = f"times are taken for {name}, by their steps: if they are not, say `time_unit`"
            text = f"times are {name}" if is_sure else guess
            options.note(path, text, is_warning=not is_sure)
    else:
        require_plausible_rate(path, values, unit)
    if unit == "s":
        return values
    if isinstance(ticks, np.ndarray):
        return values / PER_SECOND[unit]
    return np.array([tick / PER_SECOND[unit] for tick in ticks], dtype=np.float64)
