"""From the two trajectories of a walk to the frames that a fusion method steps through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.formats.track_warnings import TrackWarning
from vioapr.fusion.types import FrameInput
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3, choose
from vioapr.trajectory import (
    DEFAULT_TOLERANCE_S,
    Trajectory,
    associate,
    interpolate_between_frames,
)

_FEW = 0.1
"""A share of predictions that may come before the tracker starts, or after it ends."""


@dataclass(frozen=True, eq=False)
class PairedFrames:
    """The frames of one walk, in order of time.

    A frame is a pose of the tracker, with or without a prediction, or a prediction at a time
    when the tracker had no pose.

    Attributes:
        inputs: Frames, batch shape (n,).
        names: Image names, or None.
    """

    inputs: FrameInput
    names: tuple[str, ...] | None = None

    def __len__(self) -> int:
        return len(self.inputs.timestamp_s)

    @property
    def timestamp_s(self) -> NDArray[np.float64]:
        """Shape (n,), strictly increasing, seconds."""
        return np.asarray(self.inputs.timestamp_s)


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


def pair_frames(
    apr: Trajectory,
    vio: Trajectory,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    *,
    apr_sigmas: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> PairedFrames:
    """Merge a walk's predictions and its VIO poses into frames.

    A prediction without a VIO pose within the tolerance becomes a frame of its own. Its VIO pose
    is interpolated between the neighbouring ones, if these belong together (see
    `interpolate_between_frames`). Else its tracking is not ok: with such a frame the tracker
    counts as lost, as a phone would report it.

    Args:
        apr: world_from_cam, predicted.
        vio: vio_from_cam, tracked.
        tolerance_s: Largest difference of timestamps within a frame, s.
        apr_sigmas: The standard deviations of each prediction that the regressor states, if it
            does: per axis of position, m, and orientation, degrees, shape (len(apr),) each;
            NaN where it states nothing.

    Returns:
        The frames, with the prediction's image name where it has one, else the tracker's.

    Raises:
        AssociationError: No prediction has a VIO pose.
    """
    times, apr_row, vio_row = _match_rows(apr, vio, tolerance_s)
    vio_poses, has_vio = _vio_of_frames(vio, times, vio_row)
    if not ((apr_row >= 0) & has_vio).any():
        raise AssociationError(_explain_no_pairs(apr, vio, tolerance_s))
    names: tuple[str, ...] | None = None
    if apr.names is not None or vio.names is not None:
        apr_names, vio_names = apr.names or ("",) * len(apr), vio.names or ("",) * len(vio)
        rows = zip(map(int, apr_row), map(int, vio_row), strict=True)
        names = tuple(apr_names[a] if a >= 0 else vio_names[v] for a, v in rows)
    sigma_m = sigma_rad = None
    if apr_sigmas is not None:
        sigma_m, sigma_deg = (np.where(apr_row < 0, np.nan, s[apr_row]) for s in apr_sigmas)
        sigma_rad = np.deg2rad(sigma_deg)
    inputs = FrameInput(
        times,
        _rows_or_identity(apr, apr_row),
        apr_row >= 0,
        vio_poses,
        has_vio,
        np.zeros(len(times), dtype=bool),
        sigma_m,
        sigma_rad,
    )
    return PairedFrames(inputs, names)


def check_pairing(
    frames: PairedFrames, predictions: int, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> list[TrackWarning]:
    """Find out whether predictions lack a VIO pose.

    Args:
        frames: From `pair_frames`.
        predictions: How many were given to it.
        tolerance_s: As given to it.

    Returns:
        A warning, or none. A tracker may start after the predictions, and end before them: that
        is none, unless it concerns many.
    """
    has_apr, has_vio = np.asarray(frames.inputs.has_apr), np.asarray(frames.inputs.tracking_ok)
    unnamed = predictions - int(has_apr.sum())
    if unnamed > _FEW * predictions:
        return [
            TrackWarning(
                "no-vio",
                f"{unnamed} of {predictions} predictions are left out, as VIO has no pose of their "
                "image name",
                "give a VIO file with all its frames, or timestamps in both",
            )
        ]
    tracked, without = np.flatnonzero(has_vio), np.flatnonzero(has_apr & ~has_vio)
    is_within = (without > tracked[0]) & (without < tracked[-1])
    if not is_within.any() and len(without) <= _FEW * predictions:
        return []
    within = f", {is_within.sum()} of them while VIO goes on" if is_within.any() else ""
    return [
        TrackWarning(
            "no-vio",
            f"{len(without)} of {predictions} predictions have no VIO pose within {tolerance_s:g} s"
            f"{within}, and the tracker counts as lost there",
            "unless it was, give a VIO file with all its frames, or a larger `tolerance_s`",
        )
    ]


def _match_rows(
    apr: Trajectory, vio: Trajectory, tolerance_s: float
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """The times of a walk's frames and, of both trajectories, their rows or -1."""
    pairs = associate(vio, apr, tolerance_s)
    alone = np.setdiff1d(np.arange(len(apr)), pairs.right_rows)
    if not (apr.is_timed and vio.is_timed):
        alone = alone[:0]  # without a clock there is no telling where they belong
    vio_row = np.concatenate([np.arange(len(vio)), np.full(len(alone), -1)])
    apr_row = np.full(len(vio_row), -1)
    apr_row[pairs.left_rows] = pairs.right_rows
    apr_row[len(vio) :] = alone
    times = np.concatenate([vio.timestamp_s, apr.timestamp_s[alone]])
    order = np.argsort(times, kind="stable")
    return times[order], apr_row[order], vio_row[order]


def _vio_of_frames(
    vio: Trajectory, times: NDArray[np.float64], vio_row: NDArray[np.intp]
) -> tuple[Rigid3[FloatArray], NDArray[np.bool_]]:
    """The tracker's poses of frames, interpolated for row -1, and which of them are known."""
    is_between = vio_row < 0
    poses, is_known = _rows_or_identity(vio, vio_row), ~is_between
    if is_between.any():  # then both have a clock
        between, is_known[is_between] = interpolate_between_frames(vio, times[is_between])
        poses.translation_m[is_between], poses.quat_xyzw[is_between] = between
    return poses, is_known


def _rows_or_identity(trajectory: Trajectory, rows: NDArray[np.intp]) -> Rigid3:
    """The poses of some rows, the identity for row -1."""
    poses = trajectory.target_from_source.at(rows)
    return choose(rows >= 0, poses, Rigid3.identity(rows.shape))


def _explain_no_pairs(apr: Trajectory, vio: Trajectory, tolerance_s: float) -> str:
    if not (apr.is_timed and vio.is_timed):
        assert apr.names is not None  # else `associate` has raised
        assert vio.names is not None
        return (
            "no prediction has a VIO pose: the image names have nothing in common, "
            f"e.g. {apr.names[0]!r} and {vio.names[0]!r}"
        )
    spans = [f"{t.timestamp_s[0]:.3f} to {t.timestamp_s[-1]:.3f} s" for t in (apr, vio)]
    return (
        f"no prediction has a VIO pose within {tolerance_s} s: predictions cover {spans[0]}, "
        f"VIO {spans[1]}; both must use one clock"
    )
