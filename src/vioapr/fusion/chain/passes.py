"""What method `chain` makes of whole walks, forwards and backwards: where to smooth from.

The causal passes settle what the smoother takes for granted: which predictions count, what
their stated sigmas are worth, how far the tracker may have drifted from frame to frame, whether
its world is still the same one after a loss, and roughly where that world lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.fusion.chain.columns import z_up_column
from vioapr.fusion.chain.method import ChainState, drift_of, init, step
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.offline import stack_walks
from vioapr.fusion.pairing import PairedFrames, reverse
from vioapr.fusion.types import FrameInput, Status
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3, choose
from vioapr.geometry.tree import tree_at, tree_stack
from vioapr.work.progress import Tick

_LEAST_RUN = 15
"""Consecutive predictions that have to look like the map's place before any of them is
believed: outside the map some do by chance."""

_SAME_WORLD_M, _SAME_WORLD_DEG, _SAME_WORLD_NOISE = 1.0, 10.0, 3.0
"""A world that was lost is the same one if what is known before and after differs by less than
this, or less than this multiple of the noise of predictions."""


_LEARNED_FACTOR = 3.0
"""From the drift that the causal method does best with, in its short window, to the one that
the smoother does: by the development bench, docs/design/chain.md."""


_LEVER_M2 = 3000.0
"""Who drifts in position drifts in orientation too: by at least as much as would make up for
it at some 55 m. Predictions alone hardly show such little turns."""


class Traits(NamedTuple):
    """Of a walk, as known at its end, one number each.

    Attributes:
        tilt_drift: By which the tracker drifts in a metre, rad^2.
        heading_drift: The same of its heading, rad^2.
        position_drift: The same of its position per axis, m^2.
        noise_rad: Typical error of a prediction, about each axis.
        noise_m: Along each axis.
    """

    tilt_drift: float
    heading_drift: float
    position_drift: float
    noise_rad: float
    noise_m: float


class Passes(NamedTuple):
    """A walk's tracked frames, n of them, in order of time, and k predictions that count.

    Attributes:
        rows: The tracked frames among all, shape (n,).
        vio_from_cam: In a z-up tracking world, shape (n,).
        since: What the odometer has read from each frame to the next: metres, and jumps in
            rad^2 and m^2, shape (n - 1, 3).
        is_linked: Whether both are of one tracking world, shape (n - 1,).
        world_from_vio: As known at each frame, from a z-up tracking world, shape (n,).
        predicted: Which tracked frames have the predictions, shape (k,).
        world_from_cam: The predictions, shape (k,).
        stated: Their variances over the usual ones, orientation and position, shape (k, 2).
        traits: Of tracker and regressor.
    """

    rows: NDArray[np.intp]
    vio_from_cam: Rigid3
    since: NDArray[np.float64]
    is_linked: NDArray[np.bool_]
    world_from_vio: Rigid3
    predicted: NDArray[np.intp]
    world_from_cam: Rigid3
    stated: NDArray[np.float64]
    traits: Traits


class _Records(NamedTuple):
    """Of every frame and walk: see `ChainState`; the leading axes are time and walk."""

    world_from_cam: Rigid3
    is_used: NDArray[np.bool_]
    is_here: NDArray[np.bool_]
    readings: NDArray[np.float64]
    stated: NDArray[np.float64]


def run_passes(params: ChainParams, walks: Sequence[PairedFrames], tick: Tick) -> list[Passes]:
    """Step through walks forwards and backwards, in one batch; ticks once a time step."""
    count = len(walks)
    both = stack_walks([*walks, *map(reverse, walks)])
    records, end = _record(replace(params, not_here=False), both, tick)
    traits = _traits(params, end)
    passes: list[Passes] = []
    for k, walk in enumerate(walks):
        forward = tree_at(records, (slice(len(walk)), k))
        backward = tree_at(records, (slice(len(walk) - 1, None, -1), count + k))
        passes.append(_join(params, walk.inputs, forward, backward, traits[k]))
    return passes


def _record(params: ChainParams, frames: FrameInput, tick: Tick) -> tuple[_Records, ChainState]:
    state = init(params, frames.timestamp_s.shape[1:], frames.timestamp_s)
    records: list[_Records] = []
    for index in range(len(frames.timestamp_s)):
        state, estimate = step(params, state, frames.at((index, ...)))
        records.append(
            _Records(
                estimate.world_from_cam,
                np.asarray(estimate.status) == int(Status.OPTIMIZED),
                np.asarray(state.agreement.is_here[..., 0, 0]),
                np.asarray(state.odometer.readings[..., 0]),
                np.asarray(state.window.stated[..., 0]),
            )
        )
        tick()
    return tree_stack(records), state


def _traits(params: ChainParams, end: ChainState) -> list[Traits]:
    given = (
        params.tilt_drift_rad2_per_m,
        params.heading_drift_rad2_per_m,
        params.position_drift_m2_per_m,
    )
    drift = np.asarray(drift_of(params, end.trust.noise, end.trust.rates))
    learned = np.maximum(drift, drift[..., 2:, :] / [[_LEVER_M2], [_LEVER_M2], [1.0]])
    drift = np.where(np.array(given)[:, None] < 0, _LEARNED_FACTOR * learned, drift)
    rows = np.concatenate([drift, end.trust.noise], axis=-2)[..., 0]
    return [Traits(*row) for row in rows.tolist()]


def _join(
    params: ChainParams, inputs: FrameInput, forward: _Records, backward: _Records, traits: Traits
) -> Passes:
    """What the passes over one walk say; frames of worlds without predictions are left out."""
    counts = forward.is_used.copy()
    if params.not_here:
        predicted = np.flatnonzero(counts)
        counts[predicted] = _in_long_runs((forward.is_here & backward.is_here)[predicted])
    world = np.cumsum(inputs.tracking_reset)
    is_tracked = inputs.tracking_ok & np.isin(world, world[counts])
    rows = np.flatnonzero(is_tracked)
    vio_from_cam = _z_up(inputs.vio_from_cam.at(rows))
    before, after = (
        _world_from_vio(one.world_from_cam.at(rows), vio_from_cam) for one in (forward, backward)
    )
    is_linked = np.diff(world[rows]) == 0
    for k in np.flatnonzero(is_linked & (np.diff(rows) > 1)):
        is_linked[k] = _is_same(before.at(k), after.at(k + 1), vio_from_cam.at(k), traits)
    return Passes(
        rows,
        vio_from_cam,
        np.diff(forward.readings[rows], axis=0),
        is_linked,
        _where_known(before, after),
        np.searchsorted(rows, np.flatnonzero(counts)),
        inputs.apr_world_from_cam.at(counts),
        forward.stated[counts],
        traits,
    )


def _in_long_runs(is_here: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those that are true in runs that are long, or as long as the walk."""
    begins = np.append(True, is_here[1:] != is_here[:-1])[: len(is_here)]
    lengths = np.diff(np.append(np.flatnonzero(begins), len(is_here)))
    return is_here & np.repeat(lengths >= min(_LEAST_RUN, len(is_here)), lengths)


def _z_up(vio_from_cam: Rigid3) -> Rigid3:
    columns = z_up_column(vio_from_cam)[..., 0]
    return Rigid3(columns[..., :3], columns[..., 3:])


def _world_from_vio(world_from_cam: Rigid3, vio_from_cam: Rigid3) -> Rigid3:
    return world_from_cam @ vio_from_cam.inverse()


def _is_same(before: Rigid3, after: Rigid3, vio_from_cam: Rigid3, traits: Traits) -> bool:
    """Whether two world_from_vio, either maybe NaN, put a camera about where the other does."""
    first, second = before @ vio_from_cam, after @ vio_from_cam
    distance_m = np.linalg.norm(first.translation_m - second.translation_m)
    turn_deg = quaternion.angle_between_deg(first.quat_xyzw, second.quat_xyzw)
    most_m = max(_SAME_WORLD_M, _SAME_WORLD_NOISE * traits.noise_m)
    most_deg = max(_SAME_WORLD_DEG, _SAME_WORLD_NOISE * float(np.degrees(traits.noise_rad)))
    return not (distance_m > most_m or turn_deg > most_deg)


def _where_known(first: Rigid3, second: Rigid3) -> Rigid3:
    """The first, or else the second, or else that of the nearest frame that has one."""
    is_known = np.isfinite(first.translation_m[:, :1])
    either = choose(is_known[:, 0], first, second)
    known = np.flatnonzero(np.isfinite(either.translation_m[:, 0]))
    after = np.searchsorted(known, np.arange(len(is_known))).clip(1, max(len(known) - 1, 1))
    if len(known) < 2:
        return either.at(np.zeros(len(is_known), dtype=int) + known[:1].sum())
    is_nearer = np.arange(len(is_known)) - known[after - 1] < known[after] - np.arange(
        len(is_known)
    )
    return either.at(np.where(is_nearer, known[after - 1], known[after]))
