"""MS-Transformer csv: `scene,split,seq,img_path,t1,t2,t3,q1,q2,q3,q4`, quaternion wxyz.

Of Cambridge, t is the camera's position and q is cam_from_world; of 7Scenes, both are
world_from_cam. The scene's name tells which.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vioapr.files.tables import format_rows, read_headed_csv
from vioapr.files.text import write_text
from vioapr.formats import conventions
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.named import build_named, writable_names
from vioapr.formats.poses import pose_columns, poses_of
from vioapr.geometry.rigid import Rigid3, choose
from vioapr.trajectory import Trajectory

_HEADER = "scene,split,seq,img_path,t1,t2,t3,q1,q2,q3,q4"
_SEVEN_SCENES = ("chess", "fire", "heads", "office", "pumpkin", "redkitchen", "stairs")


def _convert(scenes: Sequence[str], poses: Rigid3) -> Rigid3:
    """From the file's conventions to ours, and back."""
    is_indoor = np.array([scene.lower() in _SEVEN_SCENES for scene in scenes])
    return choose(is_indoor, poses, conventions.centre_and_cam_from_world(poses))


def sniff(path: Path, head: bytes) -> float:
    """Sure by the header line."""
    del path
    return 1.0 if head.removeprefix(b"\xef\xbb\xbf").startswith(_HEADER.encode()) else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses in the natural order of the image paths.

    Raises:
        FileError: It cannot be read or is malformed, naming file and line.
        ParameterError: The options do not fit the file's sequences.
    """
    rows = read_headed_csv(path, ["scene", "img_path", *_HEADER.split(",")[4:]])
    values = rows.numbers(slice(2, 9))
    poses = poses_of(rows, values[:, :3], values[:, [4, 5, 6, 3]])
    return build_named(rows, rows.column(1), _convert(rows.column(0), poses), options)


def write(path: Path, trajectory: Trajectory) -> None:
    """Write all digits; the scene is the first folder of an image's path.

    Raises:
        ParameterError: A name that the format cannot hold.
        UnwritableError: The file cannot be written.
    """
    names = writable_names(trajectory, ",")
    scenes = [name.split("/")[0].strip() if "/" in name else "scene" for name in names]
    sequences = [name.split("/")[-2].strip() if "/" in name else "seq1" for name in names]
    columns = pose_columns(_convert(scenes, trajectory.target_from_source), (3, 0, 1, 2))
    rows = [
        (scene, "test", sequence, name, *row)
        for scene, sequence, name, row in zip(scenes, sequences, names, columns, strict=True)
    ]
    write_text(path, f"{_HEADER}\n" + format_rows(rows, ","))


FORMAT = Format(
    name="mstransformer",
    title="MS-Transformer csv",
    convention=(
        f"{_HEADER}; Cambridge: position in the world, but rotation cam_from_world; "
        "7Scenes: world_from_cam; quaternion wxyz, OpenCV axes"
    ),
    extensions=(".csv",),
    sniff=sniff,
    read=read,
    write=write,
    has_names=True,
)
