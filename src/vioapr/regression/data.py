"""The images of recordings and their poses, from which a network learns."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileMissingError, TrainingError
from vioapr.regression.cache import cached_images
from vioapr.scene.cameras import relative_camera
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import CACHE_FOLDER, Scene
from vioapr.trajectory import poses_of_frames


@dataclass(frozen=True, eq=False)
class PosedFrames:
    """The frames of one recording that have an image and ground truth, n of them.

    Attributes:
        scene: The scene's name.
        recording: The recording's id.
        paths: Of the images.
        timestamp_s: Shape (n,).
        position_m: Shape (n, 3), of the camera in the world.
        quat_xyzw: Shape (n, 4), world_from_cam.
        camera: Shape (n, 4), fx, fy, cx, cy over the image's width and height; NaN if unknown.
    """

    scene: str
    recording: str
    paths: tuple[Path, ...]
    timestamp_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    camera: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.timestamp_s)


def posed_frames(scene: Scene, id_: str) -> PosedFrames:
    """Find the frames of a recording that have an image and ground truth.

    Raises:
        FileMissingError: It has no ground truth.
        FileError: The recording or its ground truth is broken.
    """
    gt = scene.gt(id_)
    if gt is None:
        problem = "expected ground truth, found none: run vioapr map, or import it"
        raise FileMissingError(scene.gt_path(id_), problem)
    frames = scene.recording(id_).frames
    rows = np.flatnonzero(frames.has_image)
    poses = poses_of_frames(gt, frames.timestamp_s[rows])
    has_gt = poses.is_known
    poses, rows = poses.at(has_gt), rows[has_gt]
    folder = scene.recording_folder(id_) / IMAGES_FOLDER
    chosen = frames.at_rows(rows)
    return PosedFrames(
        scene.name,
        id_,
        tuple(folder / name for name in chosen.image),
        chosen.timestamp_s,
        poses.translation_m,
        poses.quat_xyzw,
        relative_camera(chosen.intrinsics),
    )


def split_frames(
    scenes: Sequence[Scene], split: str, recordings: Sequence[str] | None = None
) -> list[PosedFrames]:
    """Find the posed frames of all recordings of a split, or of those of some ids.

    Raises:
        TrainingError: There is none, an id is not of the split, or no frame has ground truth.
        FileError: A recording is broken.
    """
    known = {id_ for scene in scenes for id_ in scene.splits.get(split, ())}
    for id_ in recordings or ():
        if id_ not in known:
            raise TrainingError(
                f"recording {id_!r}: expected one of the split {split!r}, "
                f"which has {', '.join(sorted(known)) or 'none'}"
            )
    found = [
        posed_frames(scene, id_)
        for scene in scenes
        for id_ in scene.splits.get(split, ())
        if recordings is None or id_ in recordings
    ]
    if not any(map(len, found)):
        names = ", ".join(str(scene.folder) for scene in scenes)
        raise TrainingError(
            f"{names}: expected images with ground truth in the split {split!r}, found none"
        )
    return [frames for frames in found if len(frames)]


@dataclass(frozen=True, eq=False)
class Samples:
    """Images of many recordings and their poses, n of them, ready to be drawn from.

    Attributes:
        images: Of each recording, shape (n_r, resize, resize, 3).
        recording: Shape (n,), which array of `images` a sample is in.
        row: Shape (n,), and where in it.
        scene: Shape (n,), number of the sample's scene.
        position_m: Shape (n, 3).
        quat_xyzw: Shape (n, 4), world_from_cam.
        camera: Shape (n, 4), see `PosedFrames`.
        fingerprint: Changes with the samples.
    """

    images: tuple[NDArray[np.uint8], ...]
    recording: NDArray[np.int64]
    row: NDArray[np.int64]
    scene: NDArray[np.int64]
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    camera: NDArray[np.float64]
    fingerprint: str

    def __len__(self) -> int:
        return len(self.row)

    def read(self, index: NDArray[np.int64]) -> NDArray[np.uint8]:
        """Read some images, shape (m, resize, resize, 3)."""
        size = self.images[0].shape[1:]
        batch = np.empty((len(index), *size), dtype=np.uint8)
        for place, (recording, row) in enumerate(
            zip(self.recording[index], self.row[index], strict=True)
        ):
            batch[place] = self.images[recording][row]
        return batch


def load_samples(
    scenes: Sequence[Scene],
    frames: Sequence[PosedFrames],
    resize: int,
    tick: Callable[[], object] = lambda: None,
) -> Samples:
    """Decode the images of some recordings, or find them decoded.

    Args:
        scenes: In the order of their numbers; their folders hold the caches.
        frames: Of the recordings, at least one.
        resize: Size of the images.
        tick: Called after every image.

    Raises:
        FileError: An image is missing or broken, or the disk is full.
    """
    folder_of = {scene.name: scene.folder for scene in scenes}
    number_of = {scene.name: number for number, scene in enumerate(scenes)}
    images = tuple(
        cached_images(
            one.paths,
            resize,
            folder_of[one.scene] / CACHE_FOLDER / f"images-{resize}" / f"{one.recording}.npy",
            tick,
        )
        for one in frames
    )
    lengths = [len(one) for one in frames]
    position_m = np.concatenate([one.position_m for one in frames])
    quat_xyzw = np.concatenate([one.quat_xyzw for one in frames])
    digest = hashlib.sha256()
    for one in frames:
        digest.update(f"{one.scene}/{one.recording} {[p.name for p in one.paths]}".encode())
    for values in (position_m, quat_xyzw):
        digest.update(np.ascontiguousarray(values).tobytes())
    return Samples(
        images,
        np.repeat(np.arange(len(frames)), lengths),
        np.concatenate([np.arange(length) for length in lengths]),
        np.repeat([number_of[one.scene] for one in frames], lengths),
        position_m,
        quat_xyzw,
        np.concatenate([one.camera for one in frames]),
        digest.hexdigest(),
    )
