"""The inspection of a trajectory file: its format, how sure that is, and its anomalies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from vioapr.formats.anomalies import find_anomalies, step_speeds
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.readings import AS_READ, find_better_reading, fit_readings, up_of
from vioapr.formats.registry import (
    LEAST_CONFIDENCE,
    get_format,
    rank_formats,
    read_trajectory,
)
from vioapr.geometry.vectors import angle_between_deg, path_length_m
from vioapr.schemas.inspection import Candidate, Fit, Inspection, Speed, Up
from vioapr.trajectory import Trajectory

_NO_FIT_DEG = 15.0


def inspect_file(
    path: Path,
    format_name: str | None = None,
    options: ReadOptions | None = None,
    against: Trajectory | None = None,
) -> Inspection:
    """Read a file, whatever format it most likely has, and look for anomalies.

    Args:
        path: A trajectory file, or a folder of a format that is one.
        format_name: Its format, if known.
        options: Rate and sequence.
        against: Another track of the same walk, whose convention is known.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is malformed in more than single rows.
        ParameterError: There is no format of that name, or the options do not fit.
        AssociationError: It has too few frames in common with the other track.
    """
    notes = ReadingNotes()
    options = replace(options or ReadOptions(), notes=notes)
    ranked = rank_formats(path) if format_name is None else [(get_format(format_name), 1.0)]
    # The ranking is not made a second time; a file that is of no format raises here.
    best = ranked[0][0].name if ranked else None
    trajectory = read_trajectory(path, best, options)
    fits = [] if against is None else fit_readings(trajectory, against)
    times, positions = trajectory.timestamp_s, trajectory.position_m
    is_timed = trajectory.is_timed
    has_steps = is_timed and len(times) > 1
    speeds = step_speeds(trajectory) if has_steps else np.zeros(1)
    return Inspection(
        path=str(path),
        candidates=tuple(
            Candidate(name=f.name, confidence=round(confidence, 2)) for f, confidence in ranked
        ),
        convention=ranked[0][0].convention,
        poses=len(trajectory),
        frames=f"{trajectory.target}_from_{trajectory.source}",
        has_names=trajectory.names is not None,
        is_timed=is_timed,
        start_s=float(times[0]) if is_timed else None,
        duration_s=float(times[-1] - times[0]) if is_timed else None,
        rate_hz=1 / float(np.median(np.diff(times))) if has_steps else None,
        extent_m=tuple(
            (float(low), float(high))
            for low, high in zip(positions.min(axis=0), positions.max(axis=0), strict=True)
        ),
        path_length_m=path_length_m(positions),
        speed=Speed(
            median_m_s=float(np.median(speeds)),
            p95_m_s=float(np.quantile(speeds, 0.95)),
            max_m_s=float(speeds.max()),
        )
        if has_steps
        else None,
        up=find_up(trajectory) if trajectory.source == "cam" else None,
        warnings=(
            *warn_of_format(ranked),
            *notes.warnings,
            *find_anomalies(trajectory),
            *warn_of_convention(fits),
        ),
        fits=tuple(fits),
        notes=tuple(notes.remarks),
    )


def find_up(trajectory: Trajectory) -> Up:
    """Find the axis of the target frame that a hand-held camera has up; see `up_of`."""
    up, spread_deg, is_portrait = up_of(trajectory.quat_xyzw)
    axis = int(np.argmax(np.abs(up)))
    direction = np.sign(up[axis]) * np.eye(3)[axis]
    name = ("+" if up[axis] > 0 else "-") + "xyz"[axis]
    return Up(
        axis=name,
        off_axis_deg=float(angle_between_deg(up, direction)),
        spread_deg=spread_deg,
        is_portrait=is_portrait,
    )


def warn_of_format(ranked: list[tuple[Format, float]]) -> list[str]:
    """Say that a file's format is uncertain.

    Args:
        ranked: The formats that it may be, with a confidence of 0 to 1, likeliest first.

    Returns:
        A warning, or none.
    """
    (best, confidence), others = ranked[0], ranked[1:]
    if confidence >= LEAST_CONFIDENCE:
        return []
    names = ", ".join(f"{f.name} ({c:.0%})" for f, c in others) or "no other known format"
    return [
        f"format: only {confidence:.0%} sure of {best.name}; it may be {names}: "
        "the columns alone do not tell"
    ]


def warn_of_convention(fits: list[Fit]) -> list[str]:
    """Say that a file fits another track better in another reading, or in none.

    Args:
        fits: As of `fit_readings`; none if there is no other track.

    Returns:
        A warning, or none.
    """
    if not fits:
        return []
    as_read = next(fit for fit in fits if fit.title == AS_READ.title)
    better = find_better_reading(fits)
    if better is not None:
        return [
            f"convention: fits the other track better with {better.title}: relative rotations "
            f"differ by {better.rotation_deg:.1f} deg instead of {as_read.rotation_deg:.1f} deg, "
            f"directions of motion by {better.direction_deg:.0f} deg instead of "
            f"{as_read.direction_deg:.0f} deg"
        ]
    if as_read.rotation_deg > _NO_FIT_DEG:
        return [
            f"convention: no reading fits the other track: relative rotations differ by "
            f"{as_read.rotation_deg:.1f} deg: another walk, clock or device frame, or noise?"
        ]
    return []
