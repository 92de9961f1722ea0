"""The data sets that can be reproduced, and where their scenes are in a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.importers.base import Place


@dataclass(frozen=True)
class DataSet:
    """A published data set.

    Attributes:
        name: Of its importer, and for the command line.
        title: For people.
        groups: Scenes that share one MS-Transformer, by where they are.
        labels: Files that every scene's folder has, for training and for testing.
        has_tracker: Whether its walks come with a tracker's poses, which fusion needs.
    """

    name: str
    title: str
    groups: Mapping[Place, tuple[str, ...]]
    labels: tuple[str, str]
    has_tracker: bool

    @property
    def scenes(self) -> tuple[str, ...]:
        """All scenes, in the tables' order."""
        return tuple(scene for group in self.groups.values() for scene in group)

    def place_of(self, scene: str) -> Place:
        """The group of a scene."""
        return next(place for place, scenes in self.groups.items() if scene in scenes)


DATA_SETS = {
    one.name: one
    for one in (
        DataSet(
            "marvin",
            "MARViN",
            {"outdoor": ("Square", "Church", "Bar"), "indoor": ("Stairs", "Office", "Atrium")},
            ("train.txt", "test.txt"),
            has_tracker=True,
        ),
        DataSet(
            "7scenes",
            "7-Scenes",
            {"indoor": ("chess", "fire", "heads", "office", "pumpkin", "redkitchen", "stairs")},
            ("TrainSplit.txt", "TestSplit.txt"),
            has_tracker=False,
        ),
        DataSet(
            "cambridge",
            "Cambridge Landmarks",
            {"outdoor": ("KingsCollege", "OldHospital", "ShopFacade", "StMarysChurch")},
            ("dataset_train.txt", "dataset_test.txt"),
            has_tracker=False,
        ),
    )
}


@dataclass(frozen=True)
class FoundScenes:
    """What a folder holds of a data set.

    Attributes:
        folders: Of the scenes that are there, in the data set's order.
        missing: Wanted scenes that are not.
        unknown: Folders that look like scenes and are none of the data set's.
    """

    folders: dict[str, Path]
    missing: tuple[str, ...] = ()
    unknown: tuple[Path, ...] = field(default=())


def choose_scenes(data_set: DataSet, names: Sequence[str]) -> tuple[str, ...]:
    """Scenes by name, in the data set's order; all of them for no names.

    Raises:
        ParameterError: One is not of the data set.
    """
    of_key = {scene.lower(): scene for scene in data_set.scenes}
    for name in names:
        if name.lower() not in of_key:
            raise ParameterError(
                f"--scenes: expected some of {', '.join(data_set.scenes)}, got {name!r}"
            )
    wanted = {of_key[name.lower()] for name in names}
    return tuple(scene for scene in data_set.scenes if not names or scene in wanted)


def find_scenes(data: Path, data_set: DataSet, wanted: Sequence[str]) -> FoundScenes:
    """Where the wanted scenes are: folders of their names, in `data` or one folder deeper.

    Raises:
        FormatError: The folder is missing, is no data set, holds none of the scenes, a scene
            twice, or half of one.
    """
    if not data.is_dir():
        found = "a file" if data.exists() else "nothing of this name"
        raise FormatError(data, f"expected the folder of {data_set.title}, found {found}")
    if _labels_in(data, data_set):
        raise FormatError(
            data, f"expected a folder with scenes' folders, found one scene's {data_set.labels[0]}:"
            " give the folder above it, and --scenes to have only this one"
        )  # fmt: skip
    folders: dict[str, Path] = {}
    unknown = []
    for folder in _candidates(data, data_set):
        scene = _scene_of(folder.name, data_set)
        if scene is None:
            unknown.append(folder)
        elif scene in folders:
            problem = f"expected one folder of the scene {scene}, found also {folders[scene]}"
            raise FormatError(folder, problem)
        else:
            folders[scene] = folder
    chosen = {scene: folders[scene] for scene in wanted if scene in folders}
    if not chosen:
        raise FormatError(
            data, f"expected scenes of {data_set.title}: folders named {', '.join(wanted)} with "
            f"{' and '.join(data_set.labels)}; found none"
        )  # fmt: skip
    for folder in chosen.values():
        _check_labels(folder, data_set)
    missing = tuple(scene for scene in wanted if scene not in folders)
    return FoundScenes(chosen, missing, tuple(unknown))


def _candidates(data: Path, data_set: DataSet) -> Iterator[Path]:
    """Folders that hold labels."""
    for pattern in ("*", "*/*"):
        for folder in sorted(data.glob(pattern)):
            if folder.is_dir() and _labels_in(folder, data_set):
                yield folder


def _labels_in(folder: Path, data_set: DataSet) -> list[str]:
    return [name for name in data_set.labels if (folder / name).is_file()]


def _check_labels(folder: Path, data_set: DataSet) -> None:
    there = _labels_in(folder, data_set)
    if len(there) < len(data_set.labels):
        absent = next(name for name in data_set.labels if name not in there)
        raise FormatError(
            folder, f"expected {' and '.join(data_set.labels)}, found no {absent}: is this scene "
            "whole? Mend it, or leave it out with --scenes"
        )  # fmt: skip


def _scene_of(name: str, data_set: DataSet) -> str | None:
    """The scene that a folder is named after: by a word of the name, or by all its letters."""
    words = {*re.findall(r"[a-z]+", name.lower()), re.sub(r"[^a-z]", "", name.lower())}
    return next((scene for scene in data_set.scenes if scene.lower() in words), None)
