"""The best trajectory after a walk: method `chain` over all of it at once.

The likeliest path (MAP) under `walk_model`, by Gauss-Newton with iteratively reweighted least
squares. The scale of the predictions' errors is estimated along, from wide to narrow
(graduated), so that outliers lose their say one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vioapr.fusion.chain.estimate import SCALES
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.passes import Passes, run_passes
from vioapr.fusion.chain.walk_model import (
    TAIL_INFORMATION,
    Floats,
    Noise,
    Path,
    System,
    cost_of,
    errors_of,
    knows_up,
    level_of,
    look_at_depth,
    scales_of,
    steps_of,
    system_of,
    view_shares,
    weights_of,
)
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Status
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_map
from vioapr.work.progress import Tick, ignore

_ITERATIONS = 15
_WIDEST = 4.0
"""By which the errors' scale is wider at first; it is halved with each iteration."""

_NOISE_ITERATIONS = 7
"""Iterations in which the errors' scales and the views' sizes are found along."""

_LONGEST_TURN_RAD = 1.0
"""Most by which a frame is turned in one iteration."""

_SETTLED_RAD, _SETTLED_M = 1e-4, 1e-3
"""Largest changes after which the path has been found."""

_ANCHORS = 16
"""Moments of a tracking world at which it is tried as rigid."""

_COMMON_BIAS = 0.05
"""Share of a prediction's variance that all views of a place have in common, and that no
comparison of predictions can show."""


def smooth_walks(
    params: ChainParams, walks: Sequence[PairedFrames], tick: Tick = ignore
) -> list[FusedWalk]:
    """Find the likeliest trajectories of walks, by what came before and after each frame.

    Tracked frames of a tracking world with any prediction that counts have a pose. Frames
    without tracking have the raw prediction, if there is one.

    Args:
        params: Of the method. Drifts that are not given are those learned by the walk's end.
        walks: The walks, of any lengths.
        tick: Called once a time step of the longest walk.
    """
    passes = run_passes(params, walks, tick)
    return [_fused(params, *both) for both in zip(walks, passes, strict=True)]


def _fused(params: ChainParams, walk: PairedFrames, passes: Passes) -> FusedWalk:
    inputs, count, rows = walk.inputs, len(walk), passes.rows
    is_raw = inputs.has_apr & ~inputs.tracking_ok
    status = np.where(is_raw, int(Status.PREDICTED), int(Status.UNLOCALIZED))
    place_m, quat = np.full((count, 3), np.nan), np.full((count, 4), np.nan)
    sigma_m, sigma_rad = np.full((2, count, 3), np.nan)
    place_m[is_raw], quat[is_raw] = inputs.apr_world_from_cam.at(is_raw)
    sigma_m[is_raw], sigma_rad[is_raw] = passes.traits.noise_m, passes.traits.noise_rad
    if len(rows):
        path, variances = smooth(params, passes)
        place_m[rows] = path.place_m
        quat[rows] = quaternion.multiply(path.turn, passes.vio_from_cam.quat_xyzw)
        sigma_rad[rows], sigma_m[rows] = np.split(np.sqrt(variances), 2, axis=1)
        status[rows] = int(Status.TRACKED)
        status[rows[passes.predicted]] = int(Status.OPTIMIZED)
    sigma_m *= params.sigma_position_factor
    sigma_deg = np.degrees(sigma_rad) * params.sigma_orientation_factor
    return FusedWalk(
        walk.timestamp_s,
        Rigid3(place_m, quat),
        status,
        sigma_position_m=np.sqrt(np.mean(sigma_m**2, axis=1)),
        sigma_orientation_deg=np.sqrt(np.mean(sigma_deg**2, axis=1)),
        sigma_position_axes_m=sigma_m,
        sigma_orientation_axes_deg=sigma_deg,
    )


def smooth(params: ChainParams, passes: Passes) -> tuple[Path, Floats]:
    """The likeliest path, and how sure it is about and along the axes, rad^2 and m^2, (n, 6).

    That is the squared scale of the distribution which the causal method states too.

    It is sought from two starts. One is where the causal method saw the tracking world at each
    frame: near the truth where the tracker drifts much. The other is where each tracking world
    lay at its best supported moment: near the truth where predictions were wrong for long.
    """
    starts = (passes.world_from_vio, _best_anchors(passes))
    solutions = [_solve(params, passes, start) for start in starts]
    best = min(solutions, key=lambda solution: solution.cost)
    variances = _variances(best) / TAIL_INFORMATION
    noise2 = np.array([best.noise.turn_rad, best.noise.place_m]) ** 2
    variances = variances + _COMMON_BIAS * np.repeat(noise2, 3)
    return best.path, variances * np.repeat(SCALES[:, 0] ** 2, 3)


class _Solution(NamedTuple):
    """A path, and the system about it."""

    path: Path
    noise: Noise
    system: System
    cost: float


def _solve(params: ChainParams, passes: Passes, start: Rigid3) -> _Solution:
    path = Path(start.quat_xyzw, start.apply(passes.vio_from_cam.translation_m))
    traits, shares = passes.traits, np.ones(len(passes.predicted))
    if params.view_weights:
        shares = view_shares(passes, traits.noise_m)
    noise = Noise(traits.noise_rad, traits.noise_m, 0.0, shares)
    is_level = knows_up(params, path)
    solution = _linearized(params, passes, path, noise, is_level, _WIDEST)
    for iteration in range(1, _ITERATIONS):
        change = solution.system.matrix.solve(solution.system.right)
        largest_rad, largest_m = (np.abs(part).max() for part in np.split(change, 2, axis=1))
        width = max(_WIDEST * 0.5**iteration, 1.0)
        if width == 1 and largest_rad < _SETTLED_RAD and largest_m < _SETTLED_M:
            break
        turns_rad = np.linalg.norm(change[:, :3], axis=1, keepdims=True)
        change[:, :3] *= np.minimum(1, _LONGEST_TURN_RAD / np.maximum(turns_rad, 1e-12))
        path = path.moved(change)
        noise = solution.noise
        if iteration < _NOISE_ITERATIONS:
            noise = _noise_about(params, passes, path, solution)
        solution = _linearized(params, passes, path, noise, is_level, width)
    return solution


def _linearized(
    params: ChainParams, passes: Passes, path: Path, noise: Noise, is_level: bool, width: float
) -> _Solution:
    errors = errors_of(passes, path)
    weights = weights_of(params, passes, errors, noise, width)
    if params.look_at:
        noise = noise._replace(depth_m=look_at_depth(weights, errors))
    steps = steps_of(params, passes, path, is_level)
    level = level_of(params, passes, path, errors, weights)
    system = system_of(passes, path, errors, noise, weights, steps, level)
    return _Solution(path, noise, system, cost_of(errors, noise, steps))


def _noise_about(params: ChainParams, passes: Passes, path: Path, last: _Solution) -> Noise:
    """With new scales and views, by the uncertainty that the last path had at the predictions."""
    variances = _variances(last)[passes.predicted]
    turn_rad, place_m = scales_of(errors_of(passes, path), last.noise, variances)
    noise = last.noise._replace(turn_rad=turn_rad, place_m=place_m)
    return noise._replace(shares=view_shares(passes, place_m)) if params.view_weights else noise


def _variances(solution: _Solution) -> Floats:
    """Of the path about and along the axes, up to the factor of its weights, shape (n, 6)."""
    return np.diagonal(solution.system.matrix.inverse_diagonal(), axis1=1, axis2=2)


def _best_anchors(passes: Passes) -> Rigid3:
    """One world_from_vio for each tracking world (and from jump to jump), shape (n,)."""
    jumps = passes.since[:, 1:].any(axis=1)
    world = np.concatenate([[0], np.cumsum(~passes.is_linked | jumps)])
    best = np.arange(len(world))
    for each in np.unique(world[passes.predicted]):
        predicted = passes.predicted[world[passes.predicted] == each]
        chosen = np.linspace(0, len(predicted) - 1, min(len(predicted), _ANCHORS)).astype(int)
        candidates = predicted[np.unique(chosen)]
        support = [_support(passes, k, world[passes.predicted] == each) for k in candidates]
        best[world == each] = candidates[int(np.argmax(support))]
    return passes.world_from_vio.at(best)


def _support(passes: Passes, anchor: int, among: np.ndarray) -> float:
    """How well predictions fit a rigid tracking world."""
    placed = tree_map(lambda part: part[anchor], passes.world_from_vio)
    rigid = Path(
        np.broadcast_to(placed.quat_xyzw, passes.world_from_vio.quat_xyzw.shape),
        placed.apply(passes.vio_from_cam.translation_m),
    )
    errors = errors_of(passes, rigid)
    turn2 = np.sum(errors.turn[among] ** 2, axis=1) / passes.traits.noise_rad**2
    place2 = np.sum(errors.place_m[among] ** 2, axis=1) / passes.traits.noise_m**2
    return float(np.sum(1 / (1 + (turn2 + place2) / _WIDEST**2)))
