"""Rooms with painted walls, drawn without a graphics card, and small scenes recorded in them.

Two of them: a room with textured walls, whose pictures can be mapped, and a box with coloured
walls, which a small network learns in seconds. The world is metric, z up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.recording import RecordingInfo
from vioapr.simulation.handheld import look_at, looking
from vioapr.simulation.trackers import track_without_drift, tracking_world
from vioapr.trajectory import Trajectory

ROOM_CAMERA = Intrinsics(320, 240, 220.0, 220.0, 160.0, 120.0)
BOX_CAMERA = Intrinsics(48, 36, 40.0, 40.0, 24.0, 18.0)
TEXTURE_PX_PER_M = 120
"""Density of the textured room's walls."""


@dataclass(frozen=True, eq=False)
class Room:
    """An axis-aligned room.

    Attributes:
        low_m: Its lower corner, shape (3,).
        high_m: Its upper corner, shape (3,).
        paint: Grey, shape (n,), or colours, shape (n, 3), 0 to 255, of points on the walls,
            shape (n, 3), and the walls that they are on, shape (n,): 0 and 1 are the walls at
            the lower and the upper x, 2 and 3 those at y, 4 and 5 floor and ceiling.
    """

    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    paint: Callable[[NDArray[np.float64], NDArray[np.intp]], NDArray[np.float64]]


def textured_room(seed: int = 0) -> Room:
    """A room of 6 m x 5 m x 3 m with grey textures; the origin is on the floor in its middle."""
    size_m = np.array([6.0, 5.0, 3.0])
    low_m = np.array([-3.0, -2.5, 0.0])
    rng = np.random.default_rng(seed)
    side_px = int(TEXTURE_PX_PER_M * size_m.max())
    textures = []
    for _ in range(6):
        texture = np.zeros((side_px, side_px))
        for width_px, weight in ((2, 0.6), (5, 1.0), (14, 1.0), (40, 0.7)):
            grain = gaussian_filter(rng.standard_normal((side_px, side_px)), width_px)
            texture += weight * (grain / grain.std())
        textures.append(np.clip(128 + 45 * texture, 0, 255))

    def paint(point_m: NDArray[np.float64], wall: NDArray[np.intp]) -> NDArray[np.float64]:
        grey = np.zeros(len(point_m))
        for number, texture in enumerate(textures):
            is_here = wall == number
            within = [axis for axis in range(3) if axis != number // 2]
            pixel = (point_m[is_here] - low_m)[:, within].T * TEXTURE_PX_PER_M
            grey[is_here] = map_coordinates(texture, pixel, order=1, mode="nearest")
        return grey

    return Room(low_m, low_m + size_m, paint)


def coloured_box(brightness: float = 1.0) -> Room:
    """A box of 8 m x 6 m x 4 m about the origin, its colours waves through space."""
    high_m = np.array([4.0, 3.0, 2.0])
    waves = np.random.default_rng(3).normal(size=(3, 3))

    def paint(point_m: NDArray[np.float64], wall: NDArray[np.intp]) -> NDArray[np.float64]:
        return 255 * np.clip(brightness * (0.5 + 0.45 * np.sin(point_m @ waves)), 0, 1)

    return Room(-high_m, high_m, paint)


def render(room: Room, camera: Intrinsics, world_from_cam: Rigid3) -> NDArray[np.uint8]:
    """Draw what a camera in a room sees.

    Args:
        room: The room.
        camera: One camera; width and height are whole numbers.
        world_from_cam: Its pose, within the room.

    Returns:
        Shape (height, width) or (height, width, 3).
    """
    width, height, fx, fy, cx, cy = (float(np.asarray(value)) for value in camera)
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], axis=-1)
    rays = quaternion.rotate(world_from_cam.quat_xyzw, rays.reshape(-1, 3))
    eye = world_from_cam.translation_m
    with np.errstate(divide="ignore"):
        reach = (np.where(rays > 0, room.high_m, room.low_m) - eye) / rays
    axis = np.argmin(np.where(np.abs(rays) < 1e-12, np.inf, reach), axis=1)
    row = np.arange(len(rays))
    point = eye + reach[row, axis][:, None] * rays
    painted = room.paint(point, 2 * axis + (rays[row, axis] > 0))
    return painted.reshape(int(height), int(width), *painted.shape[1:]).astype(np.uint8)


def walk_arc(
    count: int, start_deg: float, step_deg: float, radius_m: float, height_m: float
) -> Trajectory:
    """Walk along an arc about the origin, looking across the room, two poses a second.

    Args:
        count: Poses.
        start_deg: Where the arc begins, counterclockwise from the x axis.
        step_deg: From pose to pose.
        radius_m: Of the arc.
        height_m: Of the camera, about which it bobs by 0.1 m.

    Returns:
        world_from_cam.
    """
    step = np.arange(count)
    angle = np.radians(start_deg + step_deg * step)
    across = np.column_stack([np.cos(angle), np.sin(angle)])
    position = np.column_stack([radius_m * across, height_m + 0.1 * np.sin(step)])
    target = np.column_stack([-2.0 * across, 1.3 + 0.1 * np.cos(2 * step)])
    return Trajectory.from_arrays(step / 2.0, *look_at(position, target))


def stand_about(count: int, seed: int) -> Trajectory:
    """Stand near the box's middle at random, looking along +y up to 0.5 rad aside, at 5 Hz.

    Returns:
        world_from_cam.
    """
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (count, 3)) * [1.5, 1.0, 0.3]
    heading = np.pi / 2 + rng.uniform(-0.5, 0.5, count)
    return Trajectory.from_arrays(0.2 * np.arange(count), position, looking(heading))


def add_recording(
    scene: Scene,
    id_: str,
    split: str,
    gt: Trajectory,
    vio_from_cam: Rigid3,
    room: Room,
    camera: Intrinsics,
    names: str = "{:04d}.jpg",
) -> Scene:
    """Render a walk into a scene as a recording of a phone with ARKit, and save the scene.

    Args:
        scene: Where.
        id_: The recording's name.
        split: "train" or "test".
        gt: Of every image, world_from_cam.
        vio_from_cam: Of every image, shape (n,).
        room: Where the camera is.
        camera: Which.
        names: Pattern of the images' names, by their number.

    Returns:
        The scene with the recording, but without its ground truth.
    """
    info = RecordingInfo(device="phone", tracker="ARKit")
    with RecordingWriter(scene.recording_folder(id_), info) as writer:
        for row, time_s in enumerate(gt.timestamp_s):
            image = render(room, camera, gt.target_from_source.at(row))
            name, vio = names.format(row), vio_from_cam.at(row)
            writer.add_frame(time_s, name, image, Tracking.NORMAL, vio, camera)
    scene = scene.with_recording(id_, split)
    scene.save()
    return scene


def make_room_scene(
    folder: Path, seed: int = 0, images: int = 8
) -> tuple[Scene, dict[str, Trajectory]]:
    """Record two training walks and a test walk in the textured room, to be mapped.

    Args:
        folder: The scene's.
        seed: Of the room and the trackers' errors.
        images: Of each training walk; the test walk has half of them.

    Returns:
        The scene, without ground truth, and the true poses of its recordings by id. Each
        recording has a tracking world of its own, whose scale is up to 1 % off.
    """
    rng = np.random.default_rng(seed)
    room = textured_room(seed)
    scene = Scene.create(folder, "Room", is_outdoor=False)
    walks = {
        "a": ("train", walk_arc(images, 0, 10, 1.2, 1.5), tracking_world(30, 1.01)),
        "b": ("train", walk_arc(images, 30, 10, 1.6, 1.2), tracking_world(-100, 0.99)),
        "t": ("test", walk_arc(images // 2, 25, 12, 1.4, 1.4), tracking_world(170)),
    }
    for id_, (split, gt, vio_from_world) in walks.items():
        vio = track_without_drift(rng, gt.target_from_source, vio_from_world)
        scene = add_recording(scene, id_, split, gt, vio, room, ROOM_CAMERA)
    return scene, {id_: gt for id_, (_, gt, _) in walks.items()}


def make_box_scene(
    folder: Path,
    *,
    train: int = 2,
    test: int = 1,
    frames: int = 32,
    name: str = "Box",
    brightness: float = 1.0,
) -> Scene:
    """Record train-1, ... and test-1, ... in the coloured box, with exact VIO and ground truth.

    Args:
        folder: The scene's; made if needed.
        train: Recordings to train with.
        test: Recordings to test with.
        frames: Images of each.
        name: The scene's.
        brightness: Factor of all colours.
    """
    room = coloured_box(brightness)
    scene = Scene.create(folder, name, is_outdoor=False)
    chosen = [("train", number) for number in range(1, train + 1)]
    chosen += [("test", number) for number in range(1, test + 1)]
    for seed, (split, number) in enumerate(chosen):
        id_ = f"{split}-{number}"
        gt = stand_about(frames, seed)
        vio = y_up_from_z_up(gt.target_from_source)
        scene = add_recording(scene, id_, split, gt, vio, room, BOX_CAMERA, "{:03d}.png")
        scene.write_gt(id_, gt, "simulator")
    return scene
