"""The header of a point map, which `vioapr predict --model map` localizes images in."""

from __future__ import annotations

from typing import ClassVar

from vioapr.schemas.base import Document, Record


class CameraModel(Record, frozen=True):
    """A camera as COLMAP models it.

    Attributes:
        model: COLMAP's name of the model, e.g. "PINHOLE".
        width: Of the images, pixels.
        height: Of the images, pixels.
        params: Of the model, in COLMAP's order.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]


class PointMapHeader(Document, frozen=True):
    """What a point map is made from.

    Attributes:
        key: Changes with all that it was made from.
        source: For people: a map's folder, or whose ground truth.
        is_gravity_aligned: Whether the world's z axis is up.
        shares_cameras: Whether images of about the same focal length share a camera.
        names: Of its images.
        cameras: Different ones, the most frequent first.
        max_image_size: Images were scaled down to this many pixels along their longer side.
        max_features: Features of an image at most.
        sigma_position_m: What the map itself adds to the standard deviation of positions, an axis;
            None if its images are too few to tell.
        sigma_orientation_deg: As of positions.
    """

    FORMAT: ClassVar[str] = "vioapr-point-map"
    VERSION: ClassVar[int] = 1

    key: str
    source: str
    is_gravity_aligned: bool
    shares_cameras: bool
    names: tuple[str, ...]
    cameras: tuple[CameraModel, ...]
    max_image_size: int
    max_features: int
    sigma_position_m: float | None
    sigma_orientation_deg: float | None
