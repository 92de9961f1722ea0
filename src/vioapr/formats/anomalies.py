"""Anomalies of a single trajectory: frozen poses, gaps, jumps, scale, component order, axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.formats.readings import (
    AS_READ,
    INVERTED_ROTATION,
    MIRRORED_POSITIONS,
    OPENGL,
    QUATERNION_ORDERS,
    Reading,
)
from vioapr.formats.track_warnings import TrackWarning
from vioapr.geometry import quaternion
from vioapr.geometry.vectors import step_lengths_m
from vioapr.trajectory import Trajectory

MAX_SPEED_M_S = 10.0
"""No hand-held camera is faster."""

_FROZEN_FRACTION = 0.02
_GAP_STEPS, _GAP_S = 5.0, 1.0
_JUMP_DISTANCE_M = 0.5
_MAX_EXTENT_M = 1e5
_STILL_SPEED_M_S, _STILL_DURATION_S = 0.005, 10.0
_UNSTEADY, _STEADY = 0.7, 0.85
_BACKWARDS = -0.75
_LEAST_STEPS = 20
_LEAST_MOTION_M = 0.1

_ABOUT_AS_STEADY = 0.1

_STEADY_READINGS = (AS_READ, INVERTED_ROTATION, *QUATERNION_ORDERS, *MIRRORED_POSITIONS)


def find_anomalies(trajectory: Trajectory, *, with_guesses: bool = True) -> list[str]:
    """Find what a clean track of a hand-held camera does not have.

    Args:
        trajectory: One track, of whatever frames; camera axes are looked at where its source
            is "cam".
        with_guesses: Whether to guess which of several things are wrong with its rotations;
            another track of the same walk tells.

    Returns:
        Warnings, one line each; possibly none.
    """
    found: list[str] = []
    rows = np.column_stack([trajectory.position_m, trajectory.quat_xyzw])
    is_same = (np.diff(rows, axis=0) == 0).all(axis=1)
    if len(is_same) >= 2 and is_same.sum() >= 3 and is_same.mean() >= _FROZEN_FRACTION:
        found.append(
            f"frozen: {is_same.sum()} of {len(rows)} poses ({is_same.mean():.0%}) repeat the one "
            f"before exactly, first pose {int(np.argmax(is_same)) + 2}: was tracking lost?"
        )
    extent_m = float(np.ptp(trajectory.position_m, axis=0).max())
    if extent_m > _MAX_EXTENT_M:
        found.append(f"scale: positions span {extent_m:.3g} m: are they in metres?")
    if trajectory.is_timed and len(trajectory) > 1:
        steps_s = np.diff(trajectory.timestamp_s)
        is_gap = steps_s > max(_GAP_STEPS * float(np.median(steps_s)), _GAP_S)
        if is_gap.any():
            row = int(np.argmax(steps_s))
            found.append(
                f"gaps: {is_gap.sum()} in time, the longest of {steps_s[row]:.3f} s after "
                f"{trajectory.timestamp_s[row]:.6f} s (median step {np.median(steps_s):.3f} s)"
            )
        found += [*_text(check_speed(trajectory)), *find_jumps(trajectory)]
    if trajectory.source == "cam":
        motion = check_motion(trajectory)
        found += _text(
            None if motion and motion.kind == "rotations" and not with_guesses else motion
        )
    return found


def check_track(trajectory: Trajectory, *, is_smooth: bool = True) -> list[TrackWarning]:
    """Find a wrong convention or unit of a single track, where its motion tells for sure.

    Args:
        trajectory: Of a hand-held camera.
        is_smooth: Whether it is a tracker's or ground truth: a regressor's predictions jump, so
            that their speed tells nothing.
    """
    found: list[TrackWarning | None] = []
    if is_smooth and trajectory.is_timed and len(trajectory) > 1:
        found.append(check_speed(trajectory))
    if trajectory.source == "cam":
        found.append(check_motion(trajectory))
    return [warning for warning in found if warning is not None]


def _text(warning: TrackWarning | None) -> list[str]:
    return [str(warning)] if warning else []


def step_speeds(trajectory: Trajectory) -> NDArray[np.float64]:
    """Speed between successive poses, shape (n - 1,), m/s."""
    with np.errstate(over="ignore"):  # times may differ by less than any clock can tell
        speeds = step_lengths_m(trajectory.position_m) / np.diff(trajectory.timestamp_s)
    return np.minimum(speeds, np.finfo(np.float64).max / 4)


def check_speed(trajectory: Trajectory) -> TrackWarning | None:
    """Find speeds of a timed trajectory that no hand-held camera has, all along.

    Over about a second, so that a regressor's noise from frame to frame is no speed.
    """
    step_s = float(np.median(np.diff(trajectory.timestamp_s)))
    most = max(len(trajectory) // 4, 1)
    span = most if step_s * most < 1 else max(round(1 / step_s), 1)
    rows = np.arange(len(trajectory) - span)
    moved = trajectory.position_m[rows + span] - trajectory.position_m[rows]
    passed_s = trajectory.timestamp_s[rows + span] - trajectory.timestamp_s[rows]
    with np.errstate(over="ignore"):
        speeds = np.linalg.norm(moved, axis=1) / passed_s
    speeds = np.minimum(speeds, np.finfo(np.float64).max / 4)
    duration_s = trajectory.timestamp_s[-1] - trajectory.timestamp_s[0]
    median, fastest = float(np.median(speeds)), float(np.quantile(speeds, 0.95))
    if median > MAX_SPEED_M_S:
        return TrackWarning(
            "speed",
            f"scale or clock: the median speed is {median:.3g} m/s, too fast for a hand-held "
            "camera",
            "are positions in metres and times in seconds?",
        )
    if duration_s > _STILL_DURATION_S and fastest < _STILL_SPEED_M_S:
        return TrackWarning(
            "speed",
            f"scale: 95 % of the steps are slower than {fastest * 1000:.3g} mm/s",
            "does the camera rest, or are positions not in metres?",
        )
    return None


def find_jumps(trajectory: Trajectory) -> list[str]:
    """Find steps of a timed trajectory that are too fast, where most are not."""
    speeds, lengths = step_speeds(trajectory), step_lengths_m(trajectory.position_m)
    is_jump = (speeds > MAX_SPEED_M_S) & (lengths > _JUMP_DISTANCE_M)
    if not is_jump.any() or np.median(speeds) > MAX_SPEED_M_S:
        return []
    row = int(np.argmax(np.where(is_jump, lengths, 0)))
    return [
        f"jumps: {is_jump.sum()} of {len(speeds)} steps are faster than {MAX_SPEED_M_S:.0f} m/s, "
        f"the longest of {lengths[row]:.2f} m after {trajectory.timestamp_s[row]:.6f} s "
        "(outliers, as of a regressor, or a tracker that relocalized)"
    ]


def motion_directions(position_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Unit directions of motion, over the shortest span of rows that moves.

    Args:
        position_m: Of a camera in its world, shape (n, 3).

    Returns:
        Shape (n - span, 3), NaN for steps too short to have a direction; None if all are.
    """
    for span in (1, 2, 4, 8, 16, 32, 64):
        if len(position_m) < span + _LEAST_STEPS:
            return None
        moves = position_m[span:] - position_m[:-span]
        lengths = np.linalg.norm(moves, axis=1)
        if np.median(lengths) > _LEAST_MOTION_M:
            return np.where(
                lengths > _LEAST_MOTION_M, moves.T / np.maximum(lengths, 1e-9), np.nan
            ).T
    return None


def check_motion(trajectory: Trajectory) -> TrackWarning | None:
    """Find rotations, camera axes or positions that do not go with the motion.

    People walk where the camera looks, or at a constant angle to it. So seen from the camera,
    the direction of motion changes little. It wanders if rotations are misread or positions
    mirrored, and points backwards if the camera's axes are.

    Args:
        trajectory: Its source is a camera with OpenCV axes.
    """
    if len(trajectory) < _LEAST_STEPS or motion_directions(trajectory.position_m) is None:
        return None
    # Of each reading, the mean direction seen from the camera: as long as it is steady.
    means: dict[Reading, NDArray[np.float64]] = {}
    for reading in _STEADY_READINGS:
        poses = reading.change(trajectory.target_from_source)
        directions = motion_directions(poses.translation_m)
        assert directions is not None  # readings change no lengths
        quats = poses.quat_xyzw[: len(directions)]
        seen = quaternion.rotate(quaternion.inverse(quats), directions)
        means[reading] = np.nanmean(seen, axis=0)
    as_read = means.pop(AS_READ)
    if as_read[2] < _BACKWARDS:
        return TrackWarning(
            "axes",
            "camera axes: maybe OpenGL's (looking along -z) read as OpenCV's, as the camera moves "
            f"backwards (mean cosine of motion and view {as_read[2]:.2f})",
            f"if so, `vioapr convert IN OUT --reading {OPENGL.name}` turns them",
        )
    now = float(np.linalg.norm(as_read))
    # Mirrored along another axis, the camera would move backwards as steadily.
    steadiness = {r: float(np.linalg.norm(m)) for r, m in means.items() if m[2] > _BACKWARDS}
    best = max(steadiness.values(), default=0.0)
    if now > _UNSTEADY or best < _STEADY:
        return None
    likely = [r for r in steadiness if steadiness[r] > best - _ABOUT_AS_STEADY]
    likely.sort(key=lambda reading: -steadiness[reading])
    return TrackWarning(
        "rotations",
        f"rotations: maybe {', or '.join(reading.title for reading in likely)}, as the direction "
        f"of motion would be steady as seen from the camera ({best:.2f} of 1), and is not "
        f"({now:.2f})",
        "`vioapr inspect IN --against` another track of the walk tells",
    )
