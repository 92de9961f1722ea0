"""The images of a scene that are to be mapped, with what the tracker said of them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, MappingError
from vioapr.files.images import probe_image
from vioapr.geometry.rigid import Rigid3
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
        fx: Median focal length, pixels; None if not known, as fy, cx and cy.
        fy: Likewise.
        cx: Principal point, from the left edge of the image.
        cy: From its top edge.
    """

    width: int
    height: int
    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None


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
        is_tracked: Shape (n,), whether the tracker had a pose that it did not doubt.
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
        max_rate_hz: So many a second at most; 0 for all.

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
    parts, unusable, digest = [], {}, hashlib.sha256()
    for index, id_ in enumerate(ids):
        recording = scene.recording(id_)
        if not recording.info.has_images:
            raise MappingError(
                f"{recording.folder}: this recording has no images, only poses: take it out of the "
                "splits to map the others"
            )
        part, problems = _collect(recording, index, max_rate_hz, digest)
        unusable |= problems
        parts.append(part)
    return _join(parts, ids, digest.hexdigest(), unusable)


class _Part(NamedTuple):
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


def _collect(
    recording: Recording, index: int, max_rate_hz: float, digest: Any
) -> tuple[_Part, dict[str, str]]:
    frames = recording.frames
    path = recording.folder / FRAMES_FILE
    digest.update(f"{recording.id} {recording.info}\n".encode() + path.read_bytes())
    rows, sizes, unusable = [], [], {}
    for row in _thin(frames, max_rate_hz):
        image = recording.image_path(row)
        name = f"{recording.id}/{IMAGES_FOLDER}/{frames.image[row]}"
        probe = probe_image(image)
        if probe.problem is not None:
            unusable[name] = probe.problem
            continue
        status = image.stat()
        digest.update(f"{name} {status.st_size} {status.st_mtime_ns}\n".encode())
        rows.append(row)
        sizes.append((probe.width, probe.height))
    if not rows:
        first = next(iter(unusable.items()), None)
        example = f", e.g. {first[0]}: {first[1]}" if first else ""
        raise FormatError(path, f"expected images, got none that can be read{example}")
    kept = frames.at_rows(np.array(rows))
    part = _Part(
        [f"{recording.id}/{IMAGES_FOLDER}/{name}" for name in kept.image],
        np.full(len(kept), index),
        kept.timestamp_s,
        # Counted over all frames: where the tracker began anew may be between those kept.
        frames.tracking_world[rows].astype(np.intp),
        kept.vio_from_cam,
        kept.has_pose & (kept.tracking != Tracking.LIMITED) & (not recording.info.is_diverging),
        np.full(len(kept), recording.info.is_metric),
        np.full(len(kept), recording.info.is_gravity_aligned),
        _group_cameras(sizes, np.column_stack([np.asarray(c) for c in kept.intrinsics])),
        np.array(rows, dtype=np.intp),
    )
    return part, unusable


def _thin(frames: Frames, max_rate_hz: float) -> list[int]:
    """Frames with an image, so far apart in time as the rate says."""
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


def _group_cameras(sizes: list[tuple[int, int]], values: NDArray[np.float64]) -> list[CameraGroup]:
    """The camera of each image; images of about the same focal length share one."""
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


def _join(
    parts: list[_Part], ids: tuple[str, ...], fingerprint: str, unusable: dict[str, str]
) -> MapImages:
    worlds, first = [], 0
    for part in parts:
        worlds.append(part.tracking_world + first)
        first = int(worlds[-1].max()) + 1
    groups = [_with_recording(part, k) for k, part in enumerate(parts)]
    keys = [key for group in groups for key in group]
    unique = list(dict.fromkeys(keys))
    number = {key: k for k, key in enumerate(unique)}
    return MapImages(
        tuple(name for part in parts for name in part.names),
        np.concatenate([part.recording for part in parts]),
        ids,
        np.concatenate([part.timestamp_s for part in parts]),
        np.concatenate(worlds),
        Rigid3(
            np.concatenate([part.vio_from_cam.translation_m for part in parts]),
            np.concatenate([part.vio_from_cam.quat_xyzw for part in parts]),
        ),
        np.concatenate([part.is_tracked for part in parts]),
        np.concatenate([part.is_metric for part in parts]),
        np.concatenate([part.is_level for part in parts]),
        np.array([number[key] for key in keys], dtype=np.intp),
        tuple(camera for _, camera in unique),
        fingerprint,
        np.concatenate([part.frame_row for part in parts]),
        unusable,
    )


def _with_recording(part: _Part, index: int) -> list[tuple[int, CameraGroup]]:
    """What tells cameras apart: known ones are a recording's own, unknown ones go by their size.

    So the test recordings profit from what the training recordings find of an unknown one.
    """
    return [(index if camera.fx is not None else -1, camera) for camera in part.cameras]
