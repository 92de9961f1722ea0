"""The best trajectory after a walk: the same method forwards and backwards, combined.

A two-filter smoother: the forward pass knows the past of every frame, the backward pass its
future. Both are means of votes with stated uncertainties, so each frame's poses are averaged by
them. Causal estimates, as a phone needs them, come from `offline.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.fusion.offline import FusedWalk, Tick, View, fuse_walks
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Method, Status
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3


def smooth_walk(
    method: Method,
    params: Any,
    frames: PairedFrames,
    *,
    view: View = "live",
    tick: Tick = None,
) -> FusedWalk:
    """Smooth one walk; see `smooth_walks`."""
    return smooth_walks(method, params, [frames], view=view, tick=tick)[0]


def smooth_walks(
    method: Method,
    params: Any,
    walks: Sequence[PairedFrames],
    *,
    view: View = "live",
    tick: Tick = None,
) -> list[FusedWalk]:
    """Fuse walks forwards and backwards and combine the two.

    Args:
        method: One that states its uncertainty.
        params: Its parameters.
        walks: The walks, of any lengths.
        view: See `vioapr.fusion.offline.View`.
        tick: Called as in `fuse_walks`, for both passes.

    Raises:
        ParameterError: The method has no uncertainties to combine by.
    """
    forwards = fuse_walks(method, params, walks, view=view, tick=tick)
    if any(walk.sigma_position_m is None for walk in forwards):
        raise ParameterError(
            f"smoothing needs a method that states its uncertainty, like consensus; "
            f"{method.name} does not"
        )
    backwards = fuse_walks(
        method, params, [reverse(walk) for walk in walks], view="live", tick=tick
    )
    return [_combine(*pair) for pair in zip(forwards, backwards, strict=True)]


def reverse(walk: PairedFrames) -> PairedFrames:
    """The walk as if it had been walked backwards."""
    inputs = walk.inputs.at(slice(None, None, -1))
    # A world that begins at frame k ends, walked backwards, before frame k - 1.
    reset = np.roll(inputs.tracking_reset, 1)
    reset[:1] = False
    return PairedFrames(
        inputs._replace(
            timestamp_s=walk.timestamp_s[0] + walk.timestamp_s[-1] - inputs.timestamp_s,
            tracking_reset=reset,
        )
    )


def _combine(forward: FusedWalk, backward: FusedWalk) -> FusedWalk:
    """Each frame's two poses, averaged by their uncertainties."""
    passes = [_Pass.of(forward), _Pass.of(backward).at(slice(None, None, -1))]
    first, second = passes[0].filled_from(passes[1]), passes[1].filled_from(passes[0])
    position_m, position_weight = _mix(first.sigma_position_m, second.sigma_position_m)
    orientation_deg, rotation_weight = _mix(
        first.sigma_orientation_deg, second.sigma_orientation_deg
    )
    # A frame that only one pass has tracked is the better for it.
    is_better = (first.status == Status.PREDICTED) & (second.status != Status.UNLOCALIZED)
    return replace(
        forward,
        world_from_cam=_average(
            first.world_from_cam, second.world_from_cam, position_weight, rotation_weight
        ),
        status=np.where(is_better, second.status, first.status),
        sigma_position_m=position_m,
        sigma_orientation_deg=orientation_deg,
    )


class _Pass(NamedTuple):
    """What one pass says of n frames, in order of time."""

    world_from_cam: Rigid3
    status: NDArray[np.integer]
    sigma_position_m: NDArray[np.float64]
    sigma_orientation_deg: NDArray[np.float64]

    @staticmethod
    def of(fused: FusedWalk) -> _Pass:
        assert fused.sigma_position_m is not None  # `smooth_walks` has checked
        assert fused.sigma_orientation_deg is not None
        return _Pass(
            fused.world_from_cam,
            fused.status,
            fused.sigma_position_m,
            fused.sigma_orientation_deg,
        )

    def at(self, index: slice) -> _Pass:
        return _Pass(
            self.world_from_cam.at(index),
            self.status[index],
            self.sigma_position_m[index],
            self.sigma_orientation_deg[index],
        )

    def filled_from(self, other: _Pass) -> _Pass:
        """With the other's answers where this one has none."""
        has_answer = self.status != Status.UNLOCALIZED
        return _Pass(
            rigid.choose(has_answer, self.world_from_cam, other.world_from_cam),
            np.where(has_answer, self.status, other.status),
            np.where(has_answer, self.sigma_position_m, other.sigma_position_m),
            np.where(has_answer, self.sigma_orientation_deg, other.sigma_orientation_deg),
        )


def _mix(first: NDArray, second: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The average's sigma, if both err alike: they share the regressor's biases; its weight."""
    weight = first**2 / (first**2 + second**2)
    return np.sqrt((1 - weight) * first**2 + weight * second**2), weight


def _average(
    first: Rigid3, second: Rigid3, position_weight: NDArray, rotation_weight: NDArray
) -> Rigid3:
    """Weights are the second's."""
    weight = position_weight[:, None]
    return Rigid3(
        (1 - weight) * first.translation_m + weight * second.translation_m,
        quaternion.slerp(first.quat_xyzw, second.quat_xyzw, rotation_weight),
    )
