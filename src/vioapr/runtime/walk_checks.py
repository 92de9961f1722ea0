"""What looks wrong with a walk that an exported file localized, and how its camera is mounted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vioapr.errors import AssociationError
from vioapr.formats.body_from_cam import estimate_body_from_cam
from vioapr.formats.pair_checks import Track
from vioapr.formats.track_warnings import TrackWarning
from vioapr.formats.walk_checks import check_walk
from vioapr.geometry.hand_eye import HandEye
from vioapr.runtime.localizer import Located, OnnxLocalizer
from vioapr.runtime.walk import LocalizedWalk, WalkFrames, localize
from vioapr.scene.cameras import describe_other_camera
from vioapr.schemas.contract import Contract

MOUNT_FRAMES = 300
"""How many frames, spread over a walk, tell how its camera is mounted."""

_PREDICTIONS = "the file's predictions"


def mount_frames(frames: WalkFrames) -> WalkFrames:
    """The frames to estimate the mount by."""
    count = min(len(frames), MOUNT_FRAMES)
    return frames.at_rows(np.unique(np.linspace(0, len(frames) - 1, count).astype(np.intp)))


def estimate_mount(
    localizer: OnnxLocalizer, frames: WalkFrames, tick: Callable[[Located], object] | None = None
) -> HandEye:
    """Estimate body_from_cam by what the regressor in a file says of some frames.

    Args:
        localizer: One that has seen no frame; not to be used for localizing after this.
        frames: From `mount_frames`, whose `vio_from_cam` are really vio_from_body.
        tick: Called with every answer.

    Raises:
        FileError: An image cannot be read.
        AssociationError: The walk does not tell.
    """
    walk = localize(localizer, frames, tick)
    predictions, vio = walk.predictions, frames.vio
    if predictions is None or vio is None:
        raise AssociationError("vio_from_cam: expected frames with an image and a pose, got none")
    return estimate_body_from_cam(vio, predictions)


def check_camera(frames: WalkFrames, contract: Contract) -> list[TrackWarning]:
    """Find that images are of another camera than a file's regressor knows."""
    camera = np.zeros((0, 4)) if frames.camera is None else frames.camera
    expected = contract.regressor.camera
    problem = describe_other_camera(camera, expected if isinstance(expected, tuple) else None)
    if problem is None:
        return []
    remedy = "take a file that was made from this camera's recordings"
    return [TrackWarning("camera", problem, remedy)]


def check_localized(
    walk: LocalizedWalk, vio_path: str, gt_path: str = "", *, is_file: bool = True
) -> list[TrackWarning]:
    """Find what looks wrong with the tracker's poses of a localized walk.

    Args:
        walk: Frames and answers.
        vio_path: Where the poses are from.
        gt_path: And ground truth, if there is any.
        is_file: Whether the poses are from a trajectory file, which can be converted, rather than
            from a recording.

    Returns:
        Possibly none. A regressor that knows another place gives no warning: it may just be bad.
    """
    predictions, vio, gt = walk.predictions, walk.frames.vio, walk.frames.gt
    if predictions is None or vio is None:
        return []
    found = check_walk(
        [Track(_PREDICTIONS, "apr", predictions)],
        [Track(vio_path, "vio", vio)],
        None if gt is None else Track(gt_path or "ground truth", "gt", gt),
    )
    # What the exported file predicts is in our convention, and no warning can mend it.
    found = [
        warning
        for warning in found
        if warning.kind != "no-fit" and not warning.sentence.startswith(_PREDICTIONS)
    ]
    if is_file:
        return found
    mend = "mend the poses where they are from, and import them again"
    return [w if w.kind == "device" else replace(w, remedy=mend) for w in found]
