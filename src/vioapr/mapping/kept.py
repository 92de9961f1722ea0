"""What is in a scene before it is mapped and is not mapping's: it is kept.

Ground truth of others has a world of its own, which is not the map's. So, if any recording has
such, all of mapping's goes into the map's folder, unless it is to be replaced.
"""

from __future__ import annotations

import os
import shutil
from fnmatch import fnmatch
from pathlib import Path

from vioapr.errors import AlreadyExistsError, FileError, UnwritableError
from vioapr.files.atomic import partial_beside, replace_folder
from vioapr.scene.gt_origin import origin_path
from vioapr.scene.scene import GT_FOLDER, MAP_FOLDER, Scene
from vioapr.schemas.base import decode
from vioapr.schemas.map_summary import MapSummary

SUMMARY_FILE = "map.json"
MAP_GT_FOLDER = f"{MAP_FOLDER}/{GT_FOLDER}"

_MODEL_FILES = ("cameras", "frames", "images", "points3D", "rigs")
_OWN_PATTERNS = (
    *(f"{name}.bin" for name in _MODEL_FILES),
    SUMMARY_FILE,
    f"{GT_FOLDER}/*.tum",
    f"{GT_FOLDER}/*.origin.json",
    "report/index.html",
    "report/vio.json",
    "report/figures/*.png",
    "report/figures/*.svg",
)
"""Of the paths in the map's folder that mapping writes."""


def foreign_gt_ids(scene: Scene) -> list[str]:
    """Ids of the recordings whose ground truth mapping did not write."""
    return [
        id_
        for id_ in scene.recording_ids
        if scene.gt_path(id_).exists()
        and ((origin := scene.gt_origin(id_)) is None or origin.writer != "mapping")
    ]


def back_up_gt(scene: Scene, ids: list[str]) -> Path:
    """Copy ground truth, with its origin, into a new folder beside `gt/`.

    Returns:
        The folder, `gt.backup-<number>`.

    Raises:
        UnwritableError: It cannot be written.
    """
    number = 1
    while (folder := scene.folder / f"{GT_FOLDER}.backup-{number}").exists():
        number += 1
    partial = partial_beside(folder)
    try:
        partial.mkdir()
        for id_ in ids:
            for path in (scene.gt_path(id_), origin_path(scene.gt_path(id_))):
                if path.exists():
                    shutil.copy2(path, partial)
        replace_folder(folder, partial)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder


def check_map_folder(scene: Scene) -> None:
    """Refuse a map's folder with files of a map's names that are not mapping's.

    Raises:
        AlreadyExistsError: There are such.
    """
    folder = scene.map_folder
    if folder.exists() and not folder.is_dir():
        raise AlreadyExistsError(folder, "expected a folder for the map, found a file")
    taken = [path.name for path in _files(folder) if _is_own_name(folder, path)]
    if taken and not _is_mappings(folder / SUMMARY_FILE):
        raise AlreadyExistsError(
            folder,
            f"holds a map that vioapr did not make ({', '.join(sorted(taken)[:3])}): move or "
            "rename the folder, then map again",
        )


def carry_files(folder: Path, partial: Path) -> None:
    """Bring files that mapping did not write from a map's folder to the one that replaces it.

    Args:
        folder: The map's.
        partial: The new one.

    Raises:
        OSError: They cannot be copied.
    """
    for path in _files(folder):
        if not _is_own_name(folder, path):
            target = partial / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(path, target, follow_symlinks=False)
            except OSError:  # file systems without hard links
                shutil.copy2(path, target, follow_symlinks=False)


def _files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_symlink() or path.is_file()]


def _is_own_name(folder: Path, path: Path) -> bool:
    name = path.relative_to(folder).as_posix()
    return any(fnmatch(name, pattern) for pattern in _OWN_PATTERNS)


def _is_mappings(path: Path) -> bool:
    """Whether a map's summary is one of ours."""
    try:
        decode(path, path.read_text(encoding="utf-8"), MapSummary)
    except (OSError, ValueError, FileError):
        return False
    return True
