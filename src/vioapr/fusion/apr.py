"""The raw prediction, as a method: what every other method has to beat."""

from __future__ import annotations

from dataclasses import dataclass

from vioapr.fusion.alignment import hide_unless
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.geometry.arrays import Array, namespace


@dataclass(frozen=True)
class AprParams:
    """The raw prediction has no parameters."""


def init(params: AprParams, batch_shape: tuple[int, ...], like: Array) -> tuple[()]:
    """There is nothing to remember."""
    return ()


def step(params: AprParams, state: tuple[()], frame: FrameInput) -> tuple[tuple[()], Estimate]:
    """The frame's prediction, where it has one; it needs no tracking."""
    xp = namespace(frame.timestamp_s)
    status = xp.astype(frame.has_apr, xp.int32) * int(Status.PREDICTED)
    world_from_vio = frame.apr_world_from_cam @ frame.vio_from_cam.inverse()
    return state, Estimate(
        hide_unless(frame.has_apr, frame.apr_world_from_cam),
        hide_unless(frame.has_apr & frame.tracking_ok, world_from_vio),
        status,
        status * 0,
    )


METHOD = Method(
    name="apr",
    summary="the regressor's raw prediction",
    params_type=AprParams,
    init=init,
    step=step,
)
