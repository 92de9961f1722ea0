"""The best trajectory after a walk: the same method forwards and backwards, combined.

A two-filter smoother: the forward pass knows the past of every frame, the backward pass its
future. Both state their uncertainties, so each frame's poses are averaged by them. Causal
estimates, as a phone needs them, come from `offline.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.offline import View, fuse_walks
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import Method, Status
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import select
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_at, tree_map
from vioapr.work.progress import Tick, ignore


def smooth_walk(
    method: Method,
    params: Any,
    frames: PairedFrames,
    *,
    view: View = "live",
    tick: Tick = ignore,
) -> FusedWalk:
    """Smooth one walk; see `smooth_walks`."""
    return smooth_walks(method, params, [frames], view=view, tick=tick)[0]


def smooth_walks(
    method: Method,
    params: Any,
    walks: Sequence[PairedFrames],
    *,
    view: View = "live",
    tick: Tick = ignore,
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
            f"smoothing needs a method that states its uncertainty, like chain; "
            f"{method.name} does not"
        )
    reversed_walks = [reverse(walk) for walk in walks]
    backwards = fuse_walks(method, params, reversed_walks, view="live", tick=tick)
    smoothed: list[FusedWalk] = []
    for forward, backward in zip(forwards, backwards, strict=True):
        in_order = tree_at(Pass.of(backward), slice(None, None, -1))
        average = average_passes(Pass.of(forward), in_order)
        smoothed.append(replace(forward, **_LIVE_ONLY, **average._asdict()))
    return smoothed


_LIVE_ONLY: dict[str, None] = dict.fromkeys(("world_from_vio", "localization_state", "confidence"))
"""What is of the moment, and has no average."""


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


class Pass(NamedTuple):
    """What one pass says of n frames, in order of time; see `FusedWalk`."""

    world_from_cam: Rigid3
    status: NDArray[np.integer]
    sigma_position_m: NDArray[np.float64]
    sigma_orientation_deg: NDArray[np.float64]

    @staticmethod
    def of(fused: FusedWalk) -> Pass:
        """A walk fused by a method that states its uncertainty."""
        assert fused.sigma_position_m is not None
        assert fused.sigma_orientation_deg is not None
        return Pass(
            fused.world_from_cam,
            fused.status,
            fused.sigma_position_m,
            fused.sigma_orientation_deg,
        )


def average_passes(forward: Pass, backward: Pass) -> Pass:
    """Each frame's two poses, averaged by their uncertainties."""
    # Where one pass has no answer, it takes the other's.
    first = tree_map(partial(select, forward.status != Status.UNLOCALIZED), forward, backward)
    second = tree_map(partial(select, backward.status != Status.UNLOCALIZED), backward, forward)
    position_m, position_weight = _mix(first.sigma_position_m, second.sigma_position_m)
    orientation_deg, rotation_weight = _mix(
        first.sigma_orientation_deg, second.sigma_orientation_deg
    )
    weight = position_weight[:, None]
    ours, theirs = first.world_from_cam, second.world_from_cam
    # A frame that only one pass has tracked is the better for it.
    is_better = (first.status == Status.PREDICTED) & (second.status != Status.UNLOCALIZED)
    return Pass(
        Rigid3(
            (1 - weight) * ours.translation_m + weight * theirs.translation_m,
            quaternion.slerp(ours.quat_xyzw, theirs.quat_xyzw, rotation_weight),
        ),
        np.where(is_better, second.status, first.status),
        position_m,
        orientation_deg,
    )


def _mix(
    first: NDArray[np.float64], second: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The average's sigma, if both err alike (they share the regressor's biases); its weight.

    The weight is the second's.
    """
    weight = first**2 / (first**2 + second**2)
    return np.sqrt((1 - weight) * first**2 + weight * second**2), weight
