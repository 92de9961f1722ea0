"""What other apps and data sets write, made small: a walk along -z, turning about the vertical."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from tests.scene.scenes import jpeg

from vioapr.formats import conventions, marvin, record3d, stray, tum
from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up, z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import ImportedScene, ImportOptions, Walk
from vioapr.importers.diagnostics import diagnose
from vioapr.simulation.handheld import looking
from vioapr.trajectory import Trajectory

COUNT = 20
RATE_HZ = 10.0


def walk(count: int = COUNT) -> Trajectory:
    """A tracker's poses, y up: 1 m/s, up and down a little, turning from side to side."""
    times = np.arange(count) / RATE_HZ
    positions = np.stack([np.sin(times), times, 0.2 * np.cos(3 * times)], axis=1)
    heading = np.pi / 2 + 0.5 * np.sin(2 * times + 0.03 * times**2)
    pitch = np.outer(-0.2 * np.cos(times), [0.0, 1.0, 0.0])
    vio_from_cam = y_up_from_z_up(Rigid3(positions, looking(heading, pitch)))
    return Trajectory(times, *vio_from_cam, target="vio")


def map_of(vio: Trajectory) -> Trajectory:
    """The same walk in a z-up map, elsewhere and turned."""
    world_from_zup = Rigid3(
        np.array([10.0, -5.0, 1.5]), quaternion.from_rotvec(np.array([0.0, 0.0, 0.7]))
    )
    poses = world_from_zup @ z_up_from_y_up(vio.target_from_source)
    return Trajectory(vio.timestamp_s, poses.translation_m, poses.quat_xyzw)


def named(trajectory: Trajectory, names: list[str]) -> Trajectory:
    return Trajectory(
        np.arange(len(trajectory), dtype=float),
        trajectory.position_m,
        trajectory.quat_xyzw,
        tuple(names),
        is_timed=False,
        target=trajectory.target,
    )


def write_images(folder: Path, names: list[str]) -> None:
    for shade, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(jpeg(shade=shade % 250, suffix=path.suffix))


def make_stray(folder: Path, count: int = COUNT) -> Path:
    """With images instead of the video."""
    stray.write(folder / "odometry.csv", walk(count))
    (folder / "camera_matrix.csv").write_text("20, 0, 8\n0, 21, 6\n0, 0, 1")
    write_images(folder, [f"rgb/{k:06d}.jpg" for k in range(count)])
    return folder


def device_imu(vio: Trajectory) -> np.ndarray:
    """What Core Motion says of a phone at rest in these poses: gravity in g, device axes."""
    down_cam = quaternion.rotate(quaternion.inverse(vio.quat_xyzw), np.array([0.0, -1.0, 0.0]))
    # OpenCV x is the device's -y, y its -x, z its -z.
    return down_cam @ np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def make_record3d(folder: Path, count: int = COUNT) -> Path:
    record3d.write(folder / "metadata", walk(count))
    metadata = json.loads((folder / "metadata").read_text())
    metadata |= {"w": 16, "h": 12, "K": [20, 0, 0, 0, 21, 0, 8, 6, 1]}
    (folder / "metadata").write_text(json.dumps(metadata))
    write_images(folder, [f"rgbd/{k}.jpg" for k in range(count)])
    return folder


def make_nerfstudio(folder: Path, count: int = COUNT) -> Path:
    vio = walk(count)
    matrices = conventions.world_from_arcam(vio.target_from_source).to_matrix().tolist()
    frames = [
        {"file_path": f"images/{k}.jpg", "transform_matrix": matrix}
        for k, matrix in enumerate(matrices)
    ]
    content = {"w": 16, "h": 12, "fl_x": 20, "fl_y": 21, "cx": 8, "cy": 6, "frames": frames}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps(content))
    write_images(folder, [f"images/{k}.jpg" for k in range(count)])
    return folder


def make_marvin(folder: Path, count: int = COUNT) -> Path:
    """A scene with a walk for training by ARKit and one for testing by ARCore."""
    vio = walk(count)
    for split, file in (("train", "ARKit.txt"), ("test", "ARCore.txt")):
        names = [f"{split}-1/{k:04d}.jpg" for k in range(count)]
        marvin.VIO_FORMAT.write(folder / file, named(vio, names))
        marvin.FORMAT.write(folder / f"{split}.txt", named(map_of(vio), names))
        write_images(folder, names)
    return folder


def make_images(folder: Path, count: int = COUNT) -> Path:
    write_images(folder / "images", [f"frame-{k:04d}.jpg" for k in range(count)])
    tum.write(folder / "vio.tum", walk(count))
    tum.write(folder / "gt.tum", map_of(walk(count)))
    return folder


def read_walks(importer, source: Path, **options) -> list[Walk]:
    """All walks of a source, with what was found out."""
    scenes: list[ImportedScene] = importer.read(source, ImportOptions(**options))
    walks = [walk for scene in scenes for walk in scene.read()]
    for one in walks:
        diagnose(one)
    return walks


def texts(walk: Walk, *, warnings: bool) -> str:
    return "\n".join(f.text for f in walk.findings if f.is_warning == warnings)
