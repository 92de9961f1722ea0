"""What two tracks of one walk say of its motion: the same pairs of moments, seen by both.

The motion between two frames, seen from the device, is the same in every world. So tracks are
compared by the relative rotations and displacements of pairs of frames. Pairs must be far enough
apart for the motion to stand out of a regressor's noise, and near enough for a tracker's drift
to stay small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import (
    DEFAULT_TOLERANCE_S,
    Trajectory,
    associate,
    interpolate_between_frames,
)

MIN_COMMON_FRAMES = 8
"""Fewer frames do not tell readings apart, nor which way is up."""

_SPANS_S = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
_SPANS_FRAMES = (1, 2, 5, 10, 20, 30, 50)
_CLEAR_TURN_DEG = 35.0
_LONGEST_TURN_S = 12.0
_MAX_PAIRS = 400
_LEAST_PAIRS = 6
_PARTS = 5
_MOSTLY_BETWEEN = 2.0


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of rows, m of them, of which some overlap.

    Attributes:
        earlier: Shape (m,).
        later: Shape (m,).
        independent: How many do not overlap.
    """

    earlier: NDArray[np.intp]
    later: NDArray[np.intp]
    independent: float

    @property
    def per_independent(self) -> float:
        """How many pairs hold the information of one."""
        return max(len(self.earlier) / self.independent, 1.0)

    def motion(self, target_from_source: Rigid3) -> Rigid3:
        """earlier_from_later of a track's poses, shape (m,)."""
        return rigid.between(target_from_source.at(self.earlier), target_from_source.at(self.later))


@dataclass(frozen=True, eq=False)
class CommonFrames:
    """The frames that two tracks have in common, n of them.

    Attributes:
        left: One track, n poses.
        right: The other, n poses.
        turns: Pairs between which the device turns clearly.
        moves: Pairs between which it moves as far as it does.
    """

    left: Trajectory
    right: Trajectory
    turns: Pairs
    moves: Pairs

    def swapped(self) -> CommonFrames:
        """The same, the tracks exchanged."""
        return CommonFrames(self.right, self.left, self.turns, self.moves)


def find_common_frames(
    left: Trajectory, right: Trajectory, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> CommonFrames:
    """Pair the frames of two tracks, and choose the pairs of moments to compare them by.

    Where most frames of the slower track are between those of the other, that one is interpolated.

    Raises:
        AssociationError: They have no more than `MIN_COMMON_FRAMES` frames in common.
    """
    left, right, count = _at_common_times(left, right, tolerance_s)
    if count <= MIN_COMMON_FRAMES:
        raise AssociationError(
            f"expected more than {MIN_COMMON_FRAMES} common frames to compare conventions with, "
            f"got {count}"
        )
    is_timed = left.is_timed and right.is_timed
    step_s = float(np.median(np.diff(right.timestamp_s))) if is_timed else 1.0
    spans_s = np.array(_SPANS_S if is_timed else _SPANS_FRAMES)
    most = max(len(right) // _LEAST_PAIRS, 1)
    spans = np.unique(np.clip(np.round(spans_s / step_s).astype(int), 1, most))
    candidates = [_pairs_apart(len(right), int(span)) for span in spans]
    is_short = spans * step_s <= _LONGEST_TURN_S
    turns = [pairs for pairs, short in zip(candidates, is_short, strict=True) if short]
    return CommonFrames(
        left,
        right,
        _clear_turns(turns or candidates[:1], left, right),
        max(candidates, key=lambda c: _median_move_m(c, left, right) * c.independent**0.5),
    )


def _at_common_times(
    left: Trajectory, right: Trajectory, tolerance_s: float
) -> tuple[Trajectory, Trajectory, int]:
    """Both tracks at the times of the same frames, and the number of these; if none, as given."""
    pairs = associate(left, right, tolerance_s)
    if left.is_timed and right.is_timed:
        slow, fast = (left, right) if len(left) < len(right) else (right, left)
        between, is_known = interpolate_between_frames(fast, slow.timestamp_s)
        if is_known.sum() > _MOSTLY_BETWEEN * len(pairs):
            slow = slow.at_rows(np.flatnonzero(is_known))
            poses = between.at(is_known)
            fast = replace(
                slow.with_transforms(poses), names=None, target=fast.target, source=fast.source
            )
            return (*((slow, fast) if len(left) < len(right) else (fast, slow)), len(slow))
    if not len(pairs):
        return left, right, 0
    return left.at_rows(pairs.left_rows), right.at_rows(pairs.right_rows), len(pairs)


def _pairs_apart(count: int, span: int) -> Pairs:
    starts = count - span
    earlier = np.unique(np.linspace(0, starts - 1, min(starts, _MAX_PAIRS)).astype(np.intp))
    return Pairs(earlier, earlier + span, max(count / span - 1, 1.0))


def _clear_turns(candidates: list[Pairs], left: Trajectory, right: Trajectory) -> Pairs:
    """The shortest span with clear turns, else the one with the clearest."""
    best, best_deg = candidates[0], -1.0
    for pairs in candidates:
        turn_deg = min(float(np.median(turn_angles_deg(pairs, track))) for track in (left, right))
        if turn_deg > best_deg:
            best, best_deg = pairs, turn_deg
        if turn_deg >= _CLEAR_TURN_DEG:
            break
    return best


def turn_angles_deg(pairs: Pairs, track: Trajectory) -> NDArray[np.float64]:
    """The angles of a track's relative rotations, shape (m,)."""
    quats = track.quat_xyzw
    return quaternion.angle_between_deg(quats[pairs.earlier], quats[pairs.later])


def _median_move_m(pairs: Pairs, left: Trajectory, right: Trajectory) -> float:
    """The geometric mean of both tracks' median displacements."""
    lengths = [
        np.linalg.norm(track.position_m[pairs.later] - track.position_m[pairs.earlier], axis=1)
        for track in (left, right)
    ]
    return float(np.sqrt(np.median(lengths[0]) * np.median(lengths[1])))


def estimate_scale(common: CommonFrames, left_from_right_noise: float = 1.0) -> tuple[float, float]:
    """The right track's metres per metre of the left one.

    Displacements are projected onto those of the smoother track: noise of the other then cancels,
    whereas it would lengthen every step of a path.

    Args:
        common: Both tracks read right, so that they agree on directions.
        left_from_right_noise: Above 1 where the left track is the noisier one.

    Returns:
        The scale, and the standard deviation of its logarithm; NaN where a track does not move.
    """
    left, right = (
        common.moves.motion(track.target_from_source).translation_m
        for track in (common.left, common.right)
    )
    smooth, noisy = (right, left) if left_from_right_noise > 1 else (left, right)
    squares = (smooth**2).sum(axis=1)
    moves = squares > 0.01 * np.quantile(squares, 0.9)
    if moves.sum() < MIN_COMMON_FRAMES:
        return float("nan"), float("nan")
    ratios = (smooth * noisy).sum(axis=1)[moves] / squares[moves]
    weights = np.sqrt(squares[moves])
    low, median, high = weighted_quantiles(ratios, weights, (0.25, 0.5, 0.75))
    if median <= 0:
        return float("nan"), float("nan")
    sigma = 1.25 * (high - low) / 1.35 / median / np.sqrt(max(common.moves.independent, 1.0))
    # A unit is the same all along; a tracker that loses its scale has another in every part.
    parts = [
        weighted_quantiles(r, w, (0.5,))[0]
        for r, w in zip(
            np.array_split(ratios, _PARTS), np.array_split(weights, _PARTS), strict=True
        )
        if len(r)
    ]
    off = np.abs(np.log(np.maximum(parts, 1e-3 * median) / median))
    sigma = max(sigma, 1.25 * 1.4826 * float(np.median(off)) / np.sqrt(len(parts)))
    return (1 / median if left_from_right_noise > 1 else median), float(sigma)


def weighted_quantiles(
    values: NDArray[np.float64], weights: NDArray[np.float64], shares: tuple[float, ...]
) -> list[float]:
    """The values below which some shares of the weight lie."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    return [float(np.interp(each, share, values[order])) for each in shares]
