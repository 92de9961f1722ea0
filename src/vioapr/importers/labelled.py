"""Data sets that label images with poses in a map, and had no tracker: 7-Scenes and Cambridge.

Their poses become ground truth; no frame has a tracker's pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vioapr.importers.base import (
    Walk,
    flat_names,
    no_poses,
    timed_gt,
    tracking_of,
)
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory


def labelled_walk(
    id_: str,
    split: str | None,
    source: Path,
    title: str,
    labels: Trajectory,
    images: Sequence[Path],
    rate_hz: float,
    intrinsics: Intrinsics,
) -> Walk:
    """A walk of labelled images, counted at a rate.

    Args:
        id_: The recording's id.
        split: Its split.
        source: For messages.
        title: The data set.
        labels: world_from_cam, a pose an image.
        images: Where they are.
        rate_hz: Frames per second.
        intrinsics: Of all images.
    """
    times = np.arange(len(labels)) / rate_hz
    poses = no_poses(len(labels))
    walk = Walk(
        id=id_,
        split=split,
        info=RecordingInfo(source=title, clock="frame-rate"),
        source=source,
        timestamp_s=times,
        image_names=flat_names([image.as_posix() for image in images]),
        images=images,
        vio_from_cam=poses,
        tracking=tracking_of(poses),
        intrinsics=intrinsics,
        gt=timed_gt(labels, times),
    )
    walk.note(f"no timestamps: counted at {rate_hz:g} frames per second")
    walk.note("no tracker: the poses are ground truth, and no frame has one of a tracker")
    return walk
