"""From the two trajectories of a walk to the frames that a fusion method steps through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.fusion.types import FrameInput
from vioapr.geometry.rigid import Rigid3, choose
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, associate


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


def pair_frames(
    apr: Trajectory,
    vio: Trajectory,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    *,
    apr_sigmas: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> PairedFrames:
    """Merge a walk's predictions and its VIO poses into frames.

    A prediction without a VIO pose within the tolerance becomes a frame whose tracking is not
    ok. With such a frame the tracker counts as lost, as a phone would report it.

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
    times, apr_row, vio_row = match_rows(apr, vio, tolerance_s)
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
        _rows_or_identity(vio, vio_row),
        vio_row >= 0,
        np.zeros(len(times), dtype=bool),
        sigma_m,
        sigma_rad,
    )
    return PairedFrames(inputs, names)


def match_rows(
    apr: Trajectory, vio: Trajectory, tolerance_s: float
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """The times of a walk's frames and, of both trajectories, their rows or -1.

    Raises:
        AssociationError: No prediction has a VIO pose.
    """
    pairs = associate(vio, apr, tolerance_s)
    if not len(pairs):
        raise AssociationError(_explain_no_pairs(apr, vio, tolerance_s))
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
