"""Cambridge Landmarks: a scene's folder with `dataset_train.txt`, `dataset_test.txt`, `seqN/`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.text import natural_key, require_folder
from vioapr.formats import cambridge
from vioapr.formats.base import ReadOptions
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    labelled_walk,
    require_one,
)
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory

_RATE_HZ = 2.0
_WORLD = World(is_gravity_aligned=False)


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A scene's folder.

    Raises:
        FormatError: It has no labels.
    """
    require_folder(source, "a Cambridge Landmarks folder")
    sequences: dict[tuple[str, str], Trajectory] = {}
    for split in ("train", "test"):
        path = source / f"dataset_{split}.txt"
        if path.exists():
            labels = cambridge.FORMAT.read(path, ReadOptions())
            for name, rows in rows_by_folder(labels).items():
                sequences[name, split] = labels.at_rows(rows)
    if not sequences:
        raise FormatError(source, "expected dataset_train.txt or dataset_test.txt, found none")
    require_one(source, options, len(sequences))
    folders = [name for name, _ in sequences]

    def walks() -> Iterator[Walk]:
        for (name, split), labels in sequences.items():
            is_in_both = folders.count(name) > 1
            id_ = options.id or id_of(f"{name}-{split}" if is_in_both else name)
            assert labels.names is not None
            yield labelled_walk(
                id_,
                options.split_or(split),
                source,
                "Cambridge Landmarks",
                labels,
                [source / image for image in labels.names],
                options.rate_hz or _RATE_HZ,
                Intrinsics(),
            )

    name = source.resolve().name
    return [ImportedScene(name, "outdoor", _WORLD, len(sequences), walks)]


def rows_by_folder(trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Rows of a trajectory with names, by the folder part of the names, in natural order."""
    assert trajectory.names is not None
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(trajectory.names):
        rows.setdefault(str(PurePosixPath(name).parent), []).append(row)
    ordered = sorted(rows, key=natural_key)
    return {name: np.array(rows[name]) for name in ordered}


IMPORTER = Importer(
    name="cambridge",
    title="Cambridge Landmarks",
    layout="a scene's folder with dataset_train.txt, dataset_test.txt and the images",
    read=read,
    uses=frozenset({"rate_hz"}),
)
