"""Localizing a recorded walk with an exported file: where its frames come from, and the result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileMissingError, FormatError, ParameterError
from vioapr.files.images import read_rgb
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import FrameInput
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import Finding, ImportOptions
from vioapr.importers.images import IMPORTER as IMAGES
from vioapr.runtime.localizer import Located, OnnxLocalizer
from vioapr.scene.cameras import relative_camera
from vioapr.scene.frames import Tracking
from vioapr.scene.recording import IMAGES_FOLDER, Recording
from vioapr.scene.scene import RECORDINGS_FOLDER, Scene
from vioapr.trajectory import Trajectory, poses_of_frames


@dataclass(frozen=True, eq=False)
class WalkFrames:
    """The frames that a phone would feed a localizer, n of them.

    Attributes:
        name: Of the walk, for people.
        timestamp_s: Shape (n,), increasing.
        images: Paths; None for frames without.
        vio_from_cam: Shape (n,); y-up tracking world, OpenCV camera; NaN where lost.
        tracking_reset: Shape (n,), whether the tracking world is a new one.
        gt: Ground truth, or None.
        camera: See `vioapr.scene.cameras.relative_camera`, of some or all images; None if unknown.
        tables: Files that were read, beside images.
        findings: Warnings of the reader.
    """

    name: str
    timestamp_s: NDArray[np.float64]
    images: tuple[Path | None, ...]
    vio_from_cam: Rigid3
    tracking_reset: NDArray[np.bool_]
    gt: Trajectory | None = None
    camera: NDArray[np.float64] | None = None
    tables: tuple[Path, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def files(self) -> list[Path]:
        """All files that the frames are read from."""
        return [*self.tables, *(path for path in self.images if path is not None)]

    def __len__(self) -> int:
        return len(self.timestamp_s)

    def at_rows(self, rows: NDArray[np.intp]) -> WalkFrames:
        """Pick the frames of the given rows, which must be in increasing order."""
        return replace(
            self,
            timestamp_s=self.timestamp_s[rows],
            images=tuple(self.images[row] for row in rows.tolist()),
            vio_from_cam=self.vio_from_cam.at(rows),
            tracking_reset=self.tracking_reset[rows],
        )

    @property
    def vio(self) -> Trajectory | None:
        """The tracker's poses; None where it has none."""
        return _known(self.timestamp_s, self.vio_from_cam, "vio")

    @property
    def has_pose(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames with a tracker's pose."""
        return self.vio_from_cam.is_known


def frames_of_recording(folder: Path) -> WalkFrames:
    """Read a recording's frames; ground truth is that of the scene that it lies in, if any.

    Raises:
        FileError: It is no recording, or has no frames.
    """
    recording = Recording.open(folder)
    frames = recording.frames
    if not len(frames):
        raise FormatError(folder, "expected frames, found none")
    images = tuple(folder / IMAGES_FOLDER / name if name else None for name in frames.image)
    gt, real = None, folder.resolve()
    tables = [path for path in folder.iterdir() if path.is_file()]
    if real.parent.name == RECORDINGS_FOLDER and (real.parents[1] / "scene.toml").exists():
        scene = Scene.open(real.parents[1])
        gt = scene.gt(real.name)
        tables += scene.tables()
    resets = frames.tracking == Tracking.RESET
    return WalkFrames(
        recording.id,
        frames.timestamp_s,
        images,
        frames.vio_from_cam,
        resets,
        gt,
        relative_camera(frames.intrinsics),
        tuple(tables),
    )


def frames_of_images(images: str, options: ImportOptions) -> WalkFrames:
    """Read images of one folder, and the tracker's poses from a trajectory file.

    Poses belong to images by name, else by timestamps in the images' names, else in order.

    Args:
        images: Their folder, or a pattern of their paths with wildcards.
        options: `poses` is the file of vio_from_cam, of any format that is read.

    Raises:
        FileError: No images, or none with a pose.
        ParameterError: They lie in several folders.
    """
    given = Path(images)
    if given.is_dir():
        paths = sorted(path for path in given.iterdir() if path.is_file())
    elif given.exists():  # as it is called, whatever signs of patterns are in its name
        paths = [given]
    else:
        paths = sorted(Path(given.anchor).glob(str(given.relative_to(given.anchor))))
    folders = {path.parent for path in paths}
    if not paths:
        raise FileMissingError(
            images, "expected images, found no file in this folder or of this pattern"
        )
    if len(folders) > 1:
        raise ParameterError(f"images: expected images of one folder, got {len(folders)} folders")
    (walk,) = (
        walk
        for scene in IMAGES.read(folders.pop(), replace(options, id="walk"))
        for walk in scene.read()
    )
    chosen = {path.name for path in paths}
    sources = [Path(str(image)) for image in walk.images]
    rows = np.array([k for k, path in enumerate(sources) if path.name in chosen], dtype=np.intp)
    if not len(rows):
        raise FormatError(images, "expected images (.jpg, .png), found other files only")
    return WalkFrames(
        paths[0].parent.resolve().name,
        walk.timestamp_s[rows],
        tuple(sources[row] for row in rows),
        walk.vio_from_cam.at(rows),
        np.zeros(len(rows), dtype=bool),
        findings=tuple(finding for finding in walk.findings if finding.is_warning),
    )


@dataclass(frozen=True, eq=False)
class LocalizedWalk:
    """A walk and the answers to its frames.

    Attributes:
        frames: As they were fed.
        located: An answer a frame.
    """

    frames: WalkFrames
    located: tuple[Located, ...]

    @property
    def fused(self) -> FusedWalk:
        """The poses as a fusion method gives them, as known when each frame arrived."""
        first = self.located[0]
        sigmas = (
            None if getattr(first, name) is None else self._column(name)
            for name in ("sigma_position_m", "sigma_orientation_deg")
        )
        return FusedWalk(
            self.frames.timestamp_s,
            rigid.stack([one.world_from_cam for one in self.located]),
            np.array([int(one.status) for one in self.located]),
            *sigmas,
            world_from_vio=rigid.stack([one.world_from_vio for one in self.located]),
            localization_state=(
                None
                if first.localization_state is None
                else self._column("localization_state").astype(int)
            ),
            confidence=None if first.confidence is None else self._column("confidence"),
        )

    @property
    def paired(self) -> PairedFrames:
        """The regressor's answers and the tracker's poses, to be fused by other methods."""
        frames = self.frames
        apr = rigid.stack([one.apr_world_from_cam for one in self.located])
        sigma_m, sigma_deg = map(
            self._column, ("apr_sigma_position_m", "apr_sigma_orientation_deg")
        )
        has_apr, identity = apr.is_known, Rigid3.identity((len(frames),))
        return PairedFrames(
            FrameInput(
                frames.timestamp_s,
                rigid.choose(has_apr, apr, identity),
                has_apr,
                rigid.choose(frames.has_pose, frames.vio_from_cam, identity),
                frames.has_pose,
                frames.tracking_reset,
                sigma_m,
                np.deg2rad(sigma_deg),
            )
        )

    @property
    def predictions(self) -> Trajectory | None:
        """The regressor's answers, world_from_cam; None where it has none."""
        apr = rigid.stack([one.apr_world_from_cam for one in self.located])
        return _known(self.frames.timestamp_s, apr, "world")

    def gt_world_from_cam(self, gt: Trajectory) -> Rigid3:
        """Ground truth of every frame, NaN where it has none."""
        return poses_of_frames(gt, self.frames.timestamp_s)

    def _column(self, name: str) -> NDArray[np.float64]:
        return np.array([getattr(one, name) for one in self.located])


def _known(
    timestamp_s: NDArray[np.float64], target_from_cam: Rigid3, target: str
) -> Trajectory | None:
    known = target_from_cam.is_known
    if not known.any():
        return None
    position_m, quat_xyzw = target_from_cam.at(known)
    return Trajectory.from_arrays(timestamp_s[known], position_m, quat_xyzw, target=target)


def localize(
    localizer: OnnxLocalizer,
    frames: WalkFrames,
    tick: Callable[[Located], object] | None = None,
) -> LocalizedWalk:
    """Feed a walk's frames as they would arrive.

    Args:
        localizer: That has seen no frame, or frames of the same tracking world.
        frames: Of the walk.
        tick: Called with every answer.

    Raises:
        FileError: An image cannot be read.
    """
    has_pose, answers = frames.has_pose, []
    for row, path in enumerate(frames.images):
        located = localizer.update(
            float(frames.timestamp_s[row]),
            None if path is None else read_rgb(path),
            frames.vio_from_cam.at(row) if has_pose[row] else None,
            tracking_reset=bool(frames.tracking_reset[row]),
        )
        if tick is not None:
            tick(located)
        answers.append(located)
    return LocalizedWalk(frames, tuple(answers))
