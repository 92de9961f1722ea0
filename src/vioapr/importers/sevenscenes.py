"""7-Scenes: a scene's folder with `seq-XX` folders and TrainSplit.txt, or one such sequence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from vioapr.errors import FormatError
from vioapr.files.text import natural_key, read_text, require_folder
from vioapr.formats import sevenscenes
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    labelled_walk,
    require_one,
)
from vioapr.importers.reading import read_noted
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
    split_of: dict[int, str] = {}
    if next(source.glob(_POSES), None) is not None:
        folders = [source]
        name = source.resolve().parent.name
    else:
        folders = [p.parent for p in source.glob("*/frame-000000.pose.txt")]
        folders = folders or sorted({p.parent for p in source.glob(f"*/{_POSES}")})
        if not folders:
            problem = "expected folders seq-XX of frame-XXXXXX.pose.txt, found none"
            raise FormatError(source, problem)
        folders.sort(key=lambda folder: natural_key(folder.name))
        split_of = read_splits(source, {_number(folder.name) for folder in folders})
        name = source.resolve().name
    require_one(source, options, len(folders))

    def walks() -> Iterator[Walk]:
        for folder in folders:
            reading = read_noted(sevenscenes.read, folder, options)
            walk = labelled_walk(
                options.id or id_of(folder.resolve().name),
                options.split_or(split_of.get(_number(folder.name))),
                folder,
                "7-Scenes",
                reading.trajectory,
                reading.names,
                [folder / name.split("/")[-1] for name in reading.names],
                options.rate_hz or _RATE_HZ,
                _CAMERA,
            )
            reading.say(walk)
            walk.note("intrinsics: the nominal 525 px of the colour camera")
            yield walk

    return [ImportedScene(name, "indoor", _WORLD, len(folders), walks)]


def read_splits(source: Path, numbers: set[int]) -> dict[int, str]:
    """The split of each sequence's number, by a scene's TrainSplit.txt and TestSplit.txt.

    Args:
        source: The scene's folder.
        numbers: Of the sequences that are there.

    Raises:
        FormatError: A file names another sequence.
    """
    split_of: dict[int, str] = {}
    for split, name in (("train", "TrainSplit.txt"), ("test", "TestSplit.txt")):
        path = source / name
        lines = read_text(path).splitlines() if path.exists() else []
        for line, text in enumerate(lines, start=1):
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


IMPORTER = Importer(
    name="7scenes",
    title="7-Scenes",
    layout="a scene's folder with seq-XX and TrainSplit.txt, TestSplit.txt, or one seq-XX",
    read=read,
    uses=frozenset({"rate_hz"}),
)
