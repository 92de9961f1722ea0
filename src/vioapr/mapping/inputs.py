"""The images of a scene that are to be mapped, with what the tracker said of them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, MappingError
from vioapr.files.images import probe_image
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_map
from vioapr.scene.frames import Frames, Tracking
from vioapr.scene.recording import FRAMES_FILE, IMAGES_FOLDER, Recording
from vioapr.scene.scene import SCENE_FILE, Scene

FOCAL_STEP = 0.02
"""Frames whose focal lengths differ by less share a camera: autofocus changes it by a percent."""


class CameraGroup(NamedTuple):
    """Images taken by one camera with one setting.

    Attributes:
        width: Pixels.
        height: Pixels.
        fx: Median focal length along x, pixels; None if not known, as fy, cx and cy.
        fy: Along y.
        cx: Principal point, from the left edge of the image.
        cy: From its top edge.
    """

    width: int
    height: int
    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None


class Located(NamedTuple):
    """Where images are, as far as VIO and matches tell.

    Attributes:
        world_from_cam: Shape (n,), y up, NaN where unknown.
        world: Shape (n,); images of the same number are in the same world.
    """

    world_from_cam: Rigid3
    world: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class MapImages:
    """Images of several recordings, n of them, recording by recording and in order of time.

    Attributes:
        names: Paths below the scene's `recordings`, e.g. "walk1/images/000001.jpg".
        recording: Shape (n,), the recording of each, an index into `ids`.
        ids: The recordings' ids.
        timestamp_s: Shape (n,), s, on the recording's clock.
        tracking_world: Shape (n,), integers, different for all tracking worlds of all
            recordings.
        vio_from_cam: Shape (n,), NaN where there is none.
        is_tracked: Shape (n,), whether there is a pose, neither limited nor of a tracker that
            diverges.
        is_metric: Shape (n,), whether VIO positions are in metres.
        is_level: Shape (n,), whether the tracking world's y axis is up.
        camera: Shape (n,), the camera of each, an index into `cameras`.
        cameras: The cameras.
        fingerprint: Changes with every file that the images and poses came from.
        frame_row: Shape (n,), which frame of its recording an image is.
        unusable: Names of images that cannot be read, and why; they are not among `names`.
    """

    names: tuple[str, ...]
    recording: NDArray[np.intp]
    ids: tuple[str, ...]
    timestamp_s: NDArray[np.float64]
    tracking_world: NDArray[np.intp]
    vio_from_cam: Rigid3
    is_tracked: NDArray[np.bool_]
    is_metric: NDArray[np.bool_]
    is_level: NDArray[np.bool_]
    camera: NDArray[np.intp]
    cameras: tuple[CameraGroup, ...]
    fingerprint: str
    frame_row: NDArray[np.intp]
    unusable: dict[str, str]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def has_vio(self) -> NDArray[np.bool_]:
        """Shape (n,), the images with a pose of the tracker."""
        return self.vio_from_cam.is_known

    @property
    def by_vio(self) -> Located:
        """Where VIO says that they are, each tracking world by itself."""
        return Located(self.vio_from_cam, self.tracking_world)

    def rows_of(self, id_: str) -> NDArray[np.intp]:
        """Rows of one recording, in order of time."""
        return np.flatnonzero(self.recording == self.ids.index(id_))

    def rows_of_all(self, ids: Sequence[str]) -> NDArray[np.intp]:
        """Rows of several recordings, in order."""
        return np.flatnonzero(np.isin(self.recording, [self.ids.index(id_) for id_ in ids]))


def collect_images(scene: Scene, max_rate_hz: float = 0.0) -> MapImages:
    """The images of the scene's training and test recordings.

    Args:
        scene: The scene.
        max_rate_hz: Largest number of images a second of each; 0 for all.

    Raises:
        FormatError: A recording is broken, or has no image that can be read.
        MappingError: There is no training recording, or none has images.
    """
    ids = tuple(id_ for split in ("train", "test") for id_ in scene.splits.get(split, ()))
    if not scene.splits.get("train"):
        raise MappingError(
            f"{scene.folder / SCENE_FILE}: expected training recordings in splits.train, got none: "
            "a map is made of them"
        )
    parts, digest = [], hashlib.sha256()
    for index, id_ in enumerate(ids):
        recording = scene.recording(id_)
        if not recording.info.has_images:
            raise MappingError(
                f"{recording.folder}: this recording has no images, only poses: take it out of the "
                "splits to map the others"
            )
        parts.append(read_images(recording, index, max_rate_hz))
        digest.update(parts[-1].identity)
    return join_recordings(parts, ids, digest.hexdigest())


class RecordingImages(NamedTuple):
    """Images of one recording, in order of time; see `MapImages`.

    Attributes:
        names: Paths below the scene's `recordings`.
        recording: The recording's index, for every image.
        timestamp_s: Shape (n,).
        tracking_world: Shape (n,), counted from 0 within the recording.
        vio_from_cam: Shape (n,).
        is_tracked: Shape (n,).
        is_metric: Shape (n,).
        is_level: Shape (n,).
        cameras: The camera of every image.
        frame_row: Shape (n,).
        unusable: Names of images that cannot be read, and why.
        identity: Differs where any file is another.
    """

    names: list[str]
    recording: NDArray[np.intp]
    timestamp_s: NDArray[np.float64]
    tracking_world: NDArray[np.intp]
    vio_from_cam: Rigid3
    is_tracked: NDArray[np.bool_]
    is_metric: NDArray[np.bool_]
    is_level: NDArray[np.bool_]
    cameras: list[CameraGroup]
    frame_row: NDArray[np.intp]
    unusable: dict[str, str]
    identity: bytes


def read_images(recording: Recording, index: int, max_rate_hz: float) -> RecordingImages:
    """Look at a recording's images; they are not decoded.

    Args:
        recording: The recording.
        index: Its index among those to be mapped.
        max_rate_hz: Largest number of images a second; 0 for all.

    Raises:
        FormatError: No image can be read.
    """
    frames = recording.frames
    path = recording.folder / FRAMES_FILE
    identity = [f"{recording.id} {recording.info}\n".encode() + path.read_bytes()]
    rows, sizes, unusable = [], [], {}
    for row in thin_frames(frames, max_rate_hz):
        image = recording.image_path(row)
        name = f"{recording.id}/{IMAGES_FOLDER}/{frames.image[row]}"
        probe = probe_image(image)
        if probe.obstacle is not None:
            unusable[name] = probe.obstacle
            continue
        status = image.stat()
        identity.append(f"{name} {status.st_size} {status.st_mtime_ns}\n".encode())
        rows.append(row)
        sizes.append((probe.width, probe.height))
    if not rows:
        first = next(iter(unusable.items()), None)
        example = f", e.g. {first[0]}: {first[1]}" if first else ""
        raise FormatError(path, f"expected images, got none that can be read{example}")
    kept = frames.at_rows(np.array(rows))
    return RecordingImages(
        [f"{recording.id}/{IMAGES_FOLDER}/{name}" for name in kept.image],
        np.full(len(kept), index),
        kept.timestamp_s,
        # Counted over all frames: the tracker may have restarted between those kept.
        frames.tracking_world[rows].astype(np.intp),
        kept.vio_from_cam,
        kept.has_pose & (kept.tracking != Tracking.LIMITED) & (not recording.info.is_diverging),
        np.full(len(kept), recording.info.is_metric),
        np.full(len(kept), recording.info.is_gravity_aligned),
        group_cameras(sizes, np.column_stack([np.asarray(c) for c in kept.intrinsics])),
        np.array(rows, dtype=np.intp),
        unusable,
        b"".join(identity),
    )


def thin_frames(frames: Frames, max_rate_hz: float) -> list[int]:
    """Choose rows of frames with an image, so that there are no more a second than the rate."""
    rows = np.flatnonzero(frames.has_image).tolist()
    if max_rate_hz == 0:
        return rows
    # A little less than the period: clocks jitter, and frames at just this rate are all wanted.
    period_s = 0.9 / max_rate_hz
    kept: list[int] = []
    for row in rows:
        if not kept or frames.timestamp_s[row] - frames.timestamp_s[kept[-1]] >= period_s:
            kept.append(row)
    return kept


def group_cameras(sizes: list[tuple[int, int]], values: NDArray[np.float64]) -> list[CameraGroup]:
    """Find the camera of each image; images of about the same focal length share one.

    Args:
        sizes: Width and height of each image file.
        values: Intrinsics as the frames have them: width, height, fx, fy, cx, cy; shape (n, 6),
            NaN where not known.
    """
    # Intrinsics are of the image as stored; a file of another size is scaled by its width.
    scale = np.array([width for width, _ in sizes]) / np.where(
        np.isfinite(values[:, 0]), values[:, 0], [width for width, _ in sizes]
    )
    intrinsics = values[:, 2:] * scale[:, None]
    keys = [
        (size, round(math.log(row[0]) / FOCAL_STEP) if np.isfinite(row[0]) else None)
        for size, row in zip(sizes, intrinsics, strict=True)
    ]
    groups = {}
    for key in dict.fromkeys(keys):
        members = intrinsics[[k == key for k in keys]]
        known = [None] * 4 if key[1] is None else np.median(members, axis=0).tolist()
        groups[key] = CameraGroup(*key[0], *known)
    return [groups[key] for key in keys]


def join_recordings(
    parts: list[RecordingImages], ids: tuple[str, ...], fingerprint: str
) -> MapImages:
    """Put the images of all recordings together.

    Args:
        parts: Of every recording.
        ids: The recordings' ids.
        fingerprint: Of all files.
    """
    worlds, first = [], 0
    for part in parts:
        worlds.append(part.tracking_world + first)
        first = int(worlds[-1].max()) + 1
    # Known cameras are a recording's own, unknown ones go by their size: so the test recordings
    # profit from what the training recordings find of an unknown one.
    cameras = [
        (index if camera.fx is not None else -1, camera)
        for index, part in enumerate(parts)
        for camera in part.cameras
    ]
    unique = list(dict.fromkeys(cameras))
    number = {key: k for k, key in enumerate(unique)}
    return MapImages(
        names=tuple(name for part in parts for name in part.names),
        recording=np.concatenate([part.recording for part in parts]),
        ids=ids,
        timestamp_s=np.concatenate([part.timestamp_s for part in parts]),
        tracking_world=np.concatenate(worlds),
        vio_from_cam=tree_map(
            lambda *columns: np.concatenate(columns), *(part.vio_from_cam for part in parts)
        ),
        is_tracked=np.concatenate([part.is_tracked for part in parts]),
        is_metric=np.concatenate([part.is_metric for part in parts]),
        is_level=np.concatenate([part.is_level for part in parts]),
        camera=np.array([number[key] for key in cameras], dtype=np.intp),
        cameras=tuple(camera for _, camera in unique),
        fingerprint=fingerprint,
        frame_row=np.concatenate([part.frame_row for part in parts]),
        unusable={name: why for part in parts for name, why in part.unusable.items()},
    )
