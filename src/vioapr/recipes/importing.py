"""Importing a data set's scenes: whole recordings stay, what is missing is added."""

from __future__ import annotations

import json
from pathlib import Path

from vioapr.errors import FormatError
from vioapr.files.text import read_text, write_text
from vioapr.importers.base import ImportOptions, Walk
from vioapr.importers.diagnostics import judge
from vioapr.importers.registry import get_importer
from vioapr.importers.write import open_or_create, write_walk
from vioapr.recipes.datasets import DataSet
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.work.progress import Progress

IMPORTED_FILE = "imported.json"


def import_scene(data_set: DataSet, source: Path, folder: Path, progress: Progress) -> Scene:
    """Import a scene, or what of it has not been imported yet.

    Args:
        data_set: Whose scene.
        source: Its folder in the data set.
        folder: Where it goes.
        progress: As of `import_source`.

    Raises:
        FormatError: The source is broken or half a scene, or the folder is something else's.
    """
    note = folder / IMPORTED_FILE
    if note.exists():
        _check_source(note, source)
        return _check_splits(Scene.open(folder), source)
    (imported,) = get_importer(data_set.name).read(source, ImportOptions())
    scene = open_or_create(folder, imported, None)
    for walk in imported.read():
        if not _is_imported(scene, walk):
            judge(walk)
            with progress(f"importing {folder.name}/{walk.id}", len(walk)) as tick:
                scene = write_walk(scene, walk, link=True, tick=tick)
    scene = _check_splits(scene, source)
    write_text(note, json.dumps({"source": str(source.resolve())}) + "\n")
    return scene


def _is_imported(scene: Scene, walk: Walk) -> bool:
    entered = {id_ for ids in scene.splits.values() for id_ in ids} | set(scene.excluded)
    if walk.id in entered:
        return True
    if scene.recording_folder(walk.id).exists() or scene.gt_path(walk.id).exists():
        raise FormatError(
            scene.folder, f"expected recordings that {SCENE_FILE} names, found {walk.id!r} besides:"
            " the import was cut off; remove this folder and run again"
        )  # fmt: skip
    return False


def _check_source(note: Path, source: Path) -> None:
    try:
        before = json.loads(read_text(note))["source"]
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(note, f"expected the note of an import: {error}") from None
    if before != str(source.resolve()):
        raise FormatError(
            note.parent, f"expected the scene of {source}, found the one of {before}: "
            "use another --out"
        )  # fmt: skip


def _check_splits(scene: Scene, source: Path) -> Scene:
    for split in ("train", "test"):
        if not scene.splits.get(split):
            raise FormatError(
                source, f"expected recordings to {split} with, found none that can be used: "
                "mend the scene, or leave it out with --scenes"
            )  # fmt: skip
    return scene
