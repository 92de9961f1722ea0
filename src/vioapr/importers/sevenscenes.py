"""7-Scenes: a scene's folder with `seq-XX` folders and TrainSplit.txt, or one such sequence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.files.text import natural_key, read_text
from vioapr.formats import sevenscenes
from vioapr.formats.base import ReadOptions
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    require_folder,
)
from vioapr.importers.labelled import labelled_walk
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.scene import World

_RATE_HZ = 30.0
_POSES = "*.pose.txt"
# Of the Kinect's colour camera; the 585 px often seen are the depth camera's.
_CAMERA = Intrinsics(640, 480, 525.0, 525.0, 320.0, 240.0)
# KinectFusion's world is that of its first frame.
_WORLD = World(is_gravity_aligned=False)


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A scene's or a sequence's folder.

    Raises:
        FormatError: It is none, or its split files name sequences that are not there.
    """
    require_folder(source, "a 7-Scenes folder")
    if next(source.glob(_POSES), None) is not None:
        folders = {source: options.split_or(None)}
    else:
        folders = _find_sequences(source, options)
    if options.id is not None and len(folders) > 1:
        raise ParameterError(f"--id names one recording, and {source} holds {len(folders)}")

    def walks() -> Iterator[Walk]:
        for folder, split in folders.items():
            yield _read_sequence(folder, split, options)

    name = source.resolve().parent.name if source in folders else source.resolve().name
    return [ImportedScene(name, "indoor", _WORLD, len(folders), walks)]


def _find_sequences(source: Path, options: ImportOptions) -> dict[Path, str | None]:
    found = [p.parent for p in source.glob("*/frame-000000.pose.txt")]
    found = found or sorted({p.parent for p in source.glob(f"*/{_POSES}")})
    if not found:
        raise FormatError(source, "expected folders seq-XX of frame-XXXXXX.pose.txt, found none")
    found.sort(key=lambda folder: natural_key(folder.name))
    split_of = _read_splits(source, {_number(folder.name) for folder in found})
    return {folder: options.split_or(split_of.get(_number(folder.name))) for folder in found}


def _read_splits(source: Path, numbers: set[int]) -> dict[int, str]:
    """The split of each sequence's number."""
    split_of: dict[int, str] = {}
    for split, name in (("train", "TrainSplit.txt"), ("test", "TestSplit.txt")):
        path = source / name
        if not path.exists():
            continue
        for line, text in enumerate(read_text(path).splitlines(), start=1):
            if not text.strip():
                continue
            number = _number(text)
            if number not in numbers:
                raise FormatError(path, f"expected a sequence that is there, got {text!r}", line)
            split_of[number] = split
    return split_of


def _number(name: str) -> int:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else -1


def _read_sequence(folder: Path, split: str | None, options: ImportOptions) -> Walk:
    labels = sevenscenes.read(folder, ReadOptions())
    assert labels.names is not None
    images = [folder / name.split("/")[-1] for name in labels.names]
    id_ = options.id or id_of(folder.resolve().name)
    rate_hz = options.rate_hz or _RATE_HZ
    walk = labelled_walk(id_, split, folder, "7-Scenes", labels, images, rate_hz, _CAMERA)
    walk.note("intrinsics: the nominal 525 px of the colour camera")
    return walk


IMPORTER = Importer(
    name="7scenes",
    title="7-Scenes",
    layout="a scene's folder with seq-XX and TrainSplit.txt, TestSplit.txt, or one seq-XX",
    read=read,
    uses=frozenset({"rate_hz"}),
)
