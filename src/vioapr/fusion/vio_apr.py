"""The paper's method: period alignment and pose optimization in turn (section 3.3).

While aligning, consecutive predictions are compared with VIO until N pairs in a row agree;
these N + 1 frames are keyframes and their means the reference. During the T predictions that
follow, each is compared with the reference: a keyframe where it agrees, otherwise replaced by
VIO placed through the reference. Then the method aligns again, to undo VIO's drift; meanwhile
the last reference carries on (`tracked`). docs/design/paper_map.md lists how the paper's open
questions are decided.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
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
from vioapr.geometry.arrays import Array, Mask, namespace, select, zeros
from vioapr.geometry.rigid import choose
from vioapr.geometry.tree import tree_map


@dataclass(frozen=True)
class VioAprParams:
    """The paper's four parameters, with its values (section 5.1)."""

    distance_threshold_m: Annotated[float, tyro.conf.arg(name="d-th")] = 0.4
    """The paper's d_th, m: largest difference between the distances that regressor and VIO
    moved."""
    angle_threshold_deg: Annotated[float, tyro.conf.arg(name="o-th")] = 4.0
    """The paper's o_th, deg: largest difference between the angles that they turned."""
    run_pairs: Annotated[int, tyro.conf.arg(name="n")] = 2
    """The paper's N: consecutive pairs that must agree to make a reference (N + 1 frames)."""
    optimized_frames: Annotated[int, tyro.conf.arg(name="t")] = 8
    """The paper's T: predictions checked against a reference before a new one is sought."""

    def __post_init__(self) -> None:
        for name in ("distance_threshold_m", "angle_threshold_deg"):
            value = getattr(self, name)
            if not 0 <= value < float("inf"):
                raise ParameterError(f"{name}: expected a number of at least 0, got {value}")
        for name in ("run_pairs", "optimized_frames"):
            count = getattr(self, name)
            if not (count >= 1 and count == int(count)):
                raise ParameterError(f"{name}: expected a whole number of at least 1, got {count}")


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
    xp = namespace(state.frames_left)
    state = forget_lost_worlds(state, frame)
    is_compared = frame.has_apr & frame.tracking_ok
    is_optimizing = is_compared & (state.frames_left > 0)
    is_aligning = is_compared & ~is_optimizing

    agrees = passes_checker(
        params, state.reference.apr_world_from_cam, state.reference.vio_from_cam, frame
    )
    run = extend_run(params, state.run, frame)
    completes = is_aligning & (run.length >= params.run_pairs + 1)
    reference = update_reference(params, state.reference, run, completes)
    # The run grows only while aligning, and ends when it is complete.
    run = tree_map(partial(select, is_aligning), run, state.run)
    run = run._replace(length=_zero_unless(~completes, run.length))
    # A completed run starts the count of T predictions.
    counted = state.frames_left - xp.astype(is_optimizing, state.frames_left.dtype)
    frames_left = select(completes, state.frames_left * 0 + params.optimized_frames, counted)

    is_keyframe = completes | (is_optimizing & agrees)
    zero = xp.astype(state.frames_left * 0, xp.int32)
    is_placed = frame.tracking_ok & reference.is_known
    status = xp.where(is_placed, zero + int(Status.TRACKED), zero)
    status = xp.where(is_optimizing, zero + int(Status.OPTIMIZED), status)
    status = xp.where(is_keyframe, zero + int(Status.KEYFRAME), status)
    placed = choose(is_keyframe, frame.apr_world_from_cam, reference.place(frame.vio_from_cam))
    run_size = xp.astype(zero + params.run_pairs + 1, xp.int32)
    return VioAprState(run, reference, frames_left), Estimate(
        hide_unless(status > 0, placed),
        hide_unless(reference.is_known, reference.world_from_vio()),
        status,
        xp.where(completes, run_size, xp.astype(is_keyframe, xp.int32)),
    )


def forget_lost_worlds(state: VioAprState, frame: FrameInput) -> VioAprState:
    """A lost or reset tracker starts a new segment: references to its old world are void."""
    keeps = frame.keeps_world
    return VioAprState(
        state.run._replace(length=_zero_unless(keeps, state.run.length)),
        state.reference._replace(is_known=state.reference.is_known & keeps),
        _zero_unless(keeps, state.frames_left),
    )


def _zero_unless(condition: Mask, values: Array) -> Array:
    return select(condition, values, namespace(values).zeros_like(values))


METHOD = Method(
    name="vio-apr",
    summary="the paper's method: keyframes by relative pose check, others replaced through VIO",
    params_type=VioAprParams,
    init=init,
    step=step,
)
