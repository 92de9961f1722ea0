"""The data sets that can be reproduced: their scenes, found in a folder and imported."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vioapr.errors import FileMissingError, FormatError, ParameterError
from vioapr.files.text import read_text, write_text
from vioapr.importers.base import ImportOptions
from vioapr.importers.diagnostics import diagnose
from vioapr.importers.registry import get_importer
from vioapr.importers.write import WriteSettings, open_or_create, write_recording
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.schemas.base import decode, encode
from vioapr.schemas.reproduction import ImportNote, Place
from vioapr.work.progress import Progress

IMPORTED_FILE = "imported.json"


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

    def scene_of(self, folder_name: str) -> str | None:
        """The scene that a folder is named after: by a word of the name, or all its letters."""
        letters = folder_name.lower()
        words = {*re.findall(r"[a-z]+", letters), re.sub(r"[^a-z]", "", letters)}
        return next((scene for scene in self.scenes if scene.lower() in words), None)

    def labels_in(self, folder: Path) -> list[str]:
        """The label files that a folder has."""
        return [name for name in self.labels if (folder / name).is_file()]


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
    """The scenes of a data set that a folder holds.

    Attributes:
        folders: Of the scenes that are there, in the data set's order.
        missing: Wanted scenes that are not.
        unknown: Folders that look like scenes and are none of the data set's.
    """

    folders: dict[str, Path]
    missing: tuple[str, ...] = ()
    unknown: tuple[Path, ...] = field(default=())


def choose_scenes(data_set: DataSet, names: Sequence[str]) -> tuple[str, ...]:
    """Choose scenes by name, in the data set's order; all of them for no names.

    Raises:
        ParameterError: One is not of the data set.
    """
    of_key = {scene.lower(): scene for scene in data_set.scenes}
    for name in names:
        if name.lower() not in of_key:
            raise ParameterError(
                f"scenes: expected some of {', '.join(data_set.scenes)}, got {name!r}"
            )
    wanted = {of_key[name.lower()] for name in names}
    return tuple(scene for scene in data_set.scenes if not names or scene in wanted)


def find_scenes(data: Path, data_set: DataSet, wanted: Sequence[str]) -> FoundScenes:
    """Find the wanted scenes: folders of their names, in `data` or one folder deeper.

    Raises:
        FileMissingError: There is no such folder.
        FormatError: It is no data set, holds none of the scenes, a scene twice, or half of one.
    """
    if not data.exists():
        raise FileMissingError(
            data, f"expected the folder of {data_set.title}, found nothing of this name"
        )
    if not data.is_dir():
        raise FormatError(data, f"expected the folder of {data_set.title}, found a file")
    if data_set.labels_in(data):
        raise FormatError(
            data, f"expected a folder with scenes' folders, found one scene's {data_set.labels[0]}:"
            " give the folder above it, and `scenes` to have only this one"
        )  # fmt: skip
    folders: dict[str, Path] = {}
    unknown = []
    for folder in (path for pattern in ("*", "*/*") for path in sorted(data.glob(pattern))):
        if not (folder.is_dir() and data_set.labels_in(folder)):
            continue
        scene = data_set.scene_of(folder.name)
        if scene is None:
            unknown.append(folder)
        elif scene in folders:
            problem = f"expected one folder of the scene {scene}, found also {folders[scene]}"
            raise FormatError(folder, problem)
        else:
            folders[scene] = folder
    chosen = {scene: folders[scene] for scene in wanted if scene in folders}
    labels = " and ".join(data_set.labels)
    if not chosen:
        raise FormatError(
            data, f"expected scenes of {data_set.title}: folders named {', '.join(wanted)} with "
            f"{labels}; found none"
        )  # fmt: skip
    for folder in chosen.values():
        for absent in set(data_set.labels) - set(data_set.labels_in(folder)):
            raise FormatError(
                folder, f"expected {labels}, found no {absent}: is this scene whole? Mend it, or "
                "leave it out by `scenes`"
            )  # fmt: skip
    missing = tuple(scene for scene in wanted if scene not in folders)
    return FoundScenes(chosen, missing, tuple(unknown))


def import_scene(data_set: DataSet, source: Path, folder: Path, progress: Progress) -> Scene:
    """Import a scene, or those of its recordings that have not been imported yet.

    Args:
        data_set: Whose scene.
        source: Its folder in the data set.
        folder: Where it goes.
        progress: As of `import_source`.

    Raises:
        FormatError: The source is broken or half a scene, or the folder is something else's.
    """
    note, origin = folder / IMPORTED_FILE, str(source.resolve())
    is_done = note.exists()
    if is_done:
        before = decode(note, read_text(note), ImportNote).source
        if before != origin:
            raise FormatError(
                folder, f"expected the scene of {source}, found the one of {before}: "
                "use another folder"
            )  # fmt: skip
        scene = Scene.open(folder)
    else:
        (imported,) = get_importer(data_set.name).read(source, ImportOptions())
        scene = open_or_create(folder, imported, None)
        for walk in imported.read():
            if any(walk.id in ids for ids in (*scene.splits.values(), scene.excluded)):
                continue
            if scene.recording_folder(walk.id).exists() or scene.gt_path(walk.id).exists():
                raise FormatError(
                    folder, f"expected recordings that {SCENE_FILE} names, found {walk.id!r} "
                    "besides: the import was cut off; remove this folder and run again"
                )  # fmt: skip
            diagnose(walk)
            with progress(f"importing {folder.name}/{walk.id}", len(walk)) as tick:
                scene = write_recording(scene, walk, WriteSettings(link=True), tick=tick)
    for split in ("train", "test"):
        if not scene.splits.get(split):
            raise FormatError(
                source, f"expected recordings to {split} with, found none that can be used: "
                "mend the scene, or leave it out by `scenes`"
            )  # fmt: skip
    if not is_done:
        write_text(note, encode(ImportNote(origin), indent=None))
    return scene
