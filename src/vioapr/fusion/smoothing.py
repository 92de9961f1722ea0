"""The best trajectory after a walk: the same method forwards and backwards, combined.

A two-filter smoother: the forward pass knows the past of every frame, the backward pass its
future. Both are means of votes with stated uncertainties, so each frame's poses are averaged by
them. Causal estimates, as a phone needs them, come from `offline.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

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
            timestamp_s=walk.timestamps_s[0] + walk.timestamps_s[-1] - inputs.timestamp_s,
            tracking_reset=reset,
        )
    )


def _combine(forward: FusedWalk, backward: FusedWalk) -> FusedWalk:
    """Each frame's two poses, averaged by their uncertainties."""
    later = [backward.sigma_position_m, backward.sigma_orientation_deg]
    sigmas = [
        (sigma, other[::-1])
        for sigma, other in zip(
            (forward.sigma_position_m, forward.sigma_orientation_deg), later, strict=True
        )
        if sigma is not None and other is not None
    ]
    weights = [_weight_of_second(*pair) for pair in sigmas]
    first, second = forward.world_from_cam, backward.world_from_cam.at(slice(None, None, -1))
    pose = _average(first, second, *weights)
    status = np.where(forward.is_localized, forward.status, backward.status[::-1])
    is_raw = (status == Status.PREDICTED) & (backward.status[::-1] != Status.UNLOCALIZED)
    status = np.where(is_raw, backward.status[::-1], status)
    position, orientation = (
        _mix(*pair, weight) for pair, weight in zip(sigmas, weights, strict=True)
    )
    return replace(
        forward,
        world_from_cam=pose,
        status=status,
        sigma_position_m=position,
        sigma_orientation_deg=orientation,
    )


def _weight_of_second(first: NDArray, second: NDArray) -> NDArray[np.float64]:
    """0 where only the first is known, 1 where only the second is."""
    information = [np.nan_to_num(1 / sigma**2) for sigma in (first, second)]
    total = information[0] + information[1]
    return np.where(total > 0, information[1] / np.where(total > 0, total, 1.0), 0.0)


def _average(
    first: Rigid3, second: Rigid3, position_weight: NDArray, rotation_weight: NDArray
) -> Rigid3:
    first_or_second = rigid.choose(position_weight == 1, second, first)
    second_or_first = rigid.choose(position_weight == 0, first, second)
    weight = position_weight[:, None]
    return Rigid3(
        (1 - weight) * first_or_second.translation_m + weight * second_or_first.translation_m,
        quaternion.slerp(first_or_second.quat_xyzw, second_or_first.quat_xyzw, rotation_weight),
    )


def _mix(first: NDArray, second: NDArray, weight: NDArray) -> NDArray[np.float64]:
    """The sigma of the average if both err alike: they share the regressor's biases."""
    known_first, known_second = (
        np.where(weight == 1, second, first),
        np.where(weight == 0, first, second),
    )
    return np.sqrt((1 - weight) * known_first**2 + weight * known_second**2)
