"""ACE and DSAC* poses: hloc's columns, then errors and inliers, cam_from_world."""

from __future__ import annotations

from pathlib import Path

from vioapr.formats import conventions
from vioapr.formats.base import Format
from vioapr.formats.named import NamedText

_LAYOUT = NamedText(
    conventions.cam_from_world,
    is_quat_first=True,
    extra=("r_err", "t_err", "[inliers]"),
    required_extra=2,
)


def sniff(path: Path, head: bytes) -> float:
    """Likely of a name, a unit quaternion and five or six more numbers."""
    if not _LAYOUT.fits(head):
        return 0.0
    return 0.95 if path.name.startswith("poses_") else 0.85


FORMAT = Format(
    name="ace",
    title="ACE or DSAC* poses",
    convention=f"{_LAYOUT.what}; cam_from_world, OpenCV axes; errors are written as 0",
    extensions=(".txt",),
    sniff=sniff,
    read=_LAYOUT.read,
    write=_LAYOUT.write,
    has_names=True,
)
