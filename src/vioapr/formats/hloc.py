"""hloc and visuallocalization.net: `name qw qx qy qz tx ty tz [focal]`, cam_from_world."""

from __future__ import annotations

from pathlib import Path

from vioapr.formats import conventions
from vioapr.formats.base import Format
from vioapr.formats.named import NamedText

_LAYOUT = NamedText(conventions.cam_from_world, is_quat_first=True, extra=("[focal]",))


def sniff(path: Path, head: bytes) -> float:
    """Likely of a name, a unit quaternion and three more numbers."""
    del path
    return 0.85 if _LAYOUT.fits(head) else 0.0


FORMAT = Format(
    name="hloc",
    title="hloc or visuallocalization.net poses",
    convention=f"{_LAYOUT.what}; cam_from_world (t is not the camera's position), OpenCV axes",
    extensions=(".txt",),
    sniff=sniff,
    read=_LAYOUT.read,
    write=_LAYOUT.write,
    has_names=True,
)
