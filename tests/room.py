"""A room with textured walls, seen by cameras of known pose: pictures to map in tests.

The world is metric, z up; the room is `SIZE_M` large with its middle on the floor at the origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import Sim3
from vioapr.mapping.params import MappingParams
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.info import RecordingInfo
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.trajectory import Trajectory

SIZE_M = np.array([6.0, 5.0, 3.0])
WIDTH, HEIGHT, FOCAL = 320, 240, 220.0
CAMERA = Intrinsics(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2)
PIXELS_PER_M = 120
QUICK = MappingParams(max_features=400, sequential=4, spatial=2, loops=4, threads=2)
"""Enough for a room."""


def wall_textures(seed: int = 0) -> list[np.ndarray]:
    """A grey picture for each of the six sides."""
    rng = np.random.default_rng(seed)
    side = int(PIXELS_PER_M * SIZE_M.max())
    textures = []
    for _ in range(6):
        picture = sum(
            weight * _unit(gaussian_filter(rng.standard_normal((side, side)), sigma))
            for sigma, weight in ((2, 0.6), (5, 1.0), (14, 1.0), (40, 0.7))
        )
        textures.append(np.clip(128 + 45 * picture, 0, 255))
    return textures


def _unit(field: np.ndarray) -> np.ndarray:
    return field / field.std()


def render(world_from_cam: Rigid3, textures: Sequence[np.ndarray]) -> np.ndarray:
    """What a camera in the room sees, shape (HEIGHT, WIDTH), uint8."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack(
        [(u + 0.5 - WIDTH / 2) / FOCAL, (v + 0.5 - HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1
    )
    rays = rays.reshape(-1, 3) @ Rotation.from_quat(world_from_cam.quat_xyzw).as_matrix().T
    low = np.array([-SIZE_M[0] / 2, -SIZE_M[1] / 2, 0.0])
    with np.errstate(divide="ignore"):
        wall = np.where(rays > 0, low + SIZE_M, low)
        depth = (wall - world_from_cam.translation_m) / rays
    axis = np.argmin(np.where(np.abs(rays) < 1e-12, np.inf, depth), axis=1)
    row = np.arange(len(rays))
    points = world_from_cam.translation_m + depth[row, axis][:, None] * rays - low
    grey = np.zeros(len(rays))
    for side in range(6):
        hit = (axis == side // 2) & ((rays[row, axis] > 0) == bool(side % 2))
        others = [k for k in range(3) if k != side // 2]
        at = points[hit][:, others].T * PIXELS_PER_M
        grey[hit] = map_coordinates(textures[side], at, order=1, mode="nearest")
    return grey.reshape(HEIGHT, WIDTH).astype(np.uint8)


def look_at(position_m: np.ndarray, target_m: np.ndarray) -> Rigid3:
    """world_from_cam of a level camera."""
    forward = (target_m - position_m) / np.linalg.norm(target_m - position_m)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    matrix = np.column_stack([right, np.cross(forward, right), forward])
    return Rigid3(position_m, Rotation.from_matrix(matrix).as_quat())


def walk(count: int, start_deg: float, step_deg: float, radius_m: float, height_m: float):
    """Poses on an arc, looking across the room; seconds apart, world_from_cam."""
    angles = np.radians(start_deg + step_deg * np.arange(count))
    poses = []
    for k, angle in enumerate(angles):
        across = np.array([np.cos(angle), np.sin(angle)])
        position = np.append(radius_m * across, height_m + 0.1 * np.sin(k))
        target = np.append(-2.0 * across, 1.3 + 0.1 * np.cos(2 * k))
        poses.append(look_at(position, target))
    return Trajectory.from_arrays(
        np.arange(count) / 2.0, [p.translation_m for p in poses], [p.quat_xyzw for p in poses]
    )


def vio_of(gt: Trajectory, vio_from_world: Sim3, rng: np.random.Generator) -> Rigid3:
    """A tracker's poses: its own origin, heading and scale, with a little noise."""
    poses = y_up_from_z_up(gt.target_from_source)
    placed = vio_from_world.apply_to(poses)
    noise = Rotation.from_rotvec(np.radians(0.1) * rng.standard_normal((len(gt), 3)))
    turned = Rotation.from_quat(placed.quat_xyzw) * noise
    return Rigid3(
        placed.translation_m + 0.002 * rng.standard_normal((len(gt), 3)), turned.as_quat()
    )


def own_world(heading_deg: float, scale: float = 1.0) -> Sim3:
    """vio_from_world of a y-up tracking world."""
    turn = Rotation.from_euler("y", heading_deg, degrees=True).as_quat()
    return Sim3(np.array(scale), Rigid3(np.array([heading_deg / 10, 2.0, -1.0]), turn))


def add_recording(
    scene: Scene,
    id_: str,
    split: str,
    gt: Trajectory,
    vio: Rigid3,
    textures: Sequence[np.ndarray],
    **info,
) -> Scene:
    """Render a walk into the scene; its true poses go to `truth/<id>.tum` beside the scene."""
    with RecordingWriter(scene.recording_folder(id_), RecordingInfo(**info)) as writer:
        for k in range(len(gt)):
            picture = render(gt.target_from_source.at(k), textures)
            writer.add_frame(
                float(gt.timestamp_s[k]),
                f"{k:04d}.jpg",
                picture,
                Tracking.NORMAL,
                vio.at(k),
                CAMERA,
            )
    scene = scene.with_recording(id_, split)
    scene.save()
    return scene


def make_room(folder: Path, seed: int = 0) -> tuple[Scene, dict[str, Trajectory]]:
    """Two training walks and a test walk, each in a tracking world of its own, and the truth."""
    rng = np.random.default_rng(seed)
    textures = wall_textures(seed)
    scene = Scene.create(folder, "Room", is_outdoor=False)
    walks = {
        "a": ("train", walk(8, 0, 10, 1.2, 1.5), own_world(30, 1.01)),
        "b": ("train", walk(8, 30, 10, 1.6, 1.2), own_world(-100, 0.99)),
        "t": ("test", walk(4, 25, 12, 1.4, 1.4), own_world(170)),
    }
    truth = {}
    for id_, (split, gt, vio_from_world) in walks.items():
        vio = vio_of(gt, vio_from_world, rng)
        scene = add_recording(scene, id_, split, gt, vio, textures, tracker="ARKit")
        truth[id_] = gt
    return scene, truth
