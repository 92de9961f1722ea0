"""A small scene that a small network learns in seconds: a box with coloured walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.regression.params import TrainingParams
from vioapr.regression.spec import RegressorSpec
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.info import RecordingInfo
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.trajectory import Trajectory

WIDTH, HEIGHT = 48, 36
CAMERA = Intrinsics(WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2)
HALF_SIZE_M = np.array([4.0, 3.0, 2.0])
_WAVES = np.random.default_rng(3).normal(size=(3, 3))


def photograph(world_from_cam: Rigid3, tint: float = 1.0) -> np.ndarray:
    """What a camera in the box sees, shape (HEIGHT, WIDTH, 3)."""
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / 40.0
    y = (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / 40.0
    rays = np.stack([*np.meshgrid(x, y), np.ones((HEIGHT, WIDTH))], axis=-1)
    rays = quaternion.rotate(world_from_cam.quat_xyzw, rays.reshape(-1, 3))
    with np.errstate(divide="ignore"):
        reach = (np.sign(rays) * HALF_SIZE_M - world_from_cam.translation_m) / rays
    hits = world_from_cam.translation_m + rays * reach.min(axis=-1, keepdims=True)
    shade = 0.5 + 0.45 * np.sin(hits @ _WAVES)
    return (255 * np.clip(tint * shade, 0, 1)).astype(np.uint8).reshape(HEIGHT, WIDTH, 3)


def walk(count: int, seed: int) -> Rigid3:
    """Upright cameras near the middle of the box that look about by 60 degrees."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1, 1, (count, 3)) * [1.5, 1.0, 0.3]
    heading = rng.uniform(-0.5, 0.5, count)
    upright = quaternion.from_rotvec(np.array([-np.pi / 2, 0.0, 0.0]))
    about_z = quaternion.from_rotvec(np.stack([0 * heading, 0 * heading, heading], axis=-1))
    return Rigid3(places, quaternion.multiply(about_z, np.broadcast_to(upright, (count, 4))))


def make_scene(
    folder: Path, *, train: int = 2, test: int = 1, frames: int = 32, name: str = "Box"
) -> Scene:
    """A scene with recordings train-1, ... and test-1, ..., and exact VIO."""
    scene = Scene.create(folder, name, is_outdoor=False)
    chosen = [("train", number) for number in range(1, train + 1)]
    chosen += [("test", number) for number in range(1, test + 1)]
    for seed, (split, number) in enumerate(chosen):
        id_ = f"{split}-{number}"
        poses = walk(frames, seed)
        times = 0.2 * np.arange(frames)
        vio = y_up_from_z_up(poses)
        with RecordingWriter(scene.recording_folder(id_), RecordingInfo("phone", "ARKit")) as out:
            for row, time_s in enumerate(times):
                picture = photograph(poses.at(row), 1.0 if name == "Box" else 0.5)
                frame = f"{row:03d}.png"
                out.add_frame(time_s, frame, picture, Tracking.NORMAL, vio.at(row), CAMERA)
        scene.write_gt(id_, Trajectory.from_arrays(times, *poses))
        scene = scene.with_recording(id_, split)
    scene.save()
    return scene


def spec(model: str = "mobile", **values) -> RegressorSpec:
    """Of a network that sees 32 pixels."""
    defaults: dict = {"scenes": ("Box",), "resize": 36, "crop": 32, "rotation": "6d"}
    return RegressorSpec(model, **{**defaults, **values})


def params(**values) -> TrainingParams:
    """Of a short run."""
    return TrainingParams(**{"epochs": 2, "batch_size": 16, "lr": 1e-3, **values})
