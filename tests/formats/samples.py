"""Files of the formats that are only read, made by hand from a trajectory."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vioapr.formats.base import Format
from vioapr.geometry import quaternion
from vioapr.geometry.frames import cam_from_arcam
from vioapr.trajectory import Trajectory


def write_sample(format_: Format, path: Path, trajectory: Trajectory) -> None:
    """Write a file of any format: by its writer, or by hand where it has none."""
    if format_.write is not None:
        format_.write(path, trajectory)
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        SAMPLES[format_.name](path, trajectory)


def opengl_matrices(trajectory: Trajectory) -> list[list[list[float]]]:
    return cam_from_arcam(trajectory.target_from_source).to_matrix().tolist()


def names_of(trajectory: Trajectory) -> list[str]:
    return list(trajectory.names or [f"{row}.jpg" for row in range(len(trajectory))])


def write_polycam(path: Path, trajectory: Trajectory) -> None:
    folder = path / "keyframes" / "cameras"
    folder.mkdir(parents=True)
    for time_s, matrix in zip(trajectory.timestamp_s, opengl_matrices(trajectory), strict=True):
        camera = {f"t_{i}{j}": matrix[i][j] for i in range(3) for j in range(4)}
        text = json.dumps({**camera, "fx": 1400.0, "width": 1024, "height": 768})
        (folder / f"{round(time_s * 1e6)}.json").write_text(text)


def write_scannerapp(path: Path, trajectory: Trajectory) -> None:
    path.mkdir(parents=True)
    (path / "info.json").write_text('{"title": "walk"}')
    for row, (time_s, matrix) in enumerate(
        zip(trajectory.timestamp_s.tolist(), opengl_matrices(trajectory), strict=True)
    ):
        frame = {"time": time_s, "cameraPoseARFrame": np.ravel(matrix).tolist()}
        (path / f"frame_{row:05d}.json").write_text(json.dumps({**frame, "frame_index": row}))


def write_scannetpp(path: Path, trajectory: Trajectory) -> None:
    frames = {
        f"frame_{row:06d}": {"timestamp": time_s, "aligned_pose": matrix, "intrinsic": []}
        for row, (time_s, matrix) in enumerate(
            zip(
                trajectory.timestamp_s.tolist(),
                trajectory.target_from_source.to_matrix().tolist(),
                strict=True,
            )
        )
    }
    path.write_text(json.dumps(frames))


def write_spectacular(path: Path, trajectory: Trajectory) -> None:
    lines = ['{"sensor": {"type": "gyroscope", "values": [0, 0, 1]}, "time": 0.5}']
    poses = trajectory.target_from_source
    for time_s, position, quat in zip(
        trajectory.timestamp_s.tolist(),
        poses.translation_m.tolist(),
        poses.quat_xyzw.tolist(),
        strict=True,
    ):
        pose = {
            "position": dict(zip("xyz", position, strict=True)),
            "orientation": dict(zip("xyzw", quat, strict=True)),
        }
        lines.append(json.dumps({"time": time_s, "status": "TRACKING", **pose}))
    path.write_text("\n".join(lines) + "\n")


def write_metashape(path: Path, trajectory: Trajectory) -> None:
    """The chunk is half as large, turned about z and moved."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    move = np.array([10.0, 20, 30])
    cameras = []
    for name, matrix in zip(
        names_of(trajectory), trajectory.target_from_source.to_matrix(), strict=True
    ):
        inner = np.eye(4)
        inner[:3, :3] = turn.T @ matrix[:3, :3]
        inner[:3, 3] = turn.T @ (matrix[:3, 3] - move) / 2
        numbers = " ".join(map(repr, inner.ravel().tolist()))
        cameras.append(f'<camera id="0" label="{name}"><transform>{numbers}</transform></camera>')
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="walk">'
        f"<cameras>{''.join(cameras)}</cameras><transform>"
        f"<rotation>{' '.join(map(str, turn.ravel()))}</rotation>"
        "<translation>10 20 30</translation><scale>2</scale></transform></chunk></document>\n"
    )


def write_meshroom(path: Path, trajectory: Trajectory) -> None:
    views, poses = [], []
    matrices = trajectory.target_from_source.to_matrix()
    for row, (name, matrix) in enumerate(zip(names_of(trajectory), matrices, strict=True)):
        views.append({"viewId": str(row), "poseId": str(row), "path": name})
        cam_from_world = matrix[:3, :3].T
        by_columns = [repr(value) for value in cam_from_world.ravel(order="F").tolist()]
        center = [repr(value) for value in matrix[:3, 3].tolist()]
        transform = {"rotation": by_columns, "center": center}
        poses.append({"poseId": str(row), "pose": {"transform": transform, "locked": "0"}})
    path.write_text(json.dumps({"version": ["1", "2"], "views": views, "poses": poses}))


def write_opensfm(path: Path, trajectory: Trajectory) -> None:
    cam_from_world = trajectory.target_from_source.inverse()
    shots = {
        name: {"rotation": rotvec, "translation": translation, "camera": "c"}
        for name, rotvec, translation in zip(
            names_of(trajectory),
            quaternion.to_rotvec(cam_from_world.quat_xyzw).tolist(),
            cam_from_world.translation_m.tolist(),
            strict=True,
        )
    }
    path.write_text(json.dumps([{"cameras": {"c": {}}, "shots": shots, "points": {}}]))


def write_bundler(path: Path, trajectory: Trajectory) -> None:
    poses = cam_from_arcam(trajectory.target_from_source).inverse()
    lines = ["# Bundle file v0.3", f"{len(trajectory)} 0"]
    for matrix in poses.to_matrix()[:, :3].tolist():
        lines += ["500 0 0", *(" ".join(map(repr, row[:3])) for row in matrix)]
        lines.append(" ".join(repr(row[3]) for row in matrix))
    path.write_text("\n".join(lines) + "\n")


def write_nvm(path: Path, trajectory: Trajectory) -> None:
    lines = ["NVM_V3 ", "", str(len(trajectory))]
    inverse = quaternion.inverse(trajectory.quat_xyzw)
    for name, (x, y, z, w), position in zip(
        names_of(trajectory), inverse.tolist(), trajectory.position_m.tolist(), strict=True
    ):
        numbers = [500.0, w, x, y, z, *position, 0.0, 0]
        lines.append(f"{name}\t{' '.join(map(repr, numbers))}")
    path.write_text("\n".join([*lines, "", "0", ""]))


SAMPLES: dict[str, Callable[[Path, Trajectory], None]] = {
    "polycam": write_polycam,
    "3dscannerapp": write_scannerapp,
    "scannetpp": write_scannetpp,
    "spectacular": write_spectacular,
    "metashape": write_metashape,
    "meshroom": write_meshroom,
    "opensfm": write_opensfm,
    "bundler": write_bundler,
    "nvm": write_nvm,
}
