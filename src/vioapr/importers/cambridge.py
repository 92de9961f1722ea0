"""Cambridge Landmarks: a scene's folder with `dataset_train.txt`, `dataset_test.txt`, `seqN/`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.text import natural_key, require_folder
from vioapr.formats import cambridge
from vioapr.formats.notes import ReadingNote
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    labelled_walk,
    require_one,
)
from vioapr.importers.reading import Reading, read_noted
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
    sequences: dict[tuple[str, str], FolderLabels] = {}
    for split in ("train", "test"):
        path = source / f"dataset_{split}.txt"
        if path.exists():
            reading = read_noted(cambridge.FORMAT.read, path, options)
            for name, sequence in by_folder(reading).items():
                sequences[name, split] = sequence
    if not sequences:
        raise FormatError(source, "expected dataset_train.txt or dataset_test.txt, found none")
    require_one(source, options, len(sequences))
    folders = [name for name, _ in sequences]

    def walks() -> Iterator[Walk]:
        for (name, split), sequence in sequences.items():
            is_in_both = folders.count(name) > 1
            id_ = options.id or id_of(f"{name}-{split}" if is_in_both else name)
            walk = labelled_walk(
                id_,
                options.split_or(split),
                source,
                "Cambridge Landmarks",
                sequence.labels,
                sequence.names,
                [source / image for image in sequence.names],
                options.rate_hz or _RATE_HZ,
                Intrinsics(),
            )
            for note in sequence.notes:
                (walk.warn if note.is_warning else walk.note)(note.text)
            yield walk

    name = source.resolve().name
    return [ImportedScene(name, "outdoor", _WORLD, len(sequences), walks)]


class FolderLabels(NamedTuple):
    """The images of one folder.

    Attributes:
        names: Of all images, in natural order.
        labels: Poses of most of them.
        notes: What the reader of the file says; of a file, its first sequence has them.
    """

    names: list[str]
    labels: Trajectory
    notes: tuple[ReadingNote, ...]


def by_folder(reading: Reading) -> dict[str, FolderLabels]:
    """The sequences of a file, by the folder part of its names, in natural order.

    A folder of which no image has a pose is left out.
    """
    names: dict[str, list[str]] = {}
    rows: dict[str, list[int]] = {}
    for name in reading.names:
        names.setdefault(str(PurePosixPath(name).parent), []).append(name)
    for row, name in enumerate(reading.trajectory.names or ()):
        rows.setdefault(str(PurePosixPath(name).parent), []).append(row)
    found: dict[str, FolderLabels] = {}
    for folder in sorted(rows, key=natural_key):
        labels = reading.trajectory.at_rows(np.array(rows[folder]))
        found[folder] = FolderLabels(names[folder], labels, () if found else reading.notes)
    return found


IMPORTER = Importer(
    name="cambridge",
    title="Cambridge Landmarks",
    layout="a scene's folder with dataset_train.txt, dataset_test.txt and the images",
    read=read,
    uses=frozenset({"rate_hz"}),
)
