"""MARViN, the paper's data set: scenes with `train.txt`, `test.txt`, `ARKit.txt`, `ARCore.txt`.

A scene's recordings are the folders of its image names. There are no timestamps: frames were
taken at 1 Hz outdoors and 2 Hz indoors. The files were not at hand when this was written: what
is taken for granted is in docs/reference/scene.md, and what can be checked is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.files.text import natural_key
from vioapr.formats import conventions, marvin
from vioapr.formats.base import ReadOptions
from vioapr.formats.readings import fits_better_inverted
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Place,
    Walk,
    flat_names,
    id_of,
    no_poses,
    require_folder,
    spread_poses,
    tracking_of,
)
from vioapr.importers.diagnostics import map_up
from vioapr.importers.marvin_sensors import add_sensors
from vioapr.schemas.recording import RecordingInfo
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory

_SPLITS = {"train": "train.txt", "test": "test.txt"}
_TRACKERS = {"arkit": ("ARKit.txt", "ARKit"), "arcore": ("ARCore.txt", "ARCore")}
_OUTDOOR, _INDOOR = {"square", "church", "bar"}, {"stairs", "office", "atrium"}
_RATE_HZ = {"outdoor": 1.0, "indoor": 2.0}


@dataclass(eq=False)
class _Files:
    """What a scene's folder holds; names are those of the files."""

    folder: Path
    gts: dict[str, Trajectory]
    vios: dict[str, Trajectory]


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A scene's folder, or one of several scenes' folders.

    Raises:
        FormatError: There is no scene.
        ParameterError: The options do not fit.
    """
    require_folder(source, "a MARViN folder")
    folders = [source] if _is_scene(source) else sorted(filter(_is_scene, source.glob("*")))
    if not folders:
        raise FormatError(source, f"expected {' or '.join(_SPLITS.values())}, found none")
    return [_read_scene(folder, options) for folder in folders]


def _is_scene(folder: Path) -> bool:
    return any((folder / name).is_file() for name in _SPLITS.values())


def _read_scene(folder: Path, options: ImportOptions) -> ImportedScene:
    files = _Files(folder, _read_all(folder, _SPLITS.items()), _read_vios(folder, options))
    recordings = _find_recordings(files)
    if options.id is not None and len(recordings) > 1:
        raise ParameterError(f"--id names one recording, and {folder} holds {len(recordings)}")
    place = _place_of(folder.resolve().name)
    rate_hz = options.rate_hz or (None if place is None else _RATE_HZ[place])
    if rate_hz is None:
        raise ParameterError(
            f"{folder} is no scene of the paper by name: give the rate of its frames with "
            "--rate-hz (1 outdoors, 2 indoors)"
        )

    def walks() -> Iterator[Walk]:
        for (name, split), images in recordings.items():
            yield _read_walk(files, name, split, images, rate_hz, options)

    world = World(is_gravity_aligned=_is_z_up(files))
    return ImportedScene(folder.resolve().name, place, world, len(recordings), walks)


def _read_all(folder: Path, names) -> dict[str, Trajectory]:
    return {
        key: marvin.FORMAT.read(folder / name, ReadOptions())
        for key, name in names
        if (folder / name).is_file()
    }


def _read_vios(folder: Path, options: ImportOptions) -> dict[str, Trajectory]:
    if options.tracker is not None and options.tracker.lower() not in _TRACKERS:
        raise ParameterError(
            f"--tracker: expected {' or '.join(_TRACKERS)}, got {options.tracker!r}"
        )
    wanted = _TRACKERS if options.tracker is None else [options.tracker.lower()]
    found = {}
    for key in wanted:
        file, title = _TRACKERS[key]
        if (folder / file).is_file():
            found[title] = marvin.VIO_FORMAT.read(folder / file, ReadOptions())
    return found


def _place_of(name: str) -> Place | None:
    words = set(re.findall(r"[a-z]+", name.lower()))
    return "outdoor" if words & _OUTDOOR else "indoor" if words & _INDOOR else None


def _find_recordings(files: _Files) -> dict[tuple[str, str | None], list[str]]:
    """Image names of every recording, in natural order, by folder and split.

    Images that only a tracker knows belong to the recording of their folder.
    """
    recordings: dict[tuple[str, str | None], list[str]] = {}
    split_of_folder: dict[str, str] = {}
    for split, gt in files.gts.items():
        for name in gt.names or ():
            folder = str(PurePosixPath(name).parent)
            split_of_folder.setdefault(folder, split)
            recordings.setdefault((folder, split), []).append(name)
    known = {name for names in recordings.values() for name in names}
    for vio in files.vios.values():
        for name in vio.names or ():
            folder = str(PurePosixPath(name).parent)
            # Without folders, a name says nothing of the recording that it is of.
            if name not in known and folder in split_of_folder and folder != ".":
                known.add(name)
                recordings[folder, split_of_folder[folder]].append(name)
    for names in recordings.values():
        names.sort(key=natural_key)
    return recordings


def _read_walk(
    files: _Files, name: str, split: str | None, images: list[str], rate_hz: float,
    options: ImportOptions,
) -> Walk:  # fmt: skip
    times = _times(images, rate_hz)
    title, vio = _track_of(files, images)
    poses = no_poses(len(images))
    if vio is not None:
        poses = spread_poses(vio, _rows_of(images, vio.names or ()), len(images))
    own = str(split) if name == "." else name
    is_in_both = name != "." and sum(1 for other in files.gts.values() if _holds(other, name)) > 1
    walk = Walk(
        id=options.id or id_of(f"{own}-{split}" if is_in_both else own),
        split=options.split_or(split),
        info=RecordingInfo(
            device="", tracker=title, source="MARViN", clock="frame-rate", is_metric=True
        ),
        source=files.folder,
        timestamp_s=times,
        image_names=flat_names(images),
        images=[_find_image(files.folder, image) for image in images],
        vio_from_cam=poses,
        tracking=tracking_of(poses),
    )
    walk.note(f"no timestamps: counted at {rate_hz:g} frames per second")
    if vio is None:
        walk.warn(
            f"no tracker's file ({', '.join(f for f, _ in _TRACKERS.values())}) has its images"
        )
    _add_gt(walk, files, split, images, vio)
    add_sensors(walk, files.folder, images)
    return walk


def _holds(trajectory: Trajectory, folder: str) -> bool:
    return any(str(PurePosixPath(name).parent) == folder for name in trajectory.names or ())


def _times(images: Sequence[str], rate_hz: float) -> NDArray[np.float64]:
    """Seconds by frame number where names are numbered one by one, else by order."""
    digits = [re.findall(r"\d+", PurePosixPath(name).stem) for name in images]
    if all(digits):
        numbers = np.array([int(found[-1][-15:]) for found in digits], dtype=np.float64)
        steps = np.diff(numbers)
        if (steps > 0).all() and (not len(steps) or np.median(steps) == 1):
            return (numbers - numbers[0]) / rate_hz
    return np.arange(len(images)) / rate_hz


def _track_of(files: _Files, images: list[str]) -> tuple[str, Trajectory | None]:
    """The tracker that has most of a recording's images, and its poses of them."""
    wanted = set(images)
    best: tuple[str, Trajectory | None] = ("", None)
    for title, vio in files.vios.items():
        rows = [row for row, name in enumerate(vio.names or ()) if name in wanted]
        if rows and (best[1] is None or len(rows) > len(best[1])):
            best = title, vio.at_rows(np.array(rows))
    return best


def _rows_of(images: Sequence[str], names: Sequence[str]) -> NDArray[np.intp]:
    row_of = {name: row for row, name in enumerate(images)}
    return np.array([row_of[name] for name in names], dtype=np.intp)


def _find_image(folder: Path, name: str) -> Path:
    """Next to the text files, or in a folder images/."""
    path = folder / name
    return (
        path
        if path.exists() or not (folder / "images" / name).exists()
        else folder / "images" / name
    )


def _add_gt(
    walk: Walk, files: _Files, split: str | None, images: list[str], vio: Trajectory | None
) -> None:
    """Ground truth, its rotations read the way that fits the tracker."""
    if split is None:
        return
    everything = files.gts[split]
    wanted = set(images)
    rows = [row for row, name in enumerate(everything.names or ()) if name in wanted]
    gt = everything.at_rows(np.array(rows))
    frames = _rows_of(images, gt.names or ())
    if vio is not None:
        gt = _choose_reading(walk, gt, vio)
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


def _choose_reading(walk: Walk, gt: Trajectory, vio: Trajectory) -> Trajectory:
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


def _is_z_up(files: _Files) -> bool:
    """Whether the map's z is up by the trackers, within 5 degrees."""
    for gt in files.gts.values():
        for vio in files.vios.values():
            known = set(gt.names or ())
            names = [name for name in vio.names or () if name in known]
            if len(names) > 1:
                in_gt, in_vio = _rows_of(gt.names or (), names), _rows_of(vio.names or (), names)
                poses = spread_poses(vio.at_rows(in_vio), in_gt, len(gt))
                up, off_deg, _ = map_up(gt, poses, np.arange(len(gt)))
                return up == "+z" and off_deg < 5
    return False


IMPORTER = Importer(
    name="marvin",
    title="MARViN, the paper's data set",
    layout="a scene's folder with train.txt, test.txt, ARKit.txt or ARCore.txt, or one of scenes",
    read=read,
    uses=frozenset({"tracker", "rate_hz"}),
)
