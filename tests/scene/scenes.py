"""Small recordings and scenes to test with."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

CAMERA = Intrinsics(16, 12, 20.0, 20.0, 8.0, 6.0)

# A camera held upright that looks along the world's -z: its x stays, its y is down.
UPRIGHT_XYZW = np.array([1.0, 0.0, 0.0, 0.0])


def jpeg(width: int = 16, height: int = 12, shade: int = 100, suffix: str = ".jpg") -> bytes:
    buffer = io.BytesIO()
    pixels = np.full((height, width, 3), shade, dtype=np.uint8)
    Image.fromarray(pixels).save(buffer, format="png" if suffix == ".png" else "jpeg")
    return buffer.getvalue()


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Rigid3:
    """An upright camera at a place of a y-up world."""
    return Rigid3(np.array([x, y, z]), UPRIGHT_XYZW)


def write_recording(folder: Path, count: int = 10, **info: object) -> Path:
    """A walk of 0.5 m steps along x, twice a second, with images frame-0.jpg and so on."""
    defaults: dict = {"device": "iPhone 14 Pro", "tracker": "ARKit"}
    with RecordingWriter(folder, RecordingInfo(**{**defaults, **info})) as writer:
        for k in range(count):
            writer.add_frame(
                0.5 * k, f"frame-{k}.jpg", jpeg(shade=k), Tracking.NORMAL, pose(0.5 * k), CAMERA
            )
    return folder


def gt_of(count: int = 10) -> Trajectory:
    """Ground truth of `write_recording`'s frames: along y of a z-up world."""
    times = 0.5 * np.arange(count)
    positions = np.stack([0 * times, times, 0 * times], axis=1)
    return Trajectory.from_arrays(times, positions, np.tile([0, 0, 0, 1.0], (count, 1)))


def make_scene(folder: Path, count: int = 10) -> Scene:
    """A scene with a recording in each split and ground truth of both."""
    scene = Scene.create(folder, "Courtyard", is_outdoor=True)
    for id_, split in (("walk-1", "train"), ("walk-2", "test")):
        write_recording(scene.recording_folder(id_), count)
        scene.write_gt(id_, gt_of(count))
        scene = scene.with_recording(id_, split)
    scene.save()
    return scene


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
