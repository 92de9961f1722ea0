"""What looks wrong with a single trajectory: frozen, gaps, jumps, scale, order, axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.formats.readings import AS_READ, INVERTED_ROTATION, QUATERNION_ORDERS
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
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

_ROTATION_READINGS = (AS_READ, INVERTED_ROTATION, *QUATERNION_ORDERS)


def find_defects(trajectory: Trajectory) -> list[str]:
    """Warnings, one line each; none for a clean track of a hand-held camera."""
    found = [_frozen(trajectory), _extent(trajectory)]
    if trajectory.is_timed and len(trajectory) > 1:
        found += [_gaps(trajectory), _speed(trajectory)]
    if trajectory.source == "cam" and len(trajectory) >= _LEAST_STEPS:
        found += _camera_axes(trajectory)
    return [warning for warning in found if warning is not None]


def step_speeds(trajectory: Trajectory) -> NDArray[np.float64]:
    """Speed between successive poses, shape (n - 1,), m/s."""
    with np.errstate(over="ignore"):  # times may differ by less than any clock can tell
        speeds = _step_lengths(trajectory) / np.diff(trajectory.timestamp_s)
    return np.minimum(speeds, np.finfo(np.float64).max / 4)


def _step_lengths(trajectory: Trajectory) -> NDArray[np.float64]:
    return np.linalg.norm(np.diff(trajectory.position_m, axis=0), axis=1)


def _frozen(trajectory: Trajectory) -> str | None:
    rows = np.column_stack([trajectory.position_m, trajectory.quat_xyzw])
    is_same = (np.diff(rows, axis=0) == 0).all(axis=1)
    if len(is_same) < 2 or is_same.sum() < 3 or is_same.mean() < _FROZEN_FRACTION:
        return None
    return (
        f"frozen: {is_same.sum()} of {len(rows)} poses ({is_same.mean():.0%}) repeat the one "
        f"before exactly, first pose {int(np.argmax(is_same)) + 2}: was tracking lost?"
    )


def _gaps(trajectory: Trajectory) -> str | None:
    steps = np.diff(trajectory.timestamp_s)
    is_gap = steps > max(_GAP_STEPS * float(np.median(steps)), _GAP_S)
    if not is_gap.any():
        return None
    row = int(np.argmax(steps))
    return (
        f"gaps: {is_gap.sum()} in time, the longest of {steps[row]:.3f} s after "
        f"{trajectory.timestamp_s[row]:.6f} s (median step {np.median(steps):.3f} s)"
    )


def _speed(trajectory: Trajectory) -> str | None:
    speeds, lengths = step_speeds(trajectory), _step_lengths(trajectory)
    duration_s = trajectory.timestamp_s[-1] - trajectory.timestamp_s[0]
    median = float(np.median(speeds))
    if median > MAX_SPEED_M_S:
        return (
            f"scale or clock: the median speed is {median:.3g} m/s, too fast for a hand-held "
            "camera: are positions in metres and times in seconds?"
        )
    if duration_s > _STILL_DURATION_S and np.quantile(speeds, 0.95) < _STILL_SPEED_M_S:
        return (
            f"scale: 95 % of the steps are slower than {np.quantile(speeds, 0.95) * 1000:.3g} "
            "mm/s: does the camera rest, or are positions not in metres?"
        )
    is_jump = (speeds > MAX_SPEED_M_S) & (lengths > _JUMP_DISTANCE_M)
    if not is_jump.any():
        return None
    row = int(np.argmax(np.where(is_jump, lengths, 0)))
    return (
        f"jumps: {is_jump.sum()} of {len(speeds)} steps are faster than {MAX_SPEED_M_S:.0f} m/s, "
        f"the longest of {lengths[row]:.2f} m after {trajectory.timestamp_s[row]:.6f} s "
        "(outliers, as of a regressor, or a tracker that relocalized)"
    )


def _extent(trajectory: Trajectory) -> str | None:
    extent_m = float(np.ptp(trajectory.position_m, axis=0).max())
    if extent_m <= _MAX_EXTENT_M:
        return None
    return f"scale: positions span {extent_m:.3g} m: are they in metres?"


def _motion_directions(trajectory: Trajectory) -> NDArray[np.float64] | None:
    """Unit directions of motion in the world, of steps long enough to have one, with NaN else.

    Shape (n - span, 3) over the shortest span of rows that moves; None if none does.
    """
    for span in (1, 2, 4, 8, 16, 32, 64):
        if len(trajectory) < span + _LEAST_STEPS:
            return None
        moves = trajectory.position_m[span:] - trajectory.position_m[:-span]
        lengths = np.linalg.norm(moves, axis=1)
        if np.median(lengths) > _LEAST_MOTION_M:
            return np.where(
                lengths > _LEAST_MOTION_M, moves.T / np.maximum(lengths, 1e-9), np.nan
            ).T
    return None


def _camera_axes(trajectory: Trajectory) -> list[str]:
    """People walk where the camera looks, or at a constant angle to it.

    So seen from the camera, the direction of motion changes little. It wanders if rotations
    are misread, and points backwards if the camera's axes are.
    """
    directions = _motion_directions(trajectory)
    if directions is None:
        return []
    steadiness = {
        reading.title: _mean_direction(reading.change(trajectory.target_from_source), directions)
        for reading in _ROTATION_READINGS
    }
    as_read = steadiness.pop(AS_READ.title)
    if as_read[2] < _BACKWARDS:
        return [
            "camera axes: maybe OpenGL's (looking along -z) read as OpenCV's: the camera moves "
            f"backwards (mean cosine of motion and view {as_read[2]:.2f})"
        ]
    now = float(np.linalg.norm(as_read))
    title, best = max(
        ((title, float(np.linalg.norm(mean))) for title, mean in steadiness.items()),
        key=lambda item: item[1],
    )
    if now > _UNSTEADY or best < _STEADY:
        return []
    return [
        f"rotations: maybe {title}: the direction of motion would be steady as seen from the "
        f"camera ({best:.2f} of 1), and is not ({now:.2f})"
    ]


def _mean_direction(world_from_cam: Rigid3, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean of unit directions of motion in the camera's frame: as long as they are steady."""
    quats = world_from_cam.quat_xyzw[: len(directions)]
    return np.nanmean(quaternion.rotate(quaternion.inverse(quats), directions), axis=0)
