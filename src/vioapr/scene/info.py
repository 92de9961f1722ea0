"""`recording.json`: what made a recording, and in which conventions it is."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

from vioapr.errors import FormatError
from vioapr.files.text import read_text, write_text
from vioapr.schemas.foreign_json import load_object

FORMAT = "vioapr recording"
VERSION = 1

CONVENTIONS = {
    "pose": "vio_from_cam",
    "vio_axes": "right-handed, y up",
    "cam_axes": "x right, y down, z forward",
    "quaternion": "Hamilton, x y z w",
    "units": "metres, seconds, pixels",
}
"""Of every recording; readers refuse others. They are in the file for those who read it alone."""

Clock = Literal["device", "frame-rate"]


@dataclass(frozen=True)
class RecordingInfo:
    """What a recording's files do not say themselves.

    Attributes:
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

    device: str = ""
    tracker: str = ""
    source: str = ""
    has_images: bool = True
    clock: Clock = "device"
    is_metric: bool = True
    is_gravity_aligned: bool = True
    is_diverging: bool = False
    notes: tuple[str, ...] = ()


def write_info(path: Path, info: RecordingInfo) -> None:
    """Write `recording.json`.

    Raises:
        FormatError: It cannot be written.
    """
    content = {"format": FORMAT, "version": VERSION, "conventions": CONVENTIONS, **asdict(info)}
    write_text(path, json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def read_info(path: Path) -> RecordingInfo:
    """Read `recording.json`; members that it lacks have their defaults.

    Raises:
        FormatError: Not such a file, of a later version, of other conventions, or a member of
            another type.
    """
    content = load_object(path, read_text(path))
    if content.get("format") != FORMAT:
        problem = f'expected "format": "{FORMAT}", got {content.get("format")!r}'
        raise FormatError(path, problem)
    if content.get("version") != VERSION:
        problem = f"expected version {VERSION}, got {content.get('version')!r}: a newer vioapr's?"
        raise FormatError(path, problem)
    conventions = content.get("conventions", CONVENTIONS)
    if conventions != CONVENTIONS:
        problem = f"expected the conventions {json.dumps(CONVENTIONS)}, got others"
        raise FormatError(path, problem)
    values = {f.name: content[f.name] for f in fields(RecordingInfo) if f.name in content}
    for name, value in values.items():
        _check_type(path, name, value)
    return RecordingInfo(**{**values, "notes": tuple(values.get("notes", ()))})


def _check_type(path: Path, name: str, value: Any) -> None:
    default = getattr(RecordingInfo, name)
    if name == "notes":
        is_fine = isinstance(value, list) and all(isinstance(note, str) for note in value)
    elif name == "clock":
        is_fine = value in ("device", "frame-rate")
    else:
        is_fine = isinstance(value, type(default))
    if not is_fine:
        kind = {str: "text", bool: "true or false", tuple: "a list of texts"}[type(default)]
        kind = '"device" or "frame-rate"' if name == "clock" else kind
        raise FormatError(path, f'expected "{name}" to be {kind}, got {value!r}')
