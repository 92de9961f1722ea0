"""How good odometry is (paper, section 4 and Figure "errdis"): errors, gaps, drift, divergence.

Every figure is taken within one tracking world: where a tracker lost its world and began
another, each is aligned by itself, and no pair of frames spans the change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.evaluation.metrics import PoseErrors, pose_errors
from vioapr.evaluation.vio_tracks import VioTrack
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.averaging import mean_quaternion
from vioapr.geometry.relative import RelativeGap, relative_gap
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import align_umeyama
from vioapr.geometry.vectors import distance_along_m

MIN_SPREAD_M = 0.05
"""Positions that spread less across their main direction leave a rotation undetermined."""

ARM_M = 0.5
"""Length of the arms by which orientations count in an alignment."""

AXES_AGREE_DEG = 15.0
"""Orientations that disagree by more than this (median) are of differently named axes."""

DIVERGENCE_WINDOW_S = 10.0
DIVERGENCE_GAP_M = 5.0
DIVERGENCE_RATIO = 0.75
DIVERGENCE_SHARE = 0.05
"""A tracker diverges if, over this share of all 10 s spans, the distance that it says it moved
is off by more than 5 m and by more than 75 % of the true one. A wrong scale alone stays below
(ADVIO has 39 %), and so does a jump when the tracker finds its map again."""


@dataclass(frozen=True)
class VioQualityParams:
    """The spans over which a tracker is compared with ground truth, and limits.

    Attributes:
        align_s: Seconds at the beginning on which the tracker's world is aligned rigidly.
        rate_hz: RPE and ROE are between frames one period of this rate apart.
        within_m: A pair is good if its RPE is below this and
        within_deg: its ROE below this.
        stretch_m: Drift per distance is taken over stretches of this length (or half of the
            walk, where it is shorter than two).
        stretch_s: Drift per minute is taken over stretches of this duration, or half the walk.
    """

    align_s: float = 30.0
    rate_hz: float = 1.0
    within_m: float = 0.1
    within_deg: float = 1.0
    stretch_m: float = 50.0
    stretch_s: float = 60.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise ParameterError(f"{name}: expected a positive number, got {value}")


class Drift(NamedTuple):
    """Errors of relative poses over stretches, medians; NaN where none is long enough.

    The error of a stretch is that of its last pose when its first pose is set right, so it
    has in it the ground truth's own orientation error times the stretch's length.

    Attributes:
        stretch: Length of the stretches, m or s.
        stretches: Number of stretches (they overlap: one begins at every frame).
        position_m: Median position error at a stretch's end.
        orientation_deg: Median orientation error at a stretch's end.
    """

    stretch: float
    stretches: int
    position_m: float
    orientation_deg: float


@dataclass(frozen=True, eq=False)
class VioQuality:
    """The quality of one tracker on one walk.

    Attributes:
        track: The poses.
        params: Of the comparison.
        errors: APE and AOE of every frame after alignment on the first `align_s`, shape (n,).
        gaps: RPE and ROE of all pairs, shape (m,).
        pair_rows: First and second row of every pair, shape (m, 2).
        ate_m: Root mean square position error after the best rigid alignment of everything.
        scale: Ground truth metres per metre of the tracker; NaN where it hardly moved.
        path_m: Length of the true path.
        per_distance: Drift over `stretch_m`.
        per_time: Drift over `stretch_s`.
        diverges_at_s: Seconds from the first frame at which the tracker first diverges, or None.
    """

    track: VioTrack
    params: VioQualityParams
    errors: PoseErrors
    gaps: RelativeGap
    pair_rows: NDArray[np.intp]
    ate_m: float
    scale: float
    path_m: float
    per_distance: Drift
    per_time: Drift
    diverges_at_s: float | None

    @cached_property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        times = _times(self.track, self.params)
        return float(times[-1] - times[0])

    @property
    def elapsed_s(self) -> NDArray[np.float64]:
        """Seconds since the first frame, shape (n,)."""
        times = _times(self.track, self.params)
        return times - times[0]

    @property
    def share_within(self) -> float:
        """Share of the pairs below both limits, 0 to 1; NaN where there are no pairs."""
        gaps, params = self.gaps, self.params
        is_within = (gaps.distance_m < params.within_m) & (gaps.angle_deg < params.within_deg)
        return float(is_within.mean()) if len(is_within) else float("nan")


def analyze(track: VioTrack, params: VioQualityParams | None = None) -> VioQuality:
    """Compare a tracker with ground truth."""
    params = params or VioQualityParams()
    times = _times(track, params)
    gt, vio = track.gt_world_from_cam, track.vio_from_cam
    _, start, world = np.unique(track.tracking_world, return_index=True, return_inverse=True)
    is_first = times - times[start][world] <= params.align_s
    errors = pose_errors(gt, _placed(track, is_first, align_track))
    best = pose_errors(gt, _placed(track, np.ones(len(track), dtype=bool), align_positions))
    pairs = pairs_apart(times, track.tracking_world, 1 / params.rate_hz)
    gaps = relative_gap(*(poses.at(rows) for poses in (gt, vio) for rows in pairs.T))
    walked_m = distance_along_m(gt.translation_m)
    return VioQuality(
        track,
        params,
        errors,
        gaps,
        pairs,
        float(np.sqrt(np.mean(best.position_m**2))),
        estimate_scale(track),
        float(walked_m[-1]),
        _drift(track, walked_m, params.stretch_m),
        _drift(track, times, params.stretch_s),
        find_divergence(track, times),
    )


def _times(track: VioTrack, params: VioQualityParams) -> NDArray[np.float64]:
    """Timestamps; frames without a clock are taken to come at the chosen rate."""
    return track.timestamp_s / (1 if track.is_timed else params.rate_hz)


def pairs_apart(
    timestamp_s: NDArray[np.float64], world: NDArray[np.integer], period_s: float
) -> NDArray[np.intp]:
    """Every frame with the one a period later, within one tracking world.

    The partner is the frame nearest to a period later and at most a tenth of it off. All
    frames begin a pair, so that the figures do not hang on which frame comes first; of frames
    at exactly the rate, the pairs are the consecutive ones.

    Returns:
        Rows, shape (m, 2).
    """
    if len(timestamp_s) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    wanted = timestamp_s + period_s
    after = np.searchsorted(timestamp_s, wanted).clip(1, len(timestamp_s) - 1)
    is_before = wanted - timestamp_s[after - 1] <= timestamp_s[after] - wanted
    second = np.where(is_before, after - 1, after)
    first = np.arange(len(timestamp_s))
    fits = np.abs(timestamp_s[second] - wanted) <= 0.1 * period_s
    fits &= (world[first] == world[second]) & (second > first)
    return np.column_stack([first, second])[fits]


def _placed(
    track: VioTrack, is_used: NDArray[np.bool_], align: Callable[[Rigid3, Rigid3], Rigid3]
) -> Rigid3:
    """The tracker's poses in the world, every tracking world aligned on its chosen frames."""
    positions = np.empty((len(track), 3))
    quats = np.empty((len(track), 4))
    for world in np.unique(track.tracking_world):
        rows = track.tracking_world == world
        used = rows & is_used
        world_from_vio = align(track.vio_from_cam.at(used), track.gt_world_from_cam.at(used))
        placed = world_from_vio @ track.vio_from_cam.at(rows)
        positions[rows], quats[rows] = placed.translation_m, placed.quat_xyzw
    return Rigid3(positions, quats)


def align_track(vio_from_cam: Rigid3, gt_world_from_cam: Rigid3) -> Rigid3:
    """world_from_vio that fits the cameras best, each as a body with arms of `ARM_M`.

    Positions alone would not do: people walk straight for their first seconds, and a line may
    be turned about itself. The arms' ends, along the cameras' axes, tell. Where the two disagree
    on the cameras' axes (files of different conventions), only positions are used.

    Args:
        vio_from_cam: Shape (n,), n at least 1.
        gt_world_from_cam: Shape (n,).
    """
    source, target = vio_from_cam.translation_m, gt_world_from_cam.translation_m
    is_wide = min(_spread_m(source), _spread_m(target)) >= MIN_SPREAD_M
    if is_wide:
        # Does one rotation between the worlds explain most orientations?
        quats = quaternion.multiply(
            gt_world_from_cam.quat_xyzw, quaternion.inverse(vio_from_cam.quat_xyzw)
        )
        mean = mean_quaternion(quats, np.ones(len(quats)))
        if np.median(quaternion.angle_between_deg(mean, quats)) > AXES_AGREE_DEG:
            return align_umeyama(source, target).rigid
    return align_umeyama(_arms(vio_from_cam), _arms(gt_world_from_cam)).rigid


def align_positions(vio_from_cam: Rigid3, gt_world_from_cam: Rigid3) -> Rigid3:
    """world_from_vio of the least square position error, which ATE is defined by.

    Where the positions leave a rotation undetermined, it is `align_track`'s.

    Args:
        vio_from_cam: Shape (n,), n at least 1.
        gt_world_from_cam: Shape (n,).
    """
    source, target = vio_from_cam.translation_m, gt_world_from_cam.translation_m
    if min(_spread_m(source), _spread_m(target)) < MIN_SPREAD_M:
        return align_track(vio_from_cam, gt_world_from_cam)
    return align_umeyama(source, target).rigid


def _arms(target_from_cam: Rigid3) -> NDArray[np.float64]:
    """Six points around every camera, in the target frame, shape (6 n, 3)."""
    ends = ARM_M * np.concatenate([np.eye(3), -np.eye(3)])
    poses = target_from_cam.at((slice(None), None))
    return poses.apply(ends[None]).reshape(-1, 3)


def _spread_m(points: NDArray[np.float64]) -> float:
    """Standard deviation along the second main direction."""
    if len(points) < 3:
        return 0.0
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(singular[1] / np.sqrt(len(points)))


def estimate_scale(track: VioTrack) -> float:
    """Ground truth metres per metre of the tracker, over its longest tracking world.

    NaN where one of the two hardly moved.
    """
    worlds, counts = np.unique(track.tracking_world, return_counts=True)
    rows = track.tracking_world == worlds[np.argmax(counts)]
    source = track.vio_from_cam.translation_m[rows]
    target = track.gt_world_from_cam.translation_m[rows]
    if min(_spread_m(source), _spread_m(target)) < MIN_SPREAD_M:
        return float("nan")
    return float(align_umeyama(source, target, with_scale=True).scale)


def _drift(track: VioTrack, progress: NDArray[np.float64], wanted: float) -> Drift:
    """Over stretches of this progress (distance or time), or half of all where it is short."""
    total = float(progress[-1] - progress[0])
    stretch = wanted if total >= 2 * wanted else total / 2
    end = np.searchsorted(progress, progress + stretch)
    start = np.flatnonzero(end < len(progress))
    start = start[track.tracking_world[start] == track.tracking_world[end[start]]]
    if not (len(start) and stretch > 0):
        return Drift(stretch, 0, float("nan"), float("nan"))
    end = end[start]
    relative = [
        rigid.between(poses.at(start), poses.at(end))
        for poses in (track.gt_world_from_cam, track.vio_from_cam)
    ]
    errors = pose_errors(relative[0], relative[1])
    return Drift(
        stretch,
        len(start),
        float(np.median(errors.position_m)),
        float(np.median(errors.orientation_deg)),
    )


def find_divergence(track: VioTrack, timestamp_s: NDArray[np.float64]) -> float | None:
    """The first time at which a tracker that diverges does so, in seconds from the first frame.

    Args:
        track: The poses, n of them.
        timestamp_s: Shape (n,), seconds; of a track without clock, at an assumed rate.

    Returns:
        None for a tracker that does not diverge; see `DIVERGENCE_SHARE`.
    """
    first, second = pairs_apart(timestamp_s, track.tracking_world, DIVERGENCE_WINDOW_S).T
    if not len(first):
        return None
    true_m, said_m = (
        rigid.distance_m(poses.at(first), poses.at(second))
        for poses in (track.gt_world_from_cam, track.vio_from_cam)
    )
    limit_m = np.maximum(DIVERGENCE_GAP_M, DIVERGENCE_RATIO * true_m)
    is_off = np.abs(true_m - said_m) > limit_m
    if is_off.mean() < DIVERGENCE_SHARE:
        return None
    return float(timestamp_s[first[np.argmax(is_off)]] - timestamp_s[0])
