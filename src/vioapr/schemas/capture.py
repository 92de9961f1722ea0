"""`capture.json`: what a client says of a capture whose files it sends to the server."""

from __future__ import annotations

from typing import ClassVar, Literal

from vioapr.schemas.base import Document, Record


class CaptureConventions(Record, frozen=True, forbid_unknown_fields=True):
    """The conventions of every capture: those of a browser, which the server converts."""

    pose: Literal["vio_from_arcam"] = "vio_from_arcam"
    vio_axes: Literal["right-handed, y up"] = "right-handed, y up"
    cam_axes: Literal["x right, y up, looking along -z"] = "x right, y up, looking along -z"
    device_axes: Literal["x right, y up, z to the person"] = "x right, y up, z to the person"
    quaternion: Literal["Hamilton, x y z w"] = "Hamilton, x y z w"
    units: Literal["metres, seconds, pixels, degrees"] = "metres, seconds, pixels, degrees"


class CaptureDocument(Document, frozen=True, kw_only=True):
    """What a capture's logs do not say themselves; members that are missing have defaults.

    Attributes:
        conventions: The same in every capture.
        device: The phone, for people; "" if not known.
        tracker: What tracked it.
        is_acceleration_reversed: Whether acceleration has the opposite of W3C's sign, as on iOS:
            of a phone flat on a table, z is then negative.
    """

    FORMAT: ClassVar[str] = "vioapr capture"
    VERSION: ClassVar[int] = 1

    conventions: CaptureConventions = CaptureConventions()
    device: str = ""
    tracker: str = "WebXR"
    is_acceleration_reversed: bool = False
