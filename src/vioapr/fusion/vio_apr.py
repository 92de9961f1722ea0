"""The paper's method: period alignment and pose optimization in turn (section 3.3).

While aligning, consecutive predictions are compared with VIO until N pairs in a row agree;
these N + 1 frames are keyframes and their means the reference. During the T predictions that
follow, each is compared with the reference: a keyframe where it agrees, otherwise replaced by
VIO placed through the reference. Then the method aligns anew, to undo VIO's drift; meanwhile
the last reference carries on (`tracked`). docs/paper_map.md lists how the paper's open
questions are decided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import tyro

from vioapr.errors import ParameterError
from vioapr.fusion.alignment import (
    Reference,
    Run,
    empty_run,
    extend_run,
    hide_unless,
    no_reference,
    passes_checker,
    update_reference,
)
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry.arrays import Array, namespace, select, zeros
from vioapr.geometry.rigid import choose


@dataclass(frozen=True)
class VioAprParams:
    """The paper's four parameters, with its values (section 5.1)."""

    distance_threshold_m: Annotated[float, tyro.conf.arg(name="d-th")] = 0.4
    """The paper's d_th, m: largest difference between the distances that regressor and VIO
    moved."""
    angle_threshold_deg: Annotated[float, tyro.conf.arg(name="o-th")] = 4.0
    """The paper's o_th, deg: likewise for the angles that they turned."""
    run_pairs: Annotated[int, tyro.conf.arg(name="n")] = 2
    """The paper's N: consecutive pairs that must agree to make a reference (N + 1 frames)."""
    optimized_frames: Annotated[int, tyro.conf.arg(name="t")] = 8
    """The paper's T: predictions checked against a reference before a new one is sought."""

    def __post_init__(self) -> None:
        for flag, value in (
            ("d-th", self.distance_threshold_m),
            ("o-th", self.angle_threshold_deg),
        ):
            if not 0 <= value < float("inf"):
                raise ParameterError(f"--{flag}: expected a number of at least 0, got {value}")
        for flag, count in (("n", self.run_pairs), ("t", self.optimized_frames)):
            if not (count >= 1 and count == int(count)):
                raise ParameterError(
                    f"--{flag}: expected a whole number of at least 1, got {count}"
                )


class VioAprState(NamedTuple):
    """What the method remembers between frames; its size does not depend on their number.

    Attributes:
        run: The run of agreeing predictions, during period alignment.
        reference: The reference in use.
        frames_left: Shape (...), predictions left in pose optimization; 0 while aligning.
    """

    run: Run
    reference: Reference
    frames_left: Array


def init(params: VioAprParams, batch_shape: tuple[int, ...], like: Array) -> VioAprState:
    """The state before the first frame."""
    return VioAprState(
        empty_run(batch_shape, int(params.run_pairs) + 1, like),
        no_reference(batch_shape, like),
        zeros(batch_shape, like),
    )


def step(
    params: VioAprParams, state: VioAprState, frame: FrameInput
) -> tuple[VioAprState, Estimate]:
    """One frame of the paper's method."""
    state = forget_lost_worlds(state, frame)
    is_compared = frame.has_apr & frame.tracking_ok
    is_optimizing = is_compared & (state.frames_left > 0)
    is_aligning = is_compared & ~is_optimizing

    agrees = passes_checker(
        params, state.reference.apr_world_from_cam, state.reference.vio_from_cam, frame
    )
    run = extend_run(params, state.run, frame)
    completes = is_aligning & (run.length >= params.run_pairs + 1)
    after = update_reference(params, state.reference, run, completes)

    is_keyframe = completes | (is_optimizing & agrees)
    status = _status(frame.tracking_ok & after.is_known, is_keyframe, is_optimizing, state)
    next_state = VioAprState(
        _advance_run(state.run, run, is_aligning, completes),
        after,
        _count_down(params, state.frames_left, is_optimizing, completes),
    )
    placed = after.place(frame.vio_from_cam)
    return next_state, Estimate(
        hide_unless(status > 0, choose(is_keyframe, frame.apr_world_from_cam, placed)),
        hide_unless(after.is_known, after.world_from_vio()),
        status,
        _confirmed_run(params, status, completes),
    )


def forget_lost_worlds(state: VioAprState, frame: FrameInput) -> VioAprState:
    """A lost or reset tracker starts a new segment: references to its old world are void."""
    keeps = frame.keeps_world
    return VioAprState(
        state.run._replace(length=_zero_unless(keeps, state.run.length)),
        state.reference._replace(is_known=state.reference.is_known & keeps),
        _zero_unless(keeps, state.frames_left),
    )


def _zero_unless(condition: Array, values: Array) -> Array:
    return select(condition, values, namespace(values).zeros_like(values))


def _advance_run(old: Run, extended: Run, is_aligning: Array, completes: Array) -> Run:
    """The run grows only while aligning, and ends when it is complete."""
    length = select(is_aligning, extended.length, old.length)
    return Run(
        choose(is_aligning[..., None], extended.apr_world_from_cam, old.apr_world_from_cam),
        choose(is_aligning[..., None], extended.vio_from_cam, old.vio_from_cam),
        _zero_unless(~completes, length),
    )


def _count_down(
    params: VioAprParams, frames_left: Array, is_optimizing: Array, completes: Array
) -> Array:
    """T predictions from a completed run on, then 0."""
    counted = frames_left - namespace(frames_left).astype(is_optimizing, frames_left.dtype)
    return select(completes, frames_left * 0 + params.optimized_frames, counted)


def _status(
    is_placed: Array, is_keyframe: Array, is_optimizing: Array, state: VioAprState
) -> Array:
    """Integers of `Status`, shape (...)."""
    xp = namespace(state.frames_left)
    unlocalized = xp.astype(state.frames_left * 0, xp.int32)
    status = xp.where(is_placed, unlocalized + int(Status.TRACKED), unlocalized)
    status = xp.where(is_optimizing, unlocalized + int(Status.OPTIMIZED), status)
    return xp.where(is_keyframe, unlocalized + int(Status.KEYFRAME), status)


def _confirmed_run(params: VioAprParams, status: Array, completes: Array) -> Array:
    """How many predictions this frame confirms: the run's, 1 for any other keyframe."""
    xp = namespace(status)
    size = xp.astype(status * 0 + params.run_pairs + 1, xp.int32)
    is_keyframe = xp.astype(status == int(Status.KEYFRAME), xp.int32)
    return xp.where(completes, size, is_keyframe)


METHOD = Method(
    name="vio-apr",
    summary="the paper's method: keyframes by relative pose check, others replaced through VIO",
    params_type=VioAprParams,
    init=init,
    step=step,
)
