"""`recording.json`: what made a recording, and in which conventions it is."""

from __future__ import annotations

from typing import ClassVar, Literal

from vioapr.schemas.base import Document, Record

Clock = Literal["device", "frame-rate"]


class Conventions(Record, frozen=True, forbid_unknown_fields=True):
    """The conventions of every recording; readers refuse others.

    They are in the file for those who read it alone.
    """

    pose: Literal["vio_from_cam"] = "vio_from_cam"
    vio_axes: Literal["right-handed, y up"] = "right-handed, y up"
    cam_axes: Literal["x right, y down, z forward"] = "x right, y down, z forward"
    quaternion: Literal["Hamilton, x y z w"] = "Hamilton, x y z w"
    units: Literal["metres, seconds, pixels"] = "metres, seconds, pixels"


class RecordingInfo(Document, frozen=True, kw_only=True):
    """What a recording's files do not say themselves; members that are missing have defaults.

    Attributes:
        conventions: The same in every recording.
        device: The phone, e.g. "iPhone 14 Pro"; "" if not known.
        tracker: What tracked it, e.g. "ARKit", "ARCore", "simulated"; "" if nothing did: then
            no frame has a pose.
        source: What the recording was made from, e.g. "Stray Scanner"; "" for a capture.
        has_images: Whether there are images; some data sets hold poses alone.
        clock: "device" for timestamps that were measured; "frame-rate" for those counted from
            frame numbers at an assumed rate.
        is_metric: Whether VIO positions are in metres.
        is_gravity_aligned: Whether y is up in the tracker's world.
        is_diverging: Whether the tracker ran away, so that its poses are of no use.
        notes: What was found out on importing, a line each.
    """

    FORMAT: ClassVar[str] = "vioapr recording"
    VERSION: ClassVar[int] = 1

    conventions: Conventions = Conventions()
    device: str = ""
    tracker: str = ""
    source: str = ""
    has_images: bool = True
    clock: Clock = "device"
    is_metric: bool = True
    is_gravity_aligned: bool = True
    is_diverging: bool = False
    notes: tuple[str, ...] = ()
