"""Poses of recordings in a point map, written as `evaluate` takes them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.images import probe_image
from vioapr.formats.stated_sigmas import Sigmas
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import group_cameras
from vioapr.mapping.joining import MAX_TILT_DEG
from vioapr.mapping.localization.cameras import pinhole
from vioapr.mapping.localization.localizer import Localized, PointMapLocalizer
from vioapr.mapping.localization.params import LocalizationParams
from vioapr.mapping.localization.point_map import PointMap
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.predictions import Predictions, write_predictions
from vioapr.scene.recording import FRAMES_FILE, IMAGES_FOLDER, Recording
from vioapr.scene.scene import Scene
from vioapr.schemas.point_map import CameraModel
from vioapr.trajectory import Trajectory
from vioapr.work.progress import Tick, ignore
from vioapr.work.steps import fingerprint

_UP_IN_VIO, _UP_IN_MAP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


class LocalizedWalk(NamedTuple):
    """A recording whose predictions are written.

    Attributes:
        id: The recording's.
        images: How many it has.
        localized: How many of them have a pose.
        tilted: How many poses were refused, because up is not where the tracker has it.
        can_be_evaluated: Whether there are ground truth, VIO and predictions.
        is_kept: Whether predictions were there, by the same map; the counts but of images are 0.
    """

    id: str
    images: int
    localized: int
    tilted: int
    can_be_evaluated: bool
    is_kept: bool


class LocalizedRecording(NamedTuple):
    """The images of one recording.

    Attributes:
        timestamp_s: Of the images that have a pose, in order.
        found: Their poses.
        tilted: How many poses were refused, because up is not where the tracker has it.
    """

    timestamp_s: list[float]
    found: list[Localized]
    tilted: int

    @property
    def predictions(self) -> Predictions | None:
        """As files hold them; None where no image has a pose."""
        if not self.found:
            return None
        poses = rigid.stack([each.world_from_cam for each in self.found])
        position_m, orientation_deg = np.array([each.sigmas for each in self.found]).T
        trajectory = Trajectory.from_arrays(self.timestamp_s, poses.translation_m, poses.quat_xyzw)
        return Predictions(trajectory, Sigmas(position_m, orientation_deg))


def localize_recording(
    localizer: PointMapLocalizer, recording: Recording, tick: Tick = ignore
) -> LocalizedRecording:
    """Find the poses of all images of a recording.

    Args:
        localizer: Of the place.
        recording: With or without VIO.
        tick: Called once an image.

    Raises:
        FormatError: It has no images, or the intrinsics of one are not known.
    """
    frames = recording.frames
    rows = np.flatnonzero(frames.has_image).tolist()
    if not rows:
        raise FormatError(recording.folder / IMAGES_FOLDER, "expected images, found none")

    cameras = cameras_of_frames(localizer.point_map, recording)

    def localize(row: int) -> Localized | None:
        if row not in cameras:
            return None
        return localizer.localize(recording.image_path(row), cameras[row])

    is_level = localizer.point_map.header.is_gravity_aligned and recording.info.is_gravity_aligned
    is_tracked = frames.has_pose & (frames.tracking != Tracking.LIMITED)
    result = LocalizedRecording([], [], 0)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for row, found in zip(rows, pool.map(localize, rows), strict=True):
            tick()
            if found is None:
                continue
            vio = frames.vio_from_cam.at(row)
            if is_level and is_tracked[row] and tilt_deg(found.world_from_cam, vio) > MAX_TILT_DEG:
                result = result._replace(tilted=result.tilted + 1)
                continue
            result.timestamp_s.append(float(frames.timestamp_s[row]))
            result.found.append(found)
    return result


def cameras_of_frames(place: PointMap, recording: Recording) -> dict[int, CameraModel]:
    """The cameras of a recording's images, by row of its frames.

    They are as the map has them: by every frame's own intrinsics, or shared by all images of about
    the same focal length. Phones that stabilize the lens state a principal point that moves by
    ten pixels; poses are consistent where map and image are treated alike. Where intrinsics are not
    known, those that the map found for images of this size serve.

    Returns:
        Without images that cannot be read.

    Raises:
        FormatError: The intrinsics of an image are not known, and the map has none of its size.
    """
    frames = recording.frames
    probes = {
        row: probe_image(recording.image_path(row))
        for row in np.flatnonzero(frames.has_image).tolist()
    }
    probes = {row: probe for row, probe in probes.items() if probe.obstacle is None}
    rows = list(probes)
    if not rows:
        return {}
    sizes = [(probe.width, probe.height) for probe in probes.values()]
    stated = np.column_stack([np.asarray(column) for column in frames.intrinsics.at(rows)])
    if place.header.shares_cameras:
        groups = group_cameras(sizes, stated)
        stated = np.array([[np.nan if v is None else v for v in group] for group in groups])
    cameras = {}
    for row, size, values in zip(rows, sizes, stated, strict=True):
        camera = pinhole(Intrinsics(*values), *size)
        same = [c for c in place.header.cameras if (c.width, c.height) == size]
        if camera is None and not same:
            raise FormatError(
                recording.folder / FRAMES_FILE,
                "expected a focal length, got none, and the map has no camera of this image's "
                f"size ({size[0]}x{size[1]}): import the recording with focal_px",
                int(frames.lines[row]),
            )
        cameras[row] = camera or same[0]
    return cameras


def tilt_deg(world_from_cam: Rigid3, vio_from_cam: Rigid3) -> float:
    """Angle between up as the tracker has it and the map's z, for an image of both poses."""
    up_in_cam = quaternion.rotate(quaternion.inverse(vio_from_cam.quat_xyzw), _UP_IN_VIO)
    up = quaternion.rotate(world_from_cam.quat_xyzw, up_in_cam)
    return float(np.degrees(np.arccos(np.clip(up @ _UP_IN_MAP, -1.0, 1.0))))


def localize_walks(
    place: PointMap,
    scene: Scene,
    ids: Sequence[str],
    folder: Path,
    name: str,
    *,
    params: LocalizationParams | None = None,
    overwrite: bool = False,
    tick: Tick = ignore,
) -> Iterator[LocalizedWalk]:
    """Localize recordings, one after the other, and write each as `evaluate` takes it.

    Predictions that are there, in the same map of the same images, are kept; see
    `write_predictions`, also for what is raised.

    Args:
        place: Where they were recorded.
        scene: Whose recordings.
        ids: Which.
        folder: Each recording's files go into a folder of its own in this one.
        name: Of the predictions' files, `apr_<name>.tum`.
        params: How images are localized.
        overwrite: Whether files may be replaced that prediction did not write, or by another
            model.
        tick: Called after every image.
    """
    localizer = PointMapLocalizer(place, params)
    done: dict[str, LocalizedRecording] = {}

    def predict(id_: str) -> Predictions | None:
        done[id_] = localize_recording(localizer, scene.recording(id_), tick)
        return done[id_].predictions

    digest = fingerprint(place.header.key, dataclasses.asdict(localizer.params))
    for walk in write_predictions(
        predict, scene, ids, folder, name, digest=digest, overwrite=overwrite, tick=tick
    ):
        found = done.get(walk.id, LocalizedRecording([], [], 0))
        yield LocalizedWalk(
            walk.id,
            int(scene.recording(walk.id).frames.has_image.sum()),
            len(found.found),
            found.tilted,
            walk.can_be_evaluated,
            walk.is_kept,
        )
