"""Check a scene: every file, every line, every image."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileError
from vioapr.files.append_table import Problem
from vioapr.files.atomic import PARTIAL_SUFFIX
from vioapr.files.images import IMAGE_SUFFIXES, decode_problem, probe_image
from vioapr.formats.registry import read_trajectory
from vioapr.plurals import count_of
from vioapr.scene.divergence import find_divergence
from vioapr.scene.frames import Frames, Tracking, read_frame_blocks
from vioapr.scene.recording import (
    FRAMES_FILE,
    GNSS_FILE,
    HEADING_FILE,
    IMAGES_FOLDER,
    IMU_FILE,
    INFO_FILE,
    read_info,
)
from vioapr.scene.scene import GT_FOLDER, RECORDINGS_FOLDER, SCENE_FILE, SPLITS, Scene
from vioapr.scene.sensors import read_gnss, read_heading, read_imu
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import DEFAULT_TOLERANCE_S, nearest_rows

_SENSORS = {IMU_FILE: read_imu, GNSS_FILE: read_gnss, HEADING_FILE: read_heading}
_MAX_NAMED = 3


@dataclass
class Report:
    """What a check found.

    Attributes:
        problems: Everything that is wrong, and, with `is_error` false, worth knowing.
        recordings: How many were looked at.
        frames: How many frames, of all recordings.
        images: How many images were looked at.
    """

    problems: list[Problem] = field(default_factory=list[Problem])
    recordings: int = 0
    frames: int = 0
    images: int = 0

    @property
    def errors(self) -> list[Problem]:
        """Only what is wrong."""
        return [problem for problem in self.problems if problem.is_error]

    def error(self, path: Path, text: str, line: int | None = None) -> None:
        """Add something that is wrong."""
        self.problems.append(Problem(path, line, text))

    def note(self, path: Path, text: str, line: int | None = None) -> None:
        """Add something worth knowing."""
        self.problems.append(Problem(path, line, text, is_error=False))


@dataclass
class _Walked:
    """What is kept of a recording's frames while they pass by: no images, no quaternions."""

    names: dict[str, int] = field(default_factory=dict[str, int])
    times: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    positions: list[NDArray[np.float64]] = field(default_factory=list[NDArray[np.float64]])
    frames: int = 0
    lost: int = 0


def count_frames(folder: Path) -> int:
    """About how many frames a scene has, by the lines of its tables; for progress."""
    total = 0
    for path in (folder / RECORDINGS_FOLDER).glob(f"*/{FRAMES_FILE}"):
        with path.open("rb") as file:
            total += sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(1 << 20), b""))
    return total


def check_scene(
    folder: Path, *, decode: bool = False, tick: Callable[[int], object] | None = None
) -> Report:
    """Verify all files of a scene.

    Images are checked by their head and end. Decoding them whole takes a hundred times longer
    and finds damage in the middle too.

    Args:
        folder: The scene.
        decode: Decode every image.
        tick: Called with a number of frames now and then, for progress.

    Raises:
        FormatError: There is no scene, or its `scene.toml` is broken.
    """
    scene = Scene.open(folder)
    report = Report()
    check_splits(scene, report)
    for id_ in scene.recording_ids:
        check_recording(scene, id_, report, decode=decode, tick=tick or (lambda _: None))
    for split in SPLITS:
        if not scene.splits.get(split):
            # Poses alone are neither mapped nor learned from, and need no split for training.
            # One recording, the first of a place, can only be in one split.
            is_error = report.images > 0 and report.recordings > 1
            is_error |= not any(scene.splits.values())
            text = f"the split {split} is empty: list recordings in splits.{split}"
            report.problems.append(Problem(scene.folder / SCENE_FILE, None, text, is_error))
    for path in sorted((scene.folder / RECORDINGS_FOLDER).glob(f".*{PARTIAL_SUFFIX}")):
        report.note(path, "left by an import that was interrupted; it may be deleted")
    for path in sorted((scene.folder / GT_FOLDER).glob("*.tum")):
        if path.name[0] != "." and path.stem not in scene.recording_ids:
            report.error(path, "ground truth of a recording that is missing")
    check_map(scene, report)
    return report


def check_splits(scene: Scene, report: Report) -> None:
    """See that splits and exclusions name recordings that are there, each in one place."""
    path = scene.folder / SCENE_FILE
    present = set(scene.recording_ids)
    if not present:
        report.error(scene.folder / RECORDINGS_FOLDER, "expected recordings, found none")
    for split in SPLITS:
        ids = list(scene.splits.get(split, ()))
        for id_ in sorted({id_ for id_ in ids if ids.count(id_) > 1}):
            report.error(path, f"the recording {id_!r} is in splits.{split} twice")
        for id_ in dict.fromkeys(ids):
            if id_ not in present:
                report.error(path, f"splits.{split} names the recording {id_!r}, which is missing")
    both = set(scene.splits.get("train", ())) & set(scene.splits.get("test", ()))
    for id_ in sorted(both):
        report.error(path, f"the recording {id_!r} is in both train and test")
    used = {id_ for ids in scene.splits.values() for id_ in ids}
    for id_ in sorted(set(scene.excluded) & used):
        report.error(path, f"the recording {id_!r} is excluded, and in a split")
    for id_ in sorted(present - used):
        why = scene.excluded.get(id_)
        text = f"excluded: {why}" if why else "it is in no split"
        report.note(scene.folder / RECORDINGS_FOLDER / id_, text)


def check_recording(
    scene: Scene, id_: str, report: Report, *, decode: bool, tick: Callable[[int], object]
) -> None:
    """Verify one recording: its description, frames with images, sensors and ground truth."""
    folder = scene.folder / RECORDINGS_FOLDER / id_
    report.recordings += 1
    info, walked = RecordingInfo(), _Walked()
    with _collecting(report):
        info = read_info(folder / INFO_FILE)
    with _collecting(report):
        for block in read_frame_blocks(folder / FRAMES_FILE, report.problems):
            check_frames(folder, block, walked, report, decode=decode)
            tick(len(block))
    report.frames += walked.frames
    if walked.frames:
        is_used = any(id_ in ids for ids in scene.splits.values())
        check_whole_track(folder, info, walked, report, is_used=is_used)
    elif (folder / FRAMES_FILE).exists():
        report.error(folder / FRAMES_FILE, "expected frames, found none that can be used")
    images = folder / IMAGES_FOLDER
    found = (path.name for path in images.glob("*") if path.suffix.lower() in IMAGE_SUFFIXES)
    orphans = sorted(name for name in found if name not in walked.names)
    if orphans:
        named = ", ".join(orphans[:_MAX_NAMED]) + (", ..." if len(orphans) > _MAX_NAMED else "")
        report.note(
            images,
            f"{count_of(len(orphans), 'image belongs', 'images belong')} to no frame: {named}",
        )
    for name, read in _SENSORS.items():
        if (folder / name).exists():
            with _collecting(report):
                read(folder / name, report.problems)
    if walked.frames and scene.gt_path(id_).exists():
        with _collecting(report):
            check_ground_truth(scene, id_, np.concatenate(walked.times), report)


@contextmanager
def _collecting(report: Report) -> Generator[None, None, None]:
    """Turn a file that cannot be read at all into a problem."""
    try:
        yield
    except FileError as error:
        report.error(Path(error.path), error.problem, error.line)


def check_frames(
    folder: Path, block: Frames, walked: _Walked, report: Report, *, decode: bool
) -> None:
    """Verify the images of some frames of a recording's folder, and remember the frames."""
    table, images = folder / FRAMES_FILE, folder / IMAGES_FOLDER
    walked.frames += len(block)
    walked.lost += int((block.tracking == Tracking.LOST).sum())
    walked.times.append(block.timestamp_s)
    walked.positions.append(block.vio_from_cam.translation_m)
    sizes = np.stack([block.intrinsics.width, block.intrinsics.height], axis=1).tolist()
    for name, line, (width, height) in zip(block.image, block.lines.tolist(), sizes, strict=True):
        if not name:
            continue
        if name in walked.names:
            report.error(table, f"the image {name} is line {walked.names[name]}'s already", line)
            continue
        walked.names[name] = line
        report.images += 1
        path = f"{images}/{name}"  # not a Path: 100,000 of them take a second
        probe = probe_image(path)
        problem = probe.obstacle or (decode_problem(Path(path)) if decode else None)
        is_sized = width == width  # NaN where the line does not say
        if problem is None and is_sized and (probe.width, probe.height) != (width, height):
            problem = (
                f"the line says {width:.0f}x{height:.0f} pixels, but the image has "
                f"{probe.width}x{probe.height}"
            )
        if problem:
            report.error(table, f"{IMAGES_FOLDER}/{name}: {problem}", line)


def check_whole_track(
    folder: Path, info: RecordingInfo, walked: _Walked, report: Report, *, is_used: bool
) -> None:
    """Verify what only shows when all frames have passed: images at all, tracking, divergence.

    Args:
        folder: The recording's.
        info: What the recording says of itself.
        walked: Its frames, at least one.
        report: Where problems are added.
        is_used: Whether the recording is in a split.
    """
    table = folder / FRAMES_FILE
    if info.has_images and not walked.names:
        report.error(table, "expected images, but no frame has one")
    elif info.has_images and len(walked.names) < walked.frames:
        report.note(
            table,
            f"{count_of(walked.frames - len(walked.names), 'frame has', 'frames have')} no image",
        )
    if walked.lost == walked.frames and info.tracker:
        report.error(table, "tracking was lost throughout: no frame has a pose")
    times, positions = np.concatenate(walked.times), np.concatenate(walked.positions)
    known = np.isfinite(positions[:, 0])
    is_diverging = info.is_diverging or find_divergence(times[known], positions[known]) is not None
    if is_used and is_diverging and info.clock == "device":
        text = f"the tracker is diverging, and {folder.name!r} is in a split: exclude it in "
        report.error(table, text + SCENE_FILE)


def check_ground_truth(
    scene: Scene, id_: str, timestamp_s: NDArray[np.float64], report: Report
) -> None:
    """See that ground truth is of frames, whose timestamps have shape (n,).

    Raises:
        FileError: It cannot be read.
    """
    gt = scene.gt(id_)
    assert gt is not None  # only such recordings are asked for
    nearest = timestamp_s[nearest_rows(gt.timestamp_s, timestamp_s)]
    strange = np.abs(gt.timestamp_s - nearest) > DEFAULT_TOLERANCE_S
    if strange.any():
        first = gt.timestamp_s[np.argmax(strange)]
        text = f"{strange.sum()} of {len(gt)} poses are of no frame, the first at {first:.6f} s"
        report.error(scene.gt_path(id_), text)


def check_map(scene: Scene, report: Report) -> None:
    """See that a map, where there is one, is a COLMAP model of images that are there."""
    if not any((scene.map_folder / f"images.{ending}").exists() for ending in ("bin", "txt")):
        return
    with _collecting(report):
        names = read_trajectory(scene.map_folder).names or ()
        folder = scene.folder / RECORDINGS_FOLDER
        missing = [name for name in names if not (folder / name).exists()]
        if missing:
            text = f"{len(missing)} of {len(names)} images are not in {folder.name}/: {missing[0]}"
            report.error(scene.map_folder, text)
