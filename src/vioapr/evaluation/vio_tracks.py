"""Odometry beside its ground truth: read from files of trajectories and from scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.formats.registry import read_trajectory
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.scene.walks import WalkFiles, walks_at
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, associate, nearest_rows

MAX_GT_GAP_S = 0.25
"""Between ground truth poses further apart than this, nothing is interpolated."""


@dataclass(frozen=True, eq=False)
class VioTrack:
    """One tracker's poses of one walk, and the ground truth of the same moments.

    Attributes:
        set_name: Name of the set, e.g. the scene's.
        walk: Name of the walk, e.g. the recording's.
        vio: Name of the tracker.
        timestamp_s: Shape (n,), increasing; where the files have no clock, the frame's number
            (`is_timed` false).
        gt_world_from_cam: Shape (n,).
        vio_from_cam: Shape (n,), in the tracker's own world.
        tracking_world: Shape (n,), integers: it changes where the tracker lost its world and
            began another, so that poses before and after have nothing in common.
        frames_without_gt: Frames of the tracker left out because no ground truth is near.
        frames_lost: Frames at which the tracker had no pose.
        is_timed: Whether the timestamps are seconds of a clock.
    """

    set_name: str
    walk: str
    vio: str
    timestamp_s: NDArray[np.float64]
    gt_world_from_cam: Rigid3
    vio_from_cam: Rigid3
    tracking_world: NDArray[np.integer]
    frames_without_gt: int = 0
    frames_lost: int = 0
    is_timed: bool = True

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.set_name}/{self.walk} {self.vio}"


@dataclass(frozen=True)
class VioWalk:
    """A walk that was found and not yet read.

    Attributes:
        gt: File of its ground truth.
        files: All files that it is read from, but images.
        read: Reads its trackers' tracks; the argument is the largest difference of timestamps
            within a frame, s.
    """

    gt: Path
    files: tuple[Path, ...]
    read: Callable[[float], list[VioTrack]]


def make_track(
    set_name: str,
    walk: str,
    vio_name: str,
    vio: Trajectory,
    gt: Trajectory,
    *,
    tracking_world: NDArray[np.integer] | None = None,
    frames_lost: int = 0,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> VioTrack:
    """Bring ground truth to the tracker's moments.

    Where both have a clock, ground truth is interpolated at the tracker's timestamps, between
    poses at most `MAX_GT_GAP_S` apart or within the tolerance of one. Otherwise image names
    pair the frames.

    Raises:
        AssociationError: No frame of the tracker has ground truth.
    """
    if vio.is_timed and gt.is_timed:
        rows, framed = interpolate_gt(vio, gt, tolerance_s)
    else:
        pairs = associate(vio, gt)
        rows = pairs.left_rows
        is_in_order = bool((np.diff(pairs.right_rows) > 0).all())
        framed = gt.at_rows(pairs.right_rows) if len(pairs) and is_in_order else None
    if framed is None:
        raise AssociationError(
            f"{set_name}/{walk}: no frame of {vio_name} has ground truth: "
            "no common times or names, or names in another order"
        )
    worlds = np.zeros(len(vio), dtype=np.intp) if tracking_world is None else tracking_world
    return VioTrack(
        set_name,
        walk,
        vio_name,
        vio.timestamp_s[rows],
        framed.target_from_source,
        vio.target_from_source.at(rows),
        worlds[rows],
        len(vio) - len(rows),
        frames_lost,
        vio.is_timed and gt.is_timed,
    )


def interpolate_gt(
    vio: Trajectory, gt: Trajectory, tolerance_s: float
) -> tuple[NDArray[np.intp], Trajectory | None]:
    """Rows of the tracker that have ground truth, and ground truth at their times.

    Args:
        vio: With a clock.
        gt: On the same clock.
        tolerance_s: Frames this near to a pose have ground truth, and so have those between
            poses at most `MAX_GT_GAP_S` apart.

    Returns:
        Rows, shape (n,), and ground truth of n poses; None instead of no poses.
    """
    times, known = vio.timestamp_s, gt.timestamp_s
    is_near = np.abs(known[nearest_rows(times, known)] - times) <= tolerance_s + 1e-9
    after = np.searchsorted(known, times).clip(1, max(len(known) - 1, 1)).clip(max=len(known) - 1)
    gap = known[after] - known[np.maximum(after - 1, 0)]
    is_inside = (times >= known[0]) & (times <= known[-1])
    rows = np.flatnonzero(is_near | (is_inside & (gap <= MAX_GT_GAP_S)))
    if not len(rows):
        return rows, None
    # Frames within the tolerance before the first or after the last pose take that pose.
    at = np.clip(times[rows], known[0], known[-1])
    return rows, gt.interpolate(at)


def find_vio_walks(paths: Sequence[Path]) -> list[VioWalk]:
    """All walks at or below the given paths, in natural order.

    A path is a scene (its recordings that have ground truth), or one that `scene.walks.walks_at`
    takes.

    Raises:
        VioAprError: No path is given, or one holds no walk.
    """
    if not paths:
        raise ParameterError("paths: expected at least one scene or folder of walks, got none")
    found: dict[Path, VioWalk] = {}
    for path in paths:
        if (path / SCENE_FILE).is_file():
            walks = find_walks_of_scene(Scene.open(path))
            if not walks:
                raise FormatError(
                    path,
                    "expected ground truth gt/<recording>.tum, found none: make it with vioapr map",
                )
        else:
            walks = [
                VioWalk(files.gt, files.paths, partial(_read_files, files))
                for files in walks_at(path)
                if files.vios
            ]
        if not walks:
            raise FormatError(
                path,
                "expected a scene, or walks with ground truth and odometry: gt.* beside "
                "vio_<name>.*, or <walk>_gt.* beside <walk>_<name>.*; found none",
            )
        found |= {walk.gt.resolve(): walk for walk in walks}
    return list(found.values())


def find_walks_of_scene(scene: Scene) -> list[VioWalk]:
    """All recordings of a scene that have ground truth."""
    files = tuple(scene.tables())
    return [
        VioWalk(scene.gt_path(id_), files, partial(_read_recording, scene, id_))
        for id_ in scene.recording_ids
        if scene.gt_path(id_).exists()
    ]


def _read_recording(scene: Scene, id_: str, tolerance_s: float) -> list[VioTrack]:
    recording, gt = scene.recording(id_), scene.gt(id_)
    assert gt is not None  # only such recordings are asked for
    frames = recording.frames
    name = (recording.info.tracker or "vio").lower()
    world = frames.tracking_world[frames.has_pose]
    lost = int((~frames.has_pose).sum())
    vio = frames.to_trajectory()
    return [
        make_track(
            scene.name, id_, name, vio, gt,
            tracking_world=world, frames_lost=lost, tolerance_s=tolerance_s,
        )
    ]  # fmt: skip


def _read_files(files: WalkFiles, tolerance_s: float) -> list[VioTrack]:
    gt = read_trajectory(files.gt)
    return [
        make_track(
            files.set_name, files.walk, name, read_trajectory(path), gt, tolerance_s=tolerance_s
        )
        for name, path in files.vios.items()
    ]
