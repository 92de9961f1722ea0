"""Fusing the two trajectories of a walk in one call."""

from __future__ import annotations

from typing import Any

from vioapr.errors import ParameterError
from vioapr.formats.stated_sigmas import Sigmas
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.methods import DEFAULT_METHOD, get_method
from vioapr.fusion.offline import View, fuse_walk
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.smoothing import smooth_walk
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory


def fuse(
    apr: Trajectory,
    vio: Trajectory,
    method: str = DEFAULT_METHOD,
    params: Any = None,
    *,
    view: View = "retrospective",
    offline: bool = False,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    apr_sigmas: Sigmas | None = None,
) -> FusedWalk:
    """Fuse a walk's predicted poses with its tracked ones into a robust pose for every frame.

    Args:
        apr: Poses that a regressor, or any absolute localizer, predicted: world_from_cam, m.
        vio: Poses that the phone tracked on the same clock: vio_from_cam, m, in a world of its
            own.
        method: A key of `METHODS`.
        params: The method's parameters, of its `params_type`; None for the defaults.
        view: retrospective: predictions that later prove right count as keyframes, as in the
            paper's tables. live: what was known when each frame arrived.
        offline: Use the future too, for the best trajectory after the walk (chain only).
        tolerance_s: Largest difference of timestamps between a prediction and its VIO pose, s.
            VIO is interpolated at the other predictions, where its frames are near in time.
        apr_sigmas: The sigmas of its predictions that the regressor states, if it does.

    Returns:
        A pose and a status for every frame, in the world of the predictions.

    Raises:
        ParameterError: There is no such method, its parameters are another's, or it does not
            work offline.
        AssociationError: No prediction has a VIO pose.
        MissingExtraError: The method needs a package that is not installed.
    """
    chosen = get_method(method)
    given = chosen.params_type() if params is None else params
    if not isinstance(given, chosen.params_type):
        raise ParameterError(
            f"params: expected {chosen.params_type.__name__} for method {method!r}, "
            f"got {type(given).__name__}"
        )
    frames = pair_frames(apr, vio, tolerance_s, apr_sigmas=apr_sigmas)
    if offline:
        return smooth_walk(chosen, given, frames)
    return fuse_walk(chosen, given, frames, view=view)
