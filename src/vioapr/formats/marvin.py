"""MARViN, the dataset of the VIO-APR paper: `name x y z qw qx qy qz` in two conventions.

`train.txt` and `test.txt` hold the camera's position and, by the rule of the paper's code, the
rotation cam_from_world. That is inferred, not documented: `vioapr.formats.readings` says which
reading fits the VIO of the same walk. `ARKit.txt` and `ARCore.txt` come from Unity.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.files.text import plain_name
from vioapr.formats import conventions
from vioapr.formats.base import Format
from vioapr.formats.named import NamedText

_MAP = NamedText(conventions.centre_and_cam_from_world)
_VIO = NamedText(conventions.unity, target="vio")


def _is_tracker(path: Path) -> bool:
    return any(tracker in plain_name(path) for tracker in ("arkit", "arcore"))


def sniff(path: Path, head: bytes) -> float:
    """By the file name only: the columns are those of HR-APR."""
    if not _MAP.fits(head):
        return 0.0
    if plain_name(path) in ("train.txt", "test.txt"):
        return 0.8
    return 0.1 if _is_tracker(path) else 0.35


def sniff_vio(path: Path, head: bytes) -> float:
    """By the file name only."""
    if not _VIO.fits(head):
        return 0.0
    return 0.9 if _is_tracker(path) else 0.1


FORMAT = Format(
    name="marvin",
    title="MARViN map poses (train.txt, test.txt)",
    convention=f"{_MAP.what}; position in the world, but rotation cam_from_world, OpenCV axes",
    extensions=(".txt",),
    sniff=sniff,
    read=_MAP.read,
    write=_MAP.write,
    has_names=True,
)

VIO_FORMAT = Format(
    name="marvin-vio",
    title="MARViN tracker poses (ARKit.txt, ARCore.txt)",
    convention=(
        f"{_VIO.what}; Unity: left-handed, y up, world_from_cam; z is mirrored, "
        "so that the world stays y up"
    ),
    extensions=(".txt",),
    sniff=sniff_vio,
    read=_VIO.read,
    write=_VIO.write,
    has_names=True,
    up="+y",
)
