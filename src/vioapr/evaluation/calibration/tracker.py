"""How far a tracker drifts, measured against ground truth over stretches of a few metres.

The method's odometer counts turns and time as motion too, and rates are per metre of it. Medians
are taken, as ground truth and trackers both have jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.cases import Case
from vioapr.fusion.chain.columns import z_up_column
from vioapr.fusion.chain.odometer import new_odometer
from vioapr.geometry import quaternion
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.calibration import TrackerDrift

STRETCH_M = 5.0
"""Metres of the odometer over which drift is measured, or half of the way where it is short."""

LEAST_WAY_M = 4.0
"""Metres of the odometer in one tracking world below which a walk tells nothing of drift."""

_LEAST_STRETCHES = 5

_CHI2_MEDIANS = np.array([1.386, 0.455, 2.366])
"""Medians of chi-squared with the degrees of freedom of tilt, heading and position."""

_SHARES_UP_DEG = 1.0
"""Tilt between map and tracker up to which they agree in what is up."""

_LEAST_RATES = np.array([1e-9, 1e-9, 1e-7])
"""Below these a tracker drifts nowhere."""


class Stretches(NamedTuple):
    """Of one walk; n of them.

    Attributes:
        rates: What tilt, heading and position drift by in a metre, rad^2/m and m^2/m, shape (3,).
        scale: True metres per metre of the tracker, median.
        scale_spread: Its standard deviation over stretches, robust.
        tilt_deg: Between the map's up and the tracker's, median direction.
        metres: Walked truly.
    """

    rates: NDArray[np.float64]
    scale: float
    scale_spread: float
    tilt_deg: float
    metres: float


def measure_tracker(cases: Sequence[Case]) -> TrackerDrift | None:
    """Measure the tracker of some cases, all with the same one; None if they are too short."""
    walks = {(case.set_name, case.walk, case.vio): case for case in cases}
    measured = [m for m in map(measure_walk, walks.values()) if m is not None]
    if not measured:
        return None
    rates = np.median([m.rates for m in measured], axis=0)
    scale = float(np.median([m.scale for m in measured]))
    between = np.median([abs(m.scale - scale) for m in measured]) * 1.4826
    within = np.median([m.scale_spread for m in measured])
    tilt_deg = float(np.median([m.tilt_deg for m in measured]))
    tilt, heading, position = np.maximum(rates, _LEAST_RATES).tolist()
    return TrackerDrift(
        tilt_rad2_per_m=tilt,
        heading_rad2_per_m=heading,
        position_m2_per_m=position,
        scale=scale,
        scale_spread=float(np.hypot(between, within)),
        tilt_deg=tilt_deg,
        shares_up=tilt_deg < _SHARES_UP_DEG,
    )


def measure_walk(case: Case) -> Stretches | None:
    """Compare one walk's tracker with ground truth; None if it is too short.

    Every tracking world counts by itself: no stretch spans a loss or a jump to a new one.
    """
    inputs = case.frames.inputs
    metres, worlds = read_odometer(case)
    rows = np.flatnonzero(case.has_gt & inputs.tracking_ok)
    gt, vio = case.gt_world_from_cam.at(rows), z_up_from_y_up(inputs.vio_from_cam.at(rows))
    start, end = find_stretches(metres[rows], worlds[rows])
    if len(start) < _LEAST_STRETCHES:
        return None
    turn = quaternion.multiply(gt.quat_xyzw, quaternion.inverse(vio.quat_xyzw))
    way_m = vio.translation_m[end] - vio.translation_m[start]
    true_m = gt.translation_m[end] - gt.translation_m[start]
    length_m, true_length_m = (np.linalg.norm(v, axis=-1) for v in (way_m, true_m))
    is_far = length_m > 0.2 * STRETCH_M
    ratios = true_length_m[is_far] / length_m[is_far]
    if len(ratios) < _LEAST_STRETCHES:
        ratios = np.ones(1)
    scale = float(np.median(ratios))
    # The way is turned as the tracker lay on average: that halves the noise of ground truth.
    expected_m = (quaternion.rotate(turn[start], way_m) + quaternion.rotate(turn[end], way_m)) / 2
    wrong_m = true_m - scale * expected_m
    drifted = quaternion.multiply(turn[end], quaternion.inverse(turn[start]))
    drifted = quaternion.to_rotvec(drifted)
    squares = np.stack(
        [np.sum(drifted[:, :2] ** 2, axis=-1), drifted[:, 2] ** 2, np.sum(wrong_m**2, axis=-1)]
    )
    apart_m = metres[rows][end] - metres[rows][start]
    return Stretches(
        np.median(squares / apart_m, axis=-1) / _CHI2_MEDIANS,
        scale,
        float(np.median(np.abs(ratios - scale)) * 1.4826),
        tilt_between_deg(turn),
        float(np.linalg.norm(np.diff(gt.translation_m, axis=0), axis=-1).sum()),
    )


def read_odometer(case: Case) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The method's odometer in metres, and the number of the tracking world, shape (n,) each."""
    inputs = case.frames.inputs
    vio = z_up_column(inputs.vio_from_cam)
    odometer = new_odometer((), inputs.timestamp_s)
    readings: list[float] = []
    for index in range(len(case.frames)):
        odometer = odometer.follow(inputs.at((index, ...)), vio[index])
        readings.append(float(odometer.readings[0, 0]))
    is_lost = ~np.asarray(inputs.tracking_ok)
    is_first = np.asarray(inputs.tracking_reset) | np.concatenate([[False], is_lost[:-1]])
    return np.array(readings), np.cumsum(is_first, dtype=np.intp)


def find_stretches(
    metres: NDArray[np.float64], worlds: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last rows of all stretches of `STRETCH_M`, one beginning at every row.

    Of a walk that is shorter than two such stretches, those of half its length.
    """
    if not len(metres):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    way_m = float(metres[-1] - metres[0])
    end = np.searchsorted(metres, metres + min(STRETCH_M, way_m / 2))
    start = np.flatnonzero((end < len(metres)) & (way_m >= LEAST_WAY_M))
    end = end[start]
    is_one_world = worlds[start] == worlds[end]
    return start[is_one_world], end[is_one_world]


def tilt_between_deg(turn: NDArray[np.float64]) -> float:
    """Angle between the map's up and the tracker's, of world_from_vio's quaternions (n, 4)."""
    up = np.median(quaternion.rotate(turn, np.array([0.0, 0.0, 1.0])), axis=0)
    return float(np.degrees(np.arctan2(np.hypot(up[0], up[1]), up[2])))


def walked_m(gt_world_from_cam: Rigid3) -> float:
    """Length of the way, of poses of shape (n,)."""
    steps = np.diff(gt_world_from_cam.translation_m, axis=0)
    return float(np.linalg.norm(steps, axis=-1).sum())
