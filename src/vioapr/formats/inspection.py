"""The inspection of a trajectory file: its format, how sure that is, and its anomalies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from vioapr.files.paths import AnyPath
from vioapr.formats.anomalies import find_anomalies, step_speeds
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.common_motion import find_common_frames
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.pair_checks import UNNAMED, PairReport, Track, check_pair
from vioapr.formats.readings import Comparison, up_of
from vioapr.formats.registry import (
    LEAST_CONFIDENCE,
    get_format,
    rank_formats,
    read_trajectory,
)
from vioapr.geometry import quaternion
from vioapr.geometry.vectors import angle_between_deg, path_length_m
from vioapr.schemas.inspection import Candidate, DeviceRotation, Inspection, Speed, Up
from vioapr.trajectory import Trajectory

_LEVEL_DEG, _LEVEL_SPREAD_DEG = 25.0, 30.0
_LEAST_DEVICE_DEG, _DEVICE_SIGMAS = 2.0, 4.0


def inspect_file(
    path: AnyPath,
    format_name: str | None = None,
    options: ReadOptions | None = None,
    against: Trajectory | None = None,
    against_path: AnyPath | None = None,
) -> Inspection:
    """Read a file, whatever format it most likely has, and look for anomalies.

    Args:
        path: A trajectory file, or a folder of a format that is one.
        format_name: Its format, if known.
        options: Rate and sequence.
        against: Another track of the same walk, whose convention is known.
        against_path: Its file, for messages.

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It is malformed in more than single rows.
        ParameterError: There is no format of that name, or the options do not fit.
        AssociationError: It has too few frames in common with the other track.
    """
    path = Path(path)
    notes = ReadingNotes()
    options = replace(options or ReadOptions(), notes=notes)
    ranked = rank_formats(path) if format_name is None else [(get_format(format_name), 1.0)]
    # The ranking is not made a second time; a file that is of no format raises here.
    best = ranked[0][0].name if ranked else None
    trajectory = read_trajectory(path, best, options)
    report = PairReport(())
    if against is not None:
        report = compare_with(trajectory, against, path, against_path)
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
        up=find_up(trajectory, ranked[0][0].up) if trajectory.source == "cam" else None,
        warnings=(
            *warn_of_format(ranked),
            *notes.warnings,
            *find_anomalies(trajectory, with_guesses=report.comparison is None),
            *(f"{warning.kind}: {warning}" for warning in report.warnings),
        ),
        fits=() if report.comparison is None else report.comparison.fits,
        device=_describe_device(report.comparison),
        notes=tuple(notes.remarks),
    )


def find_up(trajectory: Trajectory, defined: str | None = None) -> Up | None:
    """Find the axis of the target frame that is up.

    Args:
        trajectory: Of a camera.
        defined: The axis that is up by the format's definition, e.g. "+y".

    Returns:
        The axis: by definition, or else the one that a camera held level has up; None where the
        camera was not held so, as one that looks down or is turned about. No world has x up.
    """
    up, spread_deg, is_portrait = up_of(trajectory.quat_xyzw)
    axis = int(np.argmax(np.abs(up)))
    name = defined or ("+" if up[axis] > 0 else "-") + "xyz"[axis]
    direction = (1.0 if name[0] == "+" else -1.0) * np.eye(3)["xyz".index(name[1])]
    off_axis_deg = float(angle_between_deg(up, direction))
    is_level = off_axis_deg <= _LEVEL_DEG and spread_deg <= _LEVEL_SPREAD_DEG
    if defined is None and (not is_level or name[1] == "x"):
        return None
    return Up(
        axis=name,
        by="camera" if defined is None else "definition",
        off_axis_deg=off_axis_deg,
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
    names = ", ".join(f"{f.name} ({c:.0%})" for f, c in others)
    may_be = f"; it may be {names}" if names else ""
    guess = f"only {confidence:.0%} sure of {best.name}{may_be}"
    return [f"format: {guess}: the columns alone do not tell: choose with `format_name`"]


def compare_with(
    trajectory: Trajectory, against: Trajectory, path: Path, against_path: AnyPath | None = None
) -> PairReport:
    """Check a track against another of the same walk, whose convention is known.

    Raises:
        AssociationError: They have too few frames in common, and no offset of their clocks or
            unit of time explains it.
    """
    known = Track(str(against_path or UNNAMED), "gt", against)
    suspect = Track(str(path), "vio", trajectory)
    report = check_pair(known, suspect, is_reference_known=True)
    if report.comparison is None and not report.warnings:
        find_common_frames(trajectory, against)  # raises, and says why
    return report


def _describe_device(comparison: Comparison | None) -> DeviceRotation | None:
    if comparison is None or comparison.hand_eye is None:
        return None
    found = comparison.hand_eye
    body_from_cam = found.body_from_cam
    rotvec_deg = np.rad2deg(quaternion.to_rotvec(body_from_cam.quat_xyzw))
    angle_deg = float(np.linalg.norm(rotvec_deg))
    sigma_deg = float(np.rad2deg(found.rotation_sigma_rad))
    if angle_deg < max(_LEAST_DEVICE_DEG, _DEVICE_SIGMAS * sigma_deg):
        return None
    axis = rotvec_deg / angle_deg
    knows_arm = found.knows_arm
    return DeviceRotation(
        angle_deg=angle_deg,
        axis=(float(axis[0]), float(axis[1]), float(axis[2])),
        matrix=tuple(tuple(row) for row in quaternion.to_matrix(body_from_cam.quat_xyzw).tolist()),
        quat_xyzw=tuple(body_from_cam.quat_xyzw.tolist()),
        rotation_sigma_deg=sigma_deg,
        lever_arm_m=tuple(body_from_cam.translation_m.tolist()) if knows_arm else None,
        lever_arm_sigma_m=tuple(found.arm_sigma_m.tolist()),
    )
