"""What an importer gives: walks, with what was found out about them."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.files.image_headers import MAX_MEGAPIXELS
from vioapr.files.images import IMAGE_SUFFIXES
from vioapr.files.text import natural_key
from vioapr.formats.base import TimeUnit
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.sensors import Gnss, Heading, Imu
from vioapr.schemas.recording import RecordingInfo
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory

Image = Path | str | bytes | NDArray[np.uint8] | None
"""A path, encoded bytes, pixels, or nothing; of very many, paths are faster as text."""

_ODD = re.compile(r'[,"\s\x00-\x1f]')
"""What the name of an image in `frames.csv` must not hold."""

DEFAULT_MAX_MEGAPIXELS = 100.0
"""Larger images are mostly panoramas and mistakes, and a small file may hold a huge one."""

Split = Literal["train", "test", "none"]
Place = Literal["outdoor", "indoor"]


_MAX_DIGITS = 15

Up = Literal["definition", "first-pose", "unknown"]
"""Why y should be up in a tracker's world: by the format's definition, as ARKit's; not at all, as
the world is the first camera's; or nobody says."""


@dataclass(frozen=True)
class Finding:
    """Something that was found out; a warning where the user should look.

    Attributes:
        text: For people.
        is_warning: Whether the user should look.
        topic: Of the findings on one topic, the last counts; "" has no topic.
    """

    text: str
    is_warning: bool = False
    topic: str = ""


@dataclass(frozen=True)
class ImportOptions:
    """What the user says of a source; None leaves it to the importer.

    Attributes:
        id: Of the recording, for sources with one.
        split: Which split the recordings go to.
        tracker: Which of several trackers' files to take, e.g. "arcore".
        poses: A trajectory file of the tracker's poses.
        gt: A trajectory file of ground truth.
        rate_hz: Frames per second, for sources without timestamps.
        poses_format: The format of `poses`; by default the one that it looks like.
        gt_format: That of `gt`.
        time_unit: Unit of the times in `poses` and `gt`; found by default.
        vio_from_cam: For poses of a tracker's body: "auto" (by `gt`), or the constant transform
            body_from_cam, or a file that holds it; see `formats.body_from_cam`.
        focal_px: The focal length, pixels of the images as they are, for sources without any or
            instead of theirs.
        metric: The poses are in metres, although the source does not show it.
        max_megapixels: The largest image to import.
        strict: Refuse what else is imported with a warning.
    """

    id: str | None = None
    split: Split | None = None
    tracker: str | None = None
    poses: Path | None = None
    gt: Path | None = None
    rate_hz: float | None = None
    poses_format: str | None = None
    gt_format: str | None = None
    time_unit: TimeUnit | None = None
    focal_px: float | None = None
    metric: bool = False
    max_megapixels: float = DEFAULT_MAX_MEGAPIXELS
    strict: bool = False
    vio_from_cam: str | Rigid3 | None = None

    def __post_init__(self) -> None:
        for name in ("rate_hz", "focal_px", "max_megapixels"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ParameterError(f"{name}: expected a number above 0, got {value}")
        if self.max_megapixels > MAX_MEGAPIXELS:
            raise ParameterError(
                f"max_megapixels: at most {MAX_MEGAPIXELS:g} can be read, got "
                f"{self.max_megapixels:g}"
            )

    def split_or(self, default: str | None) -> str | None:
        """The split to use: the user's, or the importer's own."""
        return default if self.split is None else None if self.split == "none" else self.split


@dataclass(eq=False)
class Walk:
    """A recording to be written, n frames.

    Attributes:
        id: Its id in the scene.
        split: "train", "test" or None.
        info: What made it.
        source: Where it is read from, for messages.
        timestamp_s: Shape (n,), increasing, s.
        image_names: File names for `images/`, "" for frames without image.
        images: What to write under them, in order; read when asked for, one at a time.
        vio_from_cam: Shape (n,), NaN where tracking was lost.
        tracking: Shape (n,), values of `Tracking`.
        intrinsics: Numbers, or shapes (n,).
        gt: world_from_cam of some of the frames, with their timestamps, or None.
        up: Why y should be up in the tracker's world.
        is_thinned: Whether only some frames have an image, as the app has it.
        imu: Or None.
        gnss: Or None.
        heading: Or None.
        findings: What was found out.
    """

    id: str
    split: str | None
    info: RecordingInfo
    source: Path
    timestamp_s: NDArray[np.float64]
    image_names: Sequence[str]
    images: Iterable[Image]
    vio_from_cam: Rigid3
    tracking: NDArray[np.uint8]
    intrinsics: Intrinsics = field(default_factory=Intrinsics)
    gt: Trajectory | None = None
    up: Up = "unknown"
    is_thinned: bool = False
    imu: Imu | None = None
    gnss: Gnss | None = None
    heading: Heading | None = None
    findings: list[Finding] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.timestamp_s)

    def note(self, text: str, topic: str = "") -> None:
        """Add something that is as it should be; it replaces a finding on the same topic."""
        finding = Finding(text, topic=topic)
        rows = [row for row, other in enumerate(self.findings) if topic and other.topic == topic]
        if rows:
            self.findings[rows[0]] = finding
        else:
            self.findings.append(finding)

    def warn(self, text: str) -> None:
        """Add something that the user should look at."""
        self.findings.append(Finding(text, is_warning=True))


@dataclass(frozen=True, eq=False)
class ImportedScene:
    """The walks of one place.

    Attributes:
        name: Of the place, or "" if the source has none.
        place: Outdoor or indoor; None if the source does not say.
        world: Of the ground truth.
        walks: How many there are.
        read: Reads them, one at a time.
    """

    name: str
    place: Place | None
    world: World
    walks: int
    read: Callable[[], Iterator[Walk]]


@dataclass(frozen=True)
class Importer:
    """A source that can be imported.

    Attributes:
        name: For the command line.
        title: For people.
        layout: What the source must hold.
        read: From a source to scenes.
        uses: The options that it heeds, besides those of all sources.
        takes_patterns: Whether a source may be a pattern of file names.
    """

    name: str
    title: str
    layout: str
    read: Callable[[Path, ImportOptions], list[ImportedScene]]
    uses: frozenset[str] = frozenset()
    takes_patterns: bool = False


def one_walk(
    read: Callable[[], Walk],
    *,
    name: str = "",
    place: Place | None = None,
    world: World | None = None,
) -> list[ImportedScene]:
    """A source that is a single walk."""

    def walks() -> Iterator[Walk]:
        yield read()

    return [ImportedScene(name, place, world or World(), 1, walks)]


def id_of(name: str) -> str:
    """A recording's id out of a file's or folder's name."""
    text = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-._")[:100]
    if not text:
        raise ParameterError(f"cannot make a recording's id out of {name!r}: give one as `id`")
    return text


def require_one(source: Path, options: ImportOptions, count: int) -> None:
    """See that a source holds one recording, if the user gave the recording's id.

    Raises:
        ParameterError: It holds several.
    """
    if options.id is not None and count > 1:
        raise ParameterError(f"`id` names one recording, and {source} holds {count}")


def is_pattern(source: Path) -> bool:
    """Whether a path is a pattern of file names, as frames/*.jpg."""
    return any(letter in source.as_posix() for letter in "*?[")


def is_frame_number(text: str) -> bool:
    """Whether a text counts a frame, as 000012."""
    return text.isdecimal() and len(text) <= _MAX_DIGITS


def is_image_name(name: str) -> bool:
    """Whether a file's name is one of an image that is read, and no hidden one."""
    return name.lower().endswith(IMAGE_SUFFIXES) and name[0] != "."


def list_image_names(folder: Path) -> list[str]:
    """Names of the image files in a folder, in natural order; none if there is no such folder."""
    if not folder.is_dir():
        return []
    with os.scandir(folder) as entries:
        names = [entry.name for entry in entries if is_image_name(entry.name)]
    # Numbers of equal length sort as text, which is much faster.
    is_even = len({len(name) for name in names}) <= 1
    names.sort(key=None if is_even else natural_key)
    return names


def flat_names(paths: Sequence[str]) -> list[str]:
    """Names for one folder out of paths: the last part, or all of it where that comes twice."""
    names = [path.replace("\\", "/").rpartition("/")[2] for path in paths]
    if len(set(names)) < len(names):
        names = [re.sub(r"[/\\]+", "_", path.strip("./\\")) for path in paths]
    # All at once first: odd names are rare, and there may be very many.
    elif not _ODD.search("/".join(names)) and not any(name[:1] == "." for name in names):
        return names
    names = [_ODD.sub("_", name).lstrip(".") for name in names]
    # Different names may have become the same.
    used: set[str] = set()
    for row, name in enumerate(names):
        stem, _, suffix = name.rpartition(".")
        copy = 2
        while names[row] and names[row] in used:
            names[row], copy = f"{stem}-{copy}.{suffix}", copy + 1
        used.add(names[row])
    return names


def tracking_of(vio_from_cam: Rigid3) -> NDArray[np.uint8]:
    """Normal where there is a pose, lost where there is none."""
    return np.where(vio_from_cam.is_known, Tracking.NORMAL, Tracking.LOST).astype(np.uint8)


def spread_poses(trajectory: Trajectory, rows: NDArray[np.intp], count: int) -> Rigid3:
    """Poses of some of `count` frames, NaN for the others: pose k belongs to frame rows[k]."""
    poses = Rigid3.unknown((count,))
    poses.translation_m[rows] = trajectory.position_m
    poses.quat_xyzw[rows] = trajectory.quat_xyzw
    return poses


def timed_gt(trajectory: Trajectory, timestamp_s: NDArray[np.float64]) -> Trajectory:
    """Ground truth on the recording's clock."""
    return Trajectory.from_arrays(timestamp_s, *trajectory.target_from_source)


def labelled_walk(
    id_: str,
    split: str | None,
    source: Path,
    title: str,
    labels: Trajectory,
    names: Sequence[str],
    images: Sequence[Path],
    rate_hz: float,
    intrinsics: Intrinsics,
) -> Walk:
    """A walk of images that a data set labels with poses in a map, and that had no tracker.

    The poses become ground truth; no frame has a tracker's.

    Args:
        id_: The recording's id.
        split: Its split.
        source: For messages.
        title: The data set.
        labels: world_from_cam of images with names; some have none.
        names: Of all images.
        images: Where they are.
        rate_hz: Frames per second: there are no timestamps.
        intrinsics: Of all images.
    """
    times = np.arange(len(names)) / rate_hz
    poses = Rigid3.unknown((len(names),))
    row_of = {name: row for row, name in enumerate(names)}
    rows = np.array([row_of[name] for name in labels.names or ()], dtype=np.intp)
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
        gt=timed_gt(labels, times[rows]),
    )
    walk.note(f"no timestamps: counted at {rate_hz:g} Hz")
    walk.note("no tracker: the poses are ground truth, and no frame has one of a tracker")
    return walk
