"""`anchors.json`: content at map coordinates, for every client that draws it."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import msgspec

from vioapr.schemas.base import Document, Record

UNIT_TOLERANCE = 0.01
"""How far from 1 a quaternion's norm may be: people write few digits."""


class Anchor(Record, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A piece of content and its place in the map.

    Attributes:
        label: What people read beside it; "" for nothing.
        position_m: Where its foot stands, world coordinates: metres, z up.
        quat_xyzw: Rotation world_from_anchor, Hamilton, unit. The anchor's x is its front and its z
            is up; without a turn they are the world's.
        size_m: Its height, metres: a model is scaled to it, all axes alike.
        model: A glTF model (.glb or .gltf), a path from this file's folder; "" for the client's own
            marker. The model's +y is the anchor's z and its front, +z, is the anchor's x; the
            middle of its base stands at the position.
    """

    label: str = ""
    position_m: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    size_m: Annotated[float, msgspec.Meta(gt=0)] = 1.0
    model: str = ""

    def __post_init__(self) -> None:
        """Refuse numbers that are none and quaternions that are no rotations."""
        if not all(map(math.isfinite, (*self.position_m, *self.quat_xyzw, self.size_m))):
            raise ValueError("expected finite numbers, got NaN or infinity")
        norm = sum(value * value for value in self.quat_xyzw) ** 0.5
        if abs(norm - 1) > UNIT_TOLERANCE:
            raise ValueError(f"expected a unit quaternion quat_xyzw, got one of norm {norm:.4g}")


class AnchorsDocument(Document, frozen=True, kw_only=True):
    """The members of `anchors.json`.

    Attributes:
        scene: Name of the scene whose map the coordinates are of, for people.
        anchors: The content, at least one.
    """

    FORMAT: ClassVar[str] = "vioapr anchors"
    VERSION: ClassVar[int] = 1

    scene: str = ""
    anchors: Annotated[tuple[Anchor, ...], msgspec.Meta(min_length=1)]
