"""Fusing recorded walks: one at a time, or thousands at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry.arrays import Array, select
from vioapr.geometry.tree import tree_at, tree_map, tree_stack
from vioapr.work.progress import Tick, ignore

View = Literal["retrospective", "live"]
"""`live`: what was known when each frame arrived. `retrospective`: as the paper's tables, the
predictions of a run that later proved right count as keyframes from its beginning."""


def fuse_walk(
    method: Method,
    params: Any,
    frames: PairedFrames,
    *,
    view: View = "retrospective",
    tick: Tick = ignore,
) -> FusedWalk:
    """Fuse one walk.

    Raises:
        MissingExtraError: The method needs a package that is not installed.
        ParameterError: The view is unknown.
    """
    return in_view(view, frames, run_steps(method, params, frames.inputs, tick=tick))


def fuse_walks(
    method: Method,
    params: Any,
    walks: Sequence[PairedFrames],
    *,
    view: View = "retrospective",
    tick: Tick = ignore,
) -> list[FusedWalk]:
    """Fuse many walks, in one batch where the method allows it.

    Args:
        method: Any registered method.
        params: Its parameters.
        walks: The walks, of any lengths.
        view: See `View`.
        tick: Called once for every time step of the batch, or frame of a walk.

    Raises:
        MissingExtraError: The method needs a package that is not installed.
        ParameterError: The view is unknown.
    """
    if not method.is_batched:
        return [fuse_walk(method, params, walk, view=view, tick=tick) for walk in walks]
    if not walks:
        return []
    batch = run_steps(method, params, stack_walks(walks), tick=tick)
    # The frames that pad a shorter walk are cut off again.
    fused: list[FusedWalk] = []
    for index, walk in enumerate(walks):
        fused.append(in_view(view, walk, tree_at(batch, (slice(0, len(walk)), index))))
    return fused


def run_steps(method: Method, params: Any, frames: FrameInput, *, tick: Tick = ignore) -> Estimate:
    """Step a method through frames of shape (time, ...); the estimates have that shape too.

    Args:
        method: Any registered method.
        params: Its parameters; their values may be arrays of the batch shape (...).
        frames: Leading axis time, then batch axes; none for methods that are not batched.
        tick: Called after every frame, for progress.
    """
    state = method.init(params, tuple(frames.timestamp_s.shape[1:]), frames.timestamp_s)
    estimates: list[Estimate] = []
    for index in range(frames.timestamp_s.shape[0]):
        state, estimate = method.step(params, state, frames.at((index, ...)))
        estimates.append(estimate)
        tick()
    return tree_stack(estimates)


def stack_walks(walks: Sequence[PairedFrames]) -> FrameInput:
    """Walks of any lengths as one batch of shape (time, walks).

    Shorter walks end with frames that have neither prediction nor tracking. Where only some
    walks have stated sigmas, those of the others are NaN.
    """
    length = max(len(walk) for walk in walks)
    unknown = np.full(length, np.nan)
    states_m, states_rad = (
        any(getattr(walk.inputs, name) is not None for walk in walks)
        for name in ("apr_sigma_m", "apr_sigma_rad")
    )
    padded: list[FrameInput] = []
    for walk in walks:
        is_real = np.arange(length) < len(walk)
        frames = walk.inputs.at(np.minimum(np.arange(length), len(walk) - 1))
        frames = frames._replace(
            has_apr=frames.has_apr & is_real, tracking_ok=frames.tracking_ok & is_real
        )
        if states_m and frames.apr_sigma_m is None:
            frames = frames._replace(apr_sigma_m=unknown)
        if states_rad and frames.apr_sigma_rad is None:
            frames = frames._replace(apr_sigma_rad=unknown)
        padded.append(frames)
    return tree_stack(padded, axis=1)


def in_view(view: View, frames: PairedFrames, estimates: Estimate) -> FusedWalk:
    """A walk's estimates as live or retrospective results.

    Args:
        view: See `View`.
        frames: The walk, n frames.
        estimates: Shape (n,), in NumPy.

    Raises:
        ParameterError: The view is unknown.
    """
    live = FusedWalk(
        frames.timestamp_s,
        estimates.world_from_cam,
        np.asarray(estimates.status),
        _known(estimates.sigma_position_m),
        _known(estimates.sigma_orientation_deg),
        estimates.world_from_vio,
        None if estimates.localization_state is None else np.asarray(estimates.localization_state),
        None if estimates.confidence is None else np.asarray(estimates.confidence),
        _known(estimates.sigma_position_axes_m),
        _known(estimates.sigma_orientation_axes_deg),
    )
    if view == "live":
        return live
    if view != "retrospective":
        raise ParameterError(f"unknown view {view!r}: expected retrospective or live")
    is_keyframe = later_confirmed(frames.inputs, np.asarray(estimates.confirmed_run))
    return replace(
        live,
        world_from_cam=tree_map(
            partial(select, is_keyframe), frames.inputs.apr_world_from_cam, live.world_from_cam
        ),
        status=np.where(is_keyframe, Status.KEYFRAME, live.status),
    )


def _known(sigma: Array | None) -> NDArray[np.float64] | None:
    return None if sigma is None else np.asarray(sigma)


def later_confirmed(frames: FrameInput, confirmed_run: NDArray[np.integer]) -> NDArray[np.bool_]:
    """The predictions that this or a later frame confirmed as keyframes in a run, shape (n,).

    Args:
        frames: Shape (n,).
        confirmed_run: Shape (n,), see `Estimate`.
    """
    predicted = np.flatnonzero(frames.has_apr & frames.tracking_ok)
    order = np.searchsorted(predicted, np.arange(len(confirmed_run)), side="right")
    is_keyframe = np.zeros(len(confirmed_run), dtype=bool)
    for row in np.flatnonzero(confirmed_run > 1):
        is_keyframe[predicted[order[row] - confirmed_run[row] : order[row]]] = True
    return is_keyframe
