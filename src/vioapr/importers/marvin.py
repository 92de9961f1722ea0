"""MARViN, the paper's data set: scenes with `train.txt`, `test.txt`, `ARKit.txt`, `ARCore.txt`.

A scene's recordings are the folders of its image names. There are no timestamps: frames were
taken at 1 Hz outdoors and 2 Hz indoors. The files were not at hand when this was written: what
is taken for granted is in docs/reference/scene.md, and what can be checked is.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.files.text import natural_key, require_folder
from vioapr.formats import conventions, marvin
from vioapr.formats.notes import ReadingNote
from vioapr.formats.readings import fits_better_inverted
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Place,
    Walk,
    flat_names,
    id_of,
    require_one,
    spread_poses,
    tracking_of,
)
from vioapr.importers.diagnostics import map_up
from vioapr.importers.marvin_sensors import add_sensors
from vioapr.importers.reading import read_noted
from vioapr.schemas.recording import RecordingInfo
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory

_SPLITS = {"train": "train.txt", "test": "test.txt"}
_TRACKERS = {"arkit": ("ARKit.txt", "ARKit"), "arcore": ("ARCore.txt", "ARCore")}
_OUTDOOR, _INDOOR = {"square", "church", "bar"}, {"stairs", "office", "atrium"}
_RATE_HZ: dict[Place, float] = {"outdoor": 1.0, "indoor": 2.0}
_MAX_TILT_DEG = 5.0


@dataclass(frozen=True, eq=False)
class SceneFiles:
    """The poses in a scene's folder; names are those of the files.

    Attributes:
        folder: The scene's.
        gts: Ground truth by split.
        vios: The trackers' poses by the tracker's title.
        unlabelled: By split, images whose rows give no pose.
        notes: What the readers say of the files.
    """

    folder: Path
    gts: dict[str, Trajectory]
    vios: dict[str, Trajectory]
    unlabelled: dict[str, list[str]]
    notes: tuple[ReadingNote, ...]

    @staticmethod
    def read(folder: Path, trackers: Iterable[str], options: ImportOptions) -> SceneFiles:
        """Read the files that are there, of some of the trackers.

        Raises:
            FormatError: One is broken.
        """
        gts: dict[str, Trajectory] = {}
        vios: dict[str, Trajectory] = {}
        unlabelled: dict[str, list[str]] = {}
        notes: tuple[ReadingNote, ...] = ()
        for split, name in _SPLITS.items():
            if (folder / name).is_file():
                reading = read_noted(marvin.FORMAT.read, folder / name, options)
                gts[split], notes = reading.trajectory, (*notes, *reading.notes)
                unlabelled[split] = [row.name for row in reading.left_out if row.name]
        for name, title in (_TRACKERS[tracker] for tracker in trackers):
            if (folder / name).is_file():
                reading = read_noted(marvin.VIO_FORMAT.read, folder / name, options)
                vios[title], notes = reading.trajectory, (*notes, *reading.notes)
        return SceneFiles(folder, gts, vios, unlabelled, notes)

    def recordings(self) -> dict[tuple[str, str], list[str]]:
        """Image names of every recording, in natural order, by folder and split.

        Images that only a tracker knows belong to the recording of their folder.
        """
        recordings: dict[tuple[str, str], list[str]] = {}
        split_of_folder: dict[str, str] = {}
        for split, gt in self.gts.items():
            for name in (*(gt.names or ()), *self.unlabelled[split]):
                folder = str(PurePosixPath(name).parent)
                split_of_folder.setdefault(folder, split)
                recordings.setdefault((folder, split), []).append(name)
        known = {name for names in recordings.values() for name in names}
        for vio in self.vios.values():
            for name in vio.names or ():
                folder = str(PurePosixPath(name).parent)
                # Without folders, a name says nothing of the recording that it is of.
                if name not in known and folder in split_of_folder and folder != ".":
                    known.add(name)
                    recordings[folder, split_of_folder[folder]].append(name)
        for names in recordings.values():
            names.sort(key=natural_key)
        return recordings

    def track_of(self, images: Sequence[str]) -> tuple[str, Trajectory | None]:
        """The tracker that has most of a recording's images, and its poses of them."""
        title, best = "", None
        for name, vio in self.vios.items():
            track = _only(vio, images)
            if track is not None and (best is None or len(track) > len(best)):
                title, best = name, track
        return title, best

    def is_z_up(self) -> bool:
        """Whether the map's z is up by the trackers, within 5 degrees."""
        for gt in self.gts.values():
            for vio in self.vios.values():
                common = _only(vio, gt.names or ())
                if common is not None and len(common) > 1:
                    rows = _rows_of(gt.names or (), common.names or ())
                    poses = spread_poses(common, rows, len(gt))
                    up, off_deg, _ = map_up(gt, poses, np.arange(len(gt)))
                    return up == "+z" and off_deg < _MAX_TILT_DEG
        return False


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A scene's folder, or one of several scenes' folders.

    Raises:
        FormatError: There is no scene.
        ParameterError: The options do not fit.
    """
    require_folder(source, "a MARViN folder")

    def is_scene(folder: Path) -> bool:
        return any((folder / name).is_file() for name in _SPLITS.values())

    folders = [source] if is_scene(source) else sorted(filter(is_scene, source.glob("*")))
    if not folders:
        raise FormatError(source, f"expected {' or '.join(_SPLITS.values())}, found none")
    return [read_scene(folder, options) for folder in folders]


def read_scene(folder: Path, options: ImportOptions) -> ImportedScene:
    """One scene's folder.

    Raises:
        FormatError: A file is broken.
        ParameterError: The options do not fit.
    """
    tracker = None if options.tracker is None else options.tracker.lower()
    if tracker is not None and tracker not in _TRACKERS:
        expected = " or ".join(_TRACKERS)
        raise ParameterError(f"tracker: expected {expected}, got {options.tracker!r}")
    files = SceneFiles.read(folder, _TRACKERS if tracker is None else [tracker], options)
    recordings = files.recordings()
    require_one(folder, options, len(recordings))
    name = folder.resolve().name
    words = set(re.findall(r"[a-z]+", name.lower()))
    place: Place | None = "outdoor" if words & _OUTDOOR else "indoor" if words & _INDOOR else None
    rate_hz = options.rate_hz or (None if place is None else _RATE_HZ[place])
    if rate_hz is None:
        raise ParameterError(
            f"{folder} is no scene of the paper by name: give the rate of its frames as `rate_hz` "
            "(1 outdoors, 2 indoors)"
        )

    def walks() -> Iterator[Walk]:
        splits_of: dict[str, int] = Counter(inner for inner, _ in recordings)
        notes = files.notes
        for (inner, split), images in recordings.items():
            own = split if inner == "." else inner
            is_in_both = inner != "." and splits_of[inner] > 1
            id_ = options.id or id_of(f"{own}-{split}" if is_in_both else own)
            walk = read_walk(files, id_, split, images, rate_hz, options)
            for note in notes:
                (walk.warn if note.is_warning else walk.note)(note.text)
            notes = ()  # they are of all recordings: the first one has them
            yield walk

    world = World(is_gravity_aligned=files.is_z_up())
    return ImportedScene(name, place, world, len(recordings), walks)


def read_walk(
    files: SceneFiles,
    id_: str,
    split: str,
    images: list[str],
    rate_hz: float,
    options: ImportOptions,
) -> Walk:
    """Read one recording: the images of one folder and split.

    Raises:
        FormatError: A sensor's file is broken.
    """
    title, vio = files.track_of(images)
    poses = Rigid3.unknown((len(images),))
    if vio is not None:
        poses = spread_poses(vio, _rows_of(images, vio.names or ()), len(images))
    # Images are next to the text files, or in a folder images/.
    beside = [(files.folder / name, files.folder / "images" / name) for name in images]
    walk = Walk(
        id=id_,
        split=options.split_or(split),
        info=RecordingInfo(tracker=title, source="MARViN", clock="frame-rate"),
        source=files.folder,
        timestamp_s=times_of_names(images, rate_hz),
        image_names=flat_names(images),
        images=[b if not a.exists() and b.exists() else a for a, b in beside],
        vio_from_cam=poses,
        tracking=tracking_of(poses),
        up="definition",
    )
    walk.note(f"no timestamps: counted at {rate_hz:g} Hz")
    if vio is None:
        names = ", ".join(file for file, _ in _TRACKERS.values())
        walk.warn(f"no tracker's file ({names}) has its images")
    gt = _only(files.gts[split], images)
    if gt is not None:
        frames = _rows_of(images, gt.names or ())
        if vio is not None:
            gt = choose_reading(walk, gt, vio)
            up, off_deg, spread_deg = map_up(gt, walk.vio_from_cam, frames)
            if up:
                walk.note(
                    f"map: up is {up} by the tracker, {off_deg:.0f} deg off it, spread "
                    f"{spread_deg:.1f} deg"
                )
        order = np.argsort(walk.timestamp_s[frames])
        walk.gt = Trajectory.from_arrays(
            walk.timestamp_s[frames][order], gt.position_m[order], gt.quat_xyzw[order]
        )
    add_sensors(walk, files.folder, images)
    return walk


def times_of_names(images: Sequence[str], rate_hz: float) -> NDArray[np.float64]:
    """Seconds by frame number where names are numbered one by one, else by order."""
    digits = [re.findall(r"\d+", PurePosixPath(name).stem) for name in images]
    if all(digits):
        numbers = np.array([int(found[-1][-15:]) for found in digits], dtype=np.float64)
        steps = np.diff(numbers)
        if (steps > 0).all() and (not len(steps) or np.median(steps) == 1):
            return (numbers - numbers[0]) / rate_hz
    return np.arange(len(images)) / rate_hz


def choose_reading(walk: Walk, gt: Trajectory, vio: Trajectory) -> Trajectory:
    """Ground truth with its rotations read the way that fits the tracker; findings are added."""
    try:
        is_inverted = fits_better_inverted(gt, vio)
    except AssociationError as error:
        walk.warn(f"convention: rotations are taken to be cam_from_world, not checked: {error}")
        return gt
    if not is_inverted:
        walk.note("convention: map rotations are cam_from_world in the file: fits the tracker")
        return gt
    walk.warn("convention: map rotations fit the tracker as world_from_cam, and are read so")
    return gt.with_transforms(conventions.centre_and_cam_from_world(gt.target_from_source))


def _only(track: Trajectory, names: Iterable[str]) -> Trajectory | None:
    """The poses of some names, or None if it has none of them."""
    wanted = set(names)
    rows = [row for row, name in enumerate(track.names or ()) if name in wanted]
    return track.at_rows(np.array(rows)) if rows else None


def _rows_of(images: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:
    row_of = {name: row for row, name in enumerate(images)}
    return np.array([row_of[name] for name in names], dtype=np.intp)


IMPORTER = Importer(
    name="marvin",
    title="MARViN, the paper's data set",
    layout="a scene's folder with train.txt, test.txt, ARKit.txt or ARCore.txt, or one of scenes",
    read=read,
    uses=frozenset({"tracker", "rate_hz"}),
)
