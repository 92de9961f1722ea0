"""The tracker's poses and the ground truth that a user names: turned to the camera, and checked."""

from __future__ import annotations

from pathlib import Path

from vioapr.errors import SuspectTrackError
from vioapr.formats.pair_checks import Track
from vioapr.formats.walk_checks import check_walk
from vioapr.importers.base import Walk
from vioapr.trajectory import Trajectory


def check_given_tracks(
    walk: Walk, poses: tuple[Path, Trajectory], gt: tuple[Path, Trajectory], *, strict: bool
) -> None:
    """Say what looks wrong with two tracks of one walk.

    Args:
        walk: Findings are added to it.
        poses: The tracker's, with their file.
        gt: Ground truth, with its file.
        strict: Whether what looks wrong is an error.

    Raises:
        SuspectTrackError: Something looks wrong, and `strict`.
    """
    vio_track, gt_track = Track(str(poses[0]), "vio", poses[1]), Track(str(gt[0]), "gt", gt[1])
    for warning in check_walk([], [vio_track], gt_track):
        if strict:
            raise SuspectTrackError(str(warning))
        walk.warn(f"{warning.kind}: {warning}")
