"""Fusing recorded walks: one at a time, or thousands at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry import rigid
from vioapr.geometry.arrays import namespace
from vioapr.geometry.rigid import Rigid3

View = Literal["retrospective", "live"]
"""`live`: what was known when each frame arrived. `retrospective`: as the paper's tables, the
predictions of a run that later proved right count as keyframes from its beginning."""


@dataclass(frozen=True, eq=False)
class FusedWalk:
    """A method's estimates over one walk, n frames.

    Attributes:
        timestamp_s: Shape (n,), seconds.
        world_from_cam: Poses, shape (n,); NaN where unlocalized.
        status: Shape (n,), integers of `Status`.
        sigma_position_m: Shape (n,), per axis, or None where the method has none.
        sigma_orientation_deg: Shape (n,), or None.
    """

    timestamp_s: NDArray[np.float64]
    world_from_cam: Rigid3
    status: NDArray[np.integer]
    sigma_position_m: NDArray[np.float64] | None = None
    sigma_orientation_deg: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def is_localized(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames that have a pose."""
        return self.status != Status.UNLOCALIZED


def run_steps(method: Method, params: Any, frames: FrameInput, *, tick: Tick = None) -> Estimate:
    """Step a method through frames of shape (time, ...); the estimates have that shape too.

    Args:
        method: Any registered method.
        params: Its parameters; their values may be arrays of the batch shape (...).
        frames: Leading axis time, then batch axes; none for methods that are not batched.
        tick: Called after every frame, for progress.
    """
    state = method.init(params, tuple(frames.timestamp_s.shape[1:]), frames.timestamp_s)
    estimates = []
    for index in range(frames.timestamp_s.shape[0]):
        state, estimate = method.step(params, state, frames.at((index, ...)))
        estimates.append(estimate)
        if tick is not None:
            tick()
    return stack_estimates(estimates)


Tick = Callable[[], object] | None


def stack_estimates(estimates: Sequence[Estimate]) -> Estimate:
    """Join estimates along a new leading axis."""
    xp = namespace(estimates[0].status)

    columns = [list(column) for column in zip(*estimates, strict=True)]
    return Estimate(
        rigid.stack(columns[0]),
        rigid.stack(columns[1]),
        *(None if column[0] is None else xp.stack(column) for column in columns[2:]),
    )


def fuse_walk(
    method: Method,
    params: Any,
    frames: PairedFrames,
    *,
    view: View = "retrospective",
    tick: Tick = None,
) -> FusedWalk:
    """Fuse one walk.

    Raises:
        MissingExtraError: The method needs a package that is not installed.
    """
    estimates = run_steps(method, params, frames.inputs, tick=tick)
    return _finish(frames.inputs, estimates, view)


def fuse_walks(
    method: Method,
    params: Any,
    walks: Sequence[PairedFrames],
    *,
    view: View = "retrospective",
    tick: Tick = None,
) -> list[FusedWalk]:
    """Fuse many walks, in one batch where the method allows it.

    Args:
        method: Any registered method.
        params: Its parameters.
        walks: The walks, of any lengths.
        view: See `View`.
        tick: Called once for every time step of the batch, or frame of a walk.
    """
    if not method.is_batched:
        return [fuse_walk(method, params, walk, view=view, tick=tick) for walk in walks]
    if not walks:
        return []
    estimates = run_steps(method, params, stack_walks(walks), tick=tick)
    return [
        _finish(walk.inputs, _crop(estimates, index, len(walk)), view)
        for index, walk in enumerate(walks)
    ]


def stack_walks(walks: Sequence[PairedFrames]) -> FrameInput:
    """Walks of any lengths as one batch of shape (time, walks).

    Shorter walks end with frames that have neither prediction nor tracking.
    """
    length = max(len(walk) for walk in walks)
    padded = [_pad(walk.inputs, length) for walk in walks]
    times, aprs, has_apr, vios, is_ok, is_reset, *sigmas = map(list, zip(*padded, strict=True))
    return FrameInput(
        np.stack(times, axis=1),
        rigid.stack(aprs, axis=1),
        np.stack(has_apr, axis=1),
        rigid.stack(vios, axis=1),
        np.stack(is_ok, axis=1),
        np.stack(is_reset, axis=1),
        *(_stack_sigmas(column, length) for column in sigmas),
    )


def _stack_sigmas(sigmas: list[NDArray | None], length: int) -> NDArray | None:
    """Of walks of which some may have none: NaN there."""
    if all(sigma is None for sigma in sigmas):
        return None
    nothing = np.full(length, np.nan)
    return np.stack([nothing if sigma is None else sigma for sigma in sigmas], axis=1)


def _pad(frames: FrameInput, length: int) -> FrameInput:
    """Frames without prediction and tracking at the end, up to a common length."""
    rows = np.minimum(np.arange(length), len(frames.timestamp_s) - 1)
    padded = frames.at(rows)
    is_real = np.arange(length) < len(frames.timestamp_s)
    return padded._replace(
        has_apr=padded.has_apr & is_real, tracking_ok=padded.tracking_ok & is_real
    )


def _crop(estimates: Estimate, index: int, length: int) -> Estimate:
    """One walk's estimates out of a batch of shape (time, walks)."""
    at = (slice(0, length), index)
    return Estimate(
        estimates.world_from_cam.at(at),
        estimates.world_from_vio.at(at),
        *(None if values is None else values[at] for values in estimates[2:]),
    )


def _finish(frames: FrameInput, estimates: Estimate, view: View) -> FusedWalk:
    if view not in ("retrospective", "live"):
        raise ParameterError(f"unknown view {view!r}: expected retrospective or live")
    live = FusedWalk(
        frames.timestamp_s,
        estimates.world_from_cam,
        estimates.status,
        estimates.sigma_position_m,
        estimates.sigma_orientation_deg,
    )
    return live if view == "live" else _confirm_runs(frames, live, estimates.confirmed_run)


def _confirm_runs(frames: FrameInput, live: FusedWalk, confirmed_run: NDArray) -> FusedWalk:
    """Make keyframes of the predictions that a later frame confirmed."""
    predicted = np.flatnonzero(frames.has_apr & frames.tracking_ok)
    order = np.searchsorted(predicted, np.arange(len(live)), side="right")
    is_keyframe = np.zeros(len(live), dtype=bool)
    for row in np.flatnonzero(confirmed_run > 1):
        is_keyframe[predicted[order[row] - confirmed_run[row] : order[row]]] = True
    pose = Rigid3(
        *(
            np.where(is_keyframe[:, None], apr, fused)
            for apr, fused in zip(frames.apr_world_from_cam, live.world_from_cam, strict=True)
        )
    )
    status = np.where(is_keyframe, Status.KEYFRAME, live.status)
    return replace(live, world_from_cam=pose, status=status)
