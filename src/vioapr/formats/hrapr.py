"""HR-APR text: `name x y z qw qx qy qz`, world_from_cam, camera with OpenGL axes."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.text import plain_name
from vioapr.formats import conventions
from vioapr.formats.base import Format
from vioapr.formats.named import NamedText

_LAYOUT = NamedText(conventions.world_from_arcam)


def sniff(path: Path, head: bytes) -> float:
    """By the file name: the columns are those of MARViN."""
    if not _LAYOUT.fits(head):
        return 0.0
    name = plain_name(path)
    if "_predict" in name or "_gt" in name:
        return 0.9
    return 0.2 if name in ("train.txt", "test.txt") else 0.5


FORMAT = Format(
    name="hrapr",
    title="HR-APR predictions and labels",
    convention=f"{_LAYOUT.what}; world_from_cam, OpenGL camera axes (y up, looking along -z)",
    extensions=(".txt",),
    sniff=sniff,
    read=_LAYOUT.read,
    write=_LAYOUT.write,
    has_names=True,
)
