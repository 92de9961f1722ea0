"""A walk to draw content into: its pictures, and where the camera was by several estimates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3
from vioapr.report.overlay.canvas import Pinhole
from vioapr.scene.recording import Recording
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, poses_of_frames

RAW, FUSED, TRUTH = "raw", "fused", "truth"
_LOOKS_AT_THE_SKY = 0.5
"""Median of z in the cameras' directions above which z is not up."""


@dataclass(frozen=True, eq=False)
class OverlayWalk:
    """The frames of a recording that have a picture, n of them.

    Attributes:
        name: Of the walk.
        timestamp_s: Shape (n,), s.
        images: Their files.
        cameras: Of the pictures.
        poses: world_from_cam by estimate, `RAW`, `FUSED` and `TRUTH` as far as there are any, in
            this order; shape (n,), NaN where an estimate has none.
        up: The direction up in the world, unit, shape (3,): z, unless the cameras deny it.
        quarter_turns: By how many quarters, counterclockwise, pictures are turned to be upright.
    """

    name: str
    timestamp_s: NDArray[np.float64]
    images: tuple[Path, ...]
    cameras: tuple[Pinhole, ...]
    poses: dict[str, Rigid3[FloatArray]]
    up: FloatArray
    quarter_turns: int

    def __len__(self) -> int:
        return len(self.timestamp_s)

    @property
    def reference(self) -> Rigid3[FloatArray]:
        """The truth, or the fused poses where there is none."""
        return self.poses.get(TRUTH, self.poses[FUSED])


def read_overlay_walk(
    recording: Recording,
    fused: Trajectory,
    raw: Trajectory | None = None,
    truth: Trajectory | None = None,
    focal_px: float | None = None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> OverlayWalk:
    """Bring pictures and estimates of a walk together.

    Args:
        recording: The walk.
        fused: world_from_cam of its frames.
        raw: The predictions that they were fused from; between them the tracker carries the last
            one on, as an app does.
        truth: Ground truth.
        focal_px: Focal length for frames that have none, pixels of the pictures.
        tolerance_s: Largest difference of timestamps between a frame and its pose, s.

    Raises:
        FormatError: No frame has a picture, or a frame's focal length is not known.
        AssociationError: No frame has a pose.
    """
    rows = np.flatnonzero(recording.frames.has_image)
    if not len(rows):
        raise FormatError(recording.folder, "expected frames with images, found none")
    frames = recording.frames.at_rows(rows)
    images = tuple(recording.image_path(int(row)) for row in rows)
    poses: dict[str, Rigid3[FloatArray]] = {}
    for name, track in ((RAW, raw), (FUSED, fused), (TRUTH, truth)):
        if track is None:
            continue
        found = poses_of_frames(track, frames.timestamp_s, frames.image, tolerance_s)
        if not found.is_known.any():
            raise AssociationError(
                f"{recording.folder}: expected {name} poses of its frames, found none at their "
                f"times: {frames.timestamp_s[0]:.3f} to {frames.timestamp_s[-1]:.3f} s here, "
                f"{track.timestamp_s[0]:.3f} to {track.timestamp_s[-1]:.3f} s there; are they of "
                "another walk?"
            )
        poses[name] = found
    if RAW in poses:
        poses[RAW] = carry_on(poses[RAW], frames.vio_from_cam, frames.tracking_world)
    cameras = _cameras(recording, rows, images, focal_px)
    known = poses[FUSED].at(poses[FUSED].is_known)
    up = find_up(known)
    turns = _find_quarter_turns(known, up)
    return OverlayWalk(recording.id, frames.timestamp_s, images, cameras, poses, up, turns)


def find_up(world_from_cam: Rigid3[FloatArray]) -> FloatArray:
    """Find which way is up, as not every map's z is: of data sets, and without gravity.

    Nobody films the sky all the time: if the cameras look along +z, up is what is up in pictures.

    Args:
        world_from_cam: Known poses, shape (n,).

    Returns:
        Unit, world coordinates, shape (3,).
    """
    rotation = quaternion.to_matrix(world_from_cam.quat_xyzw)
    if np.median(rotation[:, 2, 2]) < _LOOKS_AT_THE_SKY:
        return np.array([0.0, 0.0, 1.0])
    up = -rotation[:, :, 1].mean(axis=0)
    return up / np.linalg.norm(up)


def carry_on(
    world_from_cam: Rigid3[FloatArray],
    vio_from_cam: Rigid3[FloatArray],
    tracking_world: NDArray[np.integer],
) -> Rigid3[FloatArray]:
    """Fill frames without a pose: the tracker carries the last one on.

    Args:
        world_from_cam: Shape (n,), NaN where not known.
        vio_from_cam: The tracker's poses, shape (n,), NaN where lost.
        tracking_world: Which tracking world a frame is in, shape (n,).

    Returns:
        Shape (n,), NaN before the first pose and where the tracker does not lead on from one.
    """
    usable = world_from_cam.is_known & vio_from_cam.is_known
    rows = np.arange(len(usable))
    last = np.maximum.accumulate(np.where(usable, rows, -1))
    leads = (last >= 0) & (tracking_world == tracking_world[last])
    world_from_vio = world_from_cam.at(last) @ vio_from_cam.at(last).inverse()
    carried = world_from_vio @ vio_from_cam
    known = world_from_cam.is_known[:, None]
    filled = (
        np.where(known, own, np.where(leads[:, None], other, np.nan))
        for own, other in zip(world_from_cam, carried, strict=True)
    )
    return Rigid3(*filled)


def _cameras(
    recording: Recording, rows: NDArray[np.intp], images: tuple[Path, ...], focal_px: float | None
) -> tuple[Pinhole, ...]:
    """The cameras of the frames; what is not known is the middle, or comes from the picture."""
    from vioapr.files.images import probe_image

    cameras: list[Pinhole] = []
    columns = np.stack([np.asarray(column) for column in recording.frames.intrinsics.at(rows)])
    for row, image, numbers in zip(rows, images, columns.T.tolist(), strict=True):
        width, height, fx, fy, cx, cy = numbers
        if not np.isfinite(width):
            probe = probe_image(image)
            width, height = probe.width, probe.height
        if not np.isfinite(fx):
            if focal_px is None:
                line = int(recording.frames.lines[row])
                raise FormatError(
                    recording.folder / "frames.csv",
                    "expected focal lengths fx,fy, found none: give `focal_px`",
                    line,
                )
            fx, fy, cx, cy = focal_px, focal_px, width / 2, height / 2
        cameras.append(Pinhole(int(width), int(height), fx, fy, cx, cy))
    return tuple(cameras)


def _find_quarter_turns(world_from_cam: Rigid3[FloatArray], up: FloatArray) -> int:
    """How far most pictures are to be turned for what is up in the world to be up in them."""
    seen = quaternion.rotate(quaternion.inverse(world_from_cam.quat_xyzw), up)
    # Up in the picture is -y. Turned counterclockwise by a quarter, what was right is up.
    quarters = np.round(np.arctan2(seen[:, 0], -seen[:, 1]) / (np.pi / 2)).astype(int) % 4
    return int(np.bincount(quarters, minlength=4).argmax())
