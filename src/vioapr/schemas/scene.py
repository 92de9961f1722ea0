"""`scene.toml`: a place, the splits of its recordings and the frame of its map."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from vioapr.schemas.base import Document, Record


class GeodeticOrigin(Record, frozen=True):
    """Where the world's origin is on the earth, WGS 84; its x is east and its y is north."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0


class World(Record, frozen=True):
    """The frame of map and ground truth: right-handed, z up.

    Attributes:
        is_metric: Whether lengths are metres.
        is_gravity_aligned: Whether z is up along gravity.
        origin: The place of a georeferenced world, or None.
    """

    is_metric: bool = True
    is_gravity_aligned: bool = True
    origin: GeodeticOrigin | None = None


class Splits(Record, frozen=True, forbid_unknown_fields=True):
    """Ids of the recordings to train and to test with."""

    train: tuple[str, ...] = ()
    test: tuple[str, ...] = ()


class SceneDocument(Document, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The members of `scene.toml`.

    Attributes:
        name: The scene's, for people.
        is_outdoor: Outdoors or indoors.
        splits: Ids by split.
        excluded: Ids of recordings that are in neither split on purpose, and why.
        world: The frame of map and ground truth.
    """

    VERSION: ClassVar[int] = 1

    name: str
    is_outdoor: bool
    splits: Splits = Splits()
    excluded: dict[str, str] = msgspec.field(default_factory=dict)
    world: World = World()
