"""Cambridge Landmarks `dataset_train.txt`: up to 3 header lines, `file X Y Z W P Q R`."""

from __future__ import annotations

from pathlib import Path

from vioapr.files.text import plain_name
from vioapr.formats import conventions
from vioapr.formats.base import Format
from vioapr.formats.named import NamedText

_FILES = ("dataset_train.txt", "dataset_test.txt")
_LAYOUT = NamedText(
    conventions.centre_and_cam_from_world,
    header=(
        "Visual Landmark Dataset V1",
        "ImageFile, Camera Position [X Y Z W P Q R]",
        "",
    ),
)


def sniff(path: Path, head: bytes) -> float:
    """Sure by the header line, or by the name and such rows."""
    if b"Camera Position [X Y Z W P Q R]" in head[:1024]:
        return 1.0
    return 0.95 if plain_name(path) in _FILES and _LAYOUT.fits(head) else 0.0


FORMAT = Format(
    name="cambridge",
    title="Cambridge Landmarks labels",
    convention=(
        "up to 3 header lines, then file X Y Z W P Q R; position in the world, but rotation "
        "cam_from_world, quaternion wxyz, OpenCV axes"
    ),
    extensions=(".txt",),
    sniff=sniff,
    read=_LAYOUT.read,
    write=_LAYOUT.write,
    has_names=True,
    default_for=_FILES,
)
