"""Scene: a place, with its recordings, their splits, its map and ground truth."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from vioapr.errors import AlreadyExistsError, FormatError, ParameterError, UnwritableError
from vioapr.files.text import read_text, write_text
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.scene.recording import Recording
from vioapr.trajectory import Trajectory

SCENE_FILE, RECORDINGS_FOLDER, GT_FOLDER, MAP_FOLDER = "scene.toml", "recordings", "gt", "map"
SPLITS = ("train", "test")
VERSION = 1
_KEYS = {"version", "name", "is_outdoor", "splits", "excluded", "world"}


@dataclass(frozen=True)
class GeodeticOrigin:
    """Where the world's origin is on the earth, WGS 84; its x is east and its y is north."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0


@dataclass(frozen=True)
class World:
    """The frame of map and ground truth: right-handed, z up.

    Attributes:
        is_metric: Whether lengths are metres.
        is_gravity_aligned: Whether z is up along gravity.
        origin: Of a georeferenced world, or None.
    """

    is_metric: bool = True
    is_gravity_aligned: bool = True
    origin: GeodeticOrigin | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene's folder; see docs/recordings.md.

    Attributes:
        folder: Where it is.
        name: For people.
        is_outdoor: Outdoors or indoors.
        splits: Ids of the recordings for "train" and for "test".
        excluded: Ids of recordings that are in neither on purpose, and why.
        world: The frame of map and ground truth.
    """

    folder: Path
    name: str
    is_outdoor: bool
    splits: Mapping[str, Sequence[str]] = field(default_factory=lambda: dict.fromkeys(SPLITS, ()))
    excluded: Mapping[str, str] = field(default_factory=dict)
    world: World = World()

    @staticmethod
    def create(folder: Path, name: str, *, is_outdoor: bool, world: World | None = None) -> Scene:
        """Make an empty scene.

        Raises:
            FormatError: There is one already, or it cannot be written.
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
    def open(folder: Path) -> Scene:
        """Open a scene.

        Raises:
            FormatError: It is not there, or its `scene.toml` is broken.
        """
        folder = Path(folder)
        if not folder.is_dir():
            found = "a file" if folder.exists() else "none of this name"
            raise FormatError(folder, f"expected a scene's folder, found {found}")
        path = folder / SCENE_FILE
        return _from_document(folder, _load(path).unwrap())

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
        return self.folder / GT_FOLDER / f"{check_id(id_)}.tum"

    def gt(self, id_: str) -> Trajectory | None:
        """Ground truth world_from_cam of a recording's frames, by their timestamps, or None.

        Raises:
            FormatError: It is there, and broken.
        """
        path = self.gt_path(id_)
        return tum.read(path, ReadOptions()) if path.exists() else None

    def write_gt(self, id_: str, world_from_cam: Trajectory) -> None:
        """Write a recording's ground truth; what was there is replaced as a whole.

        Raises:
            FormatError: It cannot be written; what was there stays.
        """
        path = self.gt_path(id_)
        partial = path.with_name(f".{path.name}.partial")
        _replace(partial, path, lambda: tum.write(partial, world_from_cam))

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
        """Write `scene.toml`; comments in it stay.

        Raises:
            FormatError: It cannot be written; what was there stays.
        """
        path = self.folder / SCENE_FILE
        document = _load(path) if path.exists() else tomlkit.document()
        _update(document, self)
        partial = path.with_name(f".{path.name}.partial")
        _replace(partial, path, lambda: write_text(partial, tomlkit.dumps(document)))


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


def _replace(partial: Path, path: Path, write) -> None:
    """Write to another name first, so that a full disk or a crash spares what was there."""
    try:
        write()
        partial.replace(path)
    except OSError as error:
        raise UnwritableError.of(path, error) from None
    finally:
        partial.unlink(missing_ok=True)


def _load(path: Path) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(read_text(path))
    except TOMLKitError as error:
        line = getattr(error, "line", None)
        raise FormatError(path, f"expected TOML: {error}", line) from None


def _update(document: tomlkit.TOMLDocument, scene: Scene) -> None:
    """Put a scene's values into a document, whatever else it has."""
    document["version"] = VERSION
    document["name"] = scene.name
    document["is_outdoor"] = scene.is_outdoor
    splits = tomlkit.table()
    for split in SPLITS:
        ids = tomlkit.array()
        ids.extend(scene.splits.get(split, ()))
        splits[split] = ids.multiline(len(ids) > 4)
    document["splits"] = splits
    if scene.excluded or "excluded" in document:
        document["excluded"] = dict(scene.excluded)
    world = tomlkit.table()
    world["is_metric"] = scene.world.is_metric
    world["is_gravity_aligned"] = scene.world.is_gravity_aligned
    if scene.world.origin is not None:
        world["origin"] = vars(scene.world.origin)
    document["world"] = world


def _from_document(folder: Path, content: dict[str, Any]) -> Scene:
    path = folder / SCENE_FILE

    def take(table: dict[str, Any], key: str, kind: type, default: Any = None) -> Any:
        value = table.get(key, default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind):
            names = {str: "text", bool: "true or false", dict: "a table", float: "a number"}
            found = "nothing" if value is None else repr(value)
            raise FormatError(path, f"expected {key} to be {names[kind]}, got {found}")
        return value

    if content.get("version") != VERSION:
        problem = f"expected version = {VERSION}, got {content.get('version')!r}: a newer vioapr's?"
        raise FormatError(path, problem)
    unknown = sorted(set(content) - _KEYS)
    if unknown:
        raise FormatError(path, f"expected only {', '.join(sorted(_KEYS))}, got {unknown[0]!r}")
    world = take(content, "world", dict, {})
    origin = take(world, "origin", dict, {})
    return Scene(
        folder,
        take(content, "name", str),
        take(content, "is_outdoor", bool),
        _take_splits(path, take(content, "splits", dict, {})),
        _take_excluded(path, take(content, "excluded", dict, {})),
        World(
            take(world, "is_metric", bool, True),
            take(world, "is_gravity_aligned", bool, True),
            GeodeticOrigin(
                take(origin, "latitude_deg", float),
                take(origin, "longitude_deg", float),
                take(origin, "altitude_m", float, 0.0),
            )
            if origin
            else None,
        ),
    )


def _take_splits(path: Path, table: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    for split, ids in table.items():
        if split not in SPLITS:
            raise FormatError(path, f"expected the splits {', '.join(SPLITS)}, got {split!r}")
        if not isinstance(ids, list) or not all(isinstance(id_, str) for id_ in ids):
            raise FormatError(path, f"expected splits.{split} to be a list of ids, got {ids!r}")
    return {split: tuple(table.get(split, ())) for split in SPLITS}


def _take_excluded(path: Path, table: dict[str, Any]) -> dict[str, str]:
    for id_, why in table.items():
        if not isinstance(why, str):
            raise FormatError(path, f"expected excluded.{id_} to be a reason, got {why!r}")
    return dict(table)
