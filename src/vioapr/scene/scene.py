"""Scene: a place, with its recordings, their splits, its map and ground truth."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from vioapr.errors import AlreadyExistsError, FormatError, ParameterError
from vioapr.files.paths import AnyPath
from vioapr.files.text import read_text, require_folder, write_text
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.scene.gt_origin import read_origin, write_gt_file
from vioapr.scene.recording import Recording
from vioapr.schemas.base import check_version, convert, to_plain
from vioapr.schemas.scene import SceneDocument, World
from vioapr.schemas.written import GroundTruthOrigin, Writer
from vioapr.trajectory import Trajectory

SCENE_FILE, RECORDINGS_FOLDER, GT_FOLDER, MAP_FOLDER = "scene.toml", "recordings", "gt", "map"
CACHE_FOLDER = ".cache"
"""Of a scene: decoded images, made again where they are missing."""
SPLITS = ("train", "test")


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene's folder; see docs/reference/scene.md.

    Attributes:
        folder: Where it is.
        name: For people.
        is_outdoor: Outdoors or indoors.
        splits: Ids of the recordings for "train" and for "test".
        excluded: Ids of recordings that are in neither on purpose, and why.
        world: The frame of map and ground truth.
        gt_folder: Where ground truth is in the folder; a map has its own in `map/gt` where the
            scene's is not of its world.
    """

    folder: Path
    name: str
    is_outdoor: bool
    splits: Mapping[str, Sequence[str]] = field(default_factory=lambda: dict.fromkeys(SPLITS, ()))
    excluded: Mapping[str, str] = field(default_factory=dict[str, str])
    world: World = field(default_factory=World)
    gt_folder: str = GT_FOLDER

    @staticmethod
    def create(
        folder: AnyPath, name: str, *, is_outdoor: bool, world: World | None = None
    ) -> Scene:
        """Make an empty scene.

        Raises:
            AlreadyExistsError: There is one already.
            UnwritableError: It cannot be written.
        """
        folder = Path(folder)
        if (folder / SCENE_FILE).exists():
            raise AlreadyExistsError(
                folder / SCENE_FILE, "expected to make a new scene, but it exists"
            )
        scene = Scene(folder, name, is_outdoor, world=world or World())
        scene.save()
        return scene

    @staticmethod
    def open(folder: AnyPath) -> Scene:
        """Open a scene.

        Raises:
            FileMissingError: It is not there, or its `scene.toml` is not.
            FormatError: It is no folder, or its `scene.toml` is broken.
            VersionError: Its `scene.toml` is of a later version.
        """
        folder = Path(folder)
        require_folder(folder, "a scene's folder")
        path = folder / SCENE_FILE
        content = _load_toml(path).unwrap()
        check_version(path, content, SceneDocument)
        members = {key: value for key, value in content.items() if key != "version"}
        read = convert(path, members, SceneDocument)
        splits = {"train": read.splits.train, "test": read.splits.test}
        return Scene(folder, read.name, read.is_outdoor, splits, read.excluded, read.world)

    @property
    def recording_ids(self) -> list[str]:
        """Ids of all recordings on disk, in order of name."""
        folder = self.folder / RECORDINGS_FOLDER
        if not folder.is_dir():
            return []
        return sorted(
            path.name for path in folder.iterdir() if path.is_dir() and path.name[:1] != "."
        )

    @property
    def recordings(self) -> dict[str, Recording]:
        """All recordings by id, in order of name.

        Raises:
            FormatError: One cannot be opened.
        """
        return {id_: self.recording(id_) for id_ in self.recording_ids}

    @property
    def map_folder(self) -> Path:
        """Where the map is or will be."""
        return self.folder / MAP_FOLDER

    def tables(self) -> list[Path]:
        """All files that say something of the place and its recordings: all but images and map."""
        recordings = (self.folder / RECORDINGS_FOLDER).glob("*/*")
        gt = (self.folder / GT_FOLDER).glob("*")
        return [self.folder / SCENE_FILE, *(path for path in (*recordings, *gt) if path.is_file())]

    def recording_folder(self, id_: str) -> Path:
        """Where a recording is or will be."""
        return self.folder / RECORDINGS_FOLDER / check_id(id_)

    def recording(self, id_: str) -> Recording:
        """Open one recording.

        Raises:
            FormatError: It is not there, or broken.
        """
        return Recording.open(self.recording_folder(id_))

    def gt_path(self, id_: str) -> Path:
        """Where a recording's ground truth is or will be."""
        return self.folder / self.gt_folder / f"{check_id(id_)}.tum"

    def gt(self, id_: str) -> Trajectory | None:
        """Ground truth world_from_cam of a recording's frames, by their timestamps, or None.

        Raises:
            FormatError: It is there, and broken.
        """
        path = self.gt_path(id_)
        return tum.read(path, ReadOptions()) if path.exists() else None

    def gt_origin(self, id_: str) -> GroundTruthOrigin | None:
        """Who wrote a recording's ground truth; None if it is the user's, or there is none."""
        return read_origin(self.gt_path(id_))

    def write_gt(
        self, id_: str, world_from_cam: Trajectory, writer: Writer | None = None, source: str = ""
    ) -> None:
        """Write a recording's ground truth; what was there is replaced as a whole.

        Args:
            id_: The recording.
            world_from_cam: Of its frames.
            writer: The part of vioapr that writes it; None for the user.
            source: What it is made from, for people.

        Raises:
            UnwritableError: It cannot be written; what was there stays.
        """
        write_gt_file(self.gt_path(id_), world_from_cam, writer, source)

    def with_recording(self, id_: str, split: str | None) -> Scene:
        """The scene with a recording in a split, or, if None, in neither."""
        if split not in (None, *SPLITS):
            raise ParameterError(f"expected a split of {', '.join(SPLITS)}, got {split!r}")
        check_id(id_)
        splits = {
            name: tuple(other for other in self.splits.get(name, ()) if other != id_)
            + ((id_,) if name == split else ())
            for name in SPLITS
        }
        excluded = {other: why for other, why in self.excluded.items() if other != id_}
        return replace(self, splits=splits, excluded=excluded)

    def with_excluded(self, id_: str, why: str) -> Scene:
        """The scene with a recording in neither split, and the reason."""
        scene = self.with_recording(id_, None)
        return replace(scene, excluded={**scene.excluded, id_: why})

    def save(self) -> None:
        """Write `scene.toml`; comments in it, and the order of its members, stay.

        Raises:
            FileError: It cannot be read or written; what was there stays.
        """
        path = self.folder / SCENE_FILE
        document = _load_toml(path) if path.exists() else tomlkit.document()
        document["version"] = SceneDocument.VERSION
        document["name"] = self.name
        document["is_outdoor"] = self.is_outdoor
        splits = tomlkit.table()
        for split in SPLITS:
            ids = tomlkit.item(list(self.splits.get(split, ())))
            splits[split] = ids.multiline(len(ids) > 4)
        document["splits"] = splits
        if self.excluded or "excluded" in document:
            document["excluded"] = dict(self.excluded)
        world = tomlkit.table()
        for key, value in to_plain(self.world).items():
            if value is not None:
                world[key] = value
        document["world"] = world
        write_text(path, tomlkit.dumps(document))


def check_id(id_: str) -> str:
    """A recording's id, which must be usable as a folder's name everywhere.

    Raises:
        ParameterError: It is not.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", id_):
        raise ParameterError(
            f"expected a recording's id of letters, digits, '-', '_' and '.', got {id_!r}"
        )
    return id_


def _load_toml(path: Path) -> tomlkit.TOMLDocument:
    """The document with its comments."""
    try:
        return tomlkit.parse(read_text(path))
    except TOMLKitError as error:
        line = getattr(error, "line", None)
        raise FormatError(path, f"expected TOML: {error}", line) from None
