"""VIO only: odometry placed once, by the first reference (paper, Figure "drift").

It shows how VIO drifts when nothing corrects it. The reference is the first that period
alignment finds; the paper places its curve by the first frame's ground truth, which a user's
walk does not have.
"""

from __future__ import annotations

from vioapr.fusion import vio_apr
from vioapr.fusion.alignment import hide_unless
from vioapr.fusion.types import Estimate, FrameInput, Method, Status
from vioapr.fusion.vio_apr import VioAprParams, VioAprState
from vioapr.geometry.arrays import namespace


def step(
    params: VioAprParams, state: VioAprState, frame: FrameInput
) -> tuple[VioAprState, Estimate]:
    """As `vio-apr` up to the first reference, which is then kept."""
    next_state, estimate = vio_apr.step(params, state, frame)
    # Never counting down keeps the method in pose optimization, so it never aligns again.
    kept = next_state.reference.is_known
    xp = namespace(estimate.status)
    tracked = xp.where(frame.tracking_ok & kept, estimate.status * 0 + int(Status.TRACKED), 0)
    frames_left = next_state.frames_left * 0 + xp.astype(kept, next_state.frames_left.dtype)
    placed = next_state.reference.place(frame.vio_from_cam)
    return next_state._replace(frames_left=frames_left), estimate._replace(
        world_from_cam=hide_unless(tracked > 0, placed),
        status=tracked,
        confirmed_run=tracked * 0,
    )


METHOD = Method(
    name="vio",
    summary="odometry placed once by the first reference, never corrected",
    params_type=VioAprParams,
    init=vio_apr.init,
    step=step,
)
