"""The world of a `transforms.json`: whose poses they are, in which unit, and which way is up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.matrix_order import to_rows
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import Up
from vioapr.importers.transforms import Transforms, read_matrix
from vioapr.schemas.foreign_json import as_numbers

# colmap2nerf.py moves cameras so that they are so far from the middle on average.
_NGP_DISTANCE, _NGP_TOLERANCE = 4.0, 0.02
# nerfstudio turns the poses of phone apps so: x, y, z become y, z, x.
_APP_TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass
class World:
    """What was found out of a file's world.

    Attributes:
        poses: vio_from_cam, in metres where `is_metric`.
        is_metric: Whether there are sure signs that lengths are metres.
        why: The signs, for people.
        tracker: Who made the poses, "" if not known.
        up: Why y should be up.
        notes: What was done, for people.
    """

    poses: Rigid3
    is_metric: bool = False
    why: str = ""
    tracker: str = ""
    up: Up = "unknown"
    notes: list[str] = field(default_factory=list[str])


def find_world(found: Transforms, poses: Rigid3, scale: NDArray[np.float64]) -> World:
    """Find a file's world, and undo what was done to a tracker's.

    Args:
        found: The file.
        poses: world_from_cam as in the file, OpenCV axes.
        scale: Of each pose's matrix.

    Raises:
        FormatError: `applied_transform` or `applied_scale` are no transform.
    """
    world = World(poses)
    world.is_metric, world.why, world.tracker = find_maker(found, poses)
    if (np.abs(scale - 1) > 0.01).any():
        world.notes.append(
            f"scale: the matrices have one of {np.median(scale):.4g}, taken off the rotations"
        )
        world.is_metric, world.why = False, "the matrices carry a scale, and whose is not known"
    if not world.is_metric:
        return world
    if world.tracker == "ARKit":
        world.up = "definition"
    undo_applied(found, world)
    return world


def find_maker(found: Transforms, poses: Rigid3) -> tuple[bool, str, str]:
    """Whether poses are in metres, why one thinks so, and the tracker's name or "".

    COLMAP's poses have no unit. instant-ngp's and nerfstudio's converters leave marks of theirs,
    and so do the apps that write a tracker's poses.
    """
    if found.has("colmap_im_id"):
        return False, "the poses are COLMAP's, not metric (colmap_im_id)", ""
    if found.has("depth_integer_scale") or found.has("depth_source"):
        return True, "as NeRFCapture writes ARKit's poses", "ARKit"
    if found.times() is not None:
        return True, "as frames with timestamps are a tracker's", ""
    if found.has("camera_linear_velocity") or found.has("camera_angular_velocity"):
        return True, "as Spectacular AI writes a tracker's poses with velocities", "Spectacular AI"
    signs = [key for key in ("sharpness", "aabb_scale") if found.has(key)]
    signs += ["lens distortion"] if found.is_distorted else []
    signs += ["sparse_pc.ply"] if found.members.get("ply_file_path") == "sparse_pc.ply" else []
    known = poses.translation_m[poses.is_known]
    if len(known) > 2:
        distance = float(np.linalg.norm(known, axis=1).mean())
        if abs(distance - _NGP_DISTANCE) < _NGP_TOLERANCE:
            signs.append("a mean distance of 4")
    if signs:
        return False, f"the poses are COLMAP's, not metric ({', '.join(signs)})", ""
    if found.has("depth_file_path") or found.has("depth_path"):
        return True, "as frames with a depth image and no lens distortion are a tracker's", ""
    turn = found.members.get("applied_transform")
    if turn is not None and is_app_turn(found):
        return True, "as the poses are turned as nerfstudio turns those of phone apps", "ARKit"
    return False, "nothing in the file shows that the poses are a tracker's", ""


def is_app_turn(found: Transforms) -> bool:
    """Whether `applied_transform` is the one of phone apps' captures."""
    matrix, problem = read_matrix(found.path, found.members.get("applied_transform"), 1)
    matrix = to_rows(matrix[None])[0][0]
    return problem is None and np.allclose(matrix[:3, :3], _APP_TURN, atol=1e-6)


def undo_applied(found: Transforms, world: World) -> None:
    """Undo the transform and the scale that a converter says it applied; notes are added."""
    if (given := found.members.get("applied_scale")) is not None:
        applied = float(as_numbers(found.path, given, (), '"applied_scale"', 1))
        if not 1e-6 < applied < 1e6:
            problem = f'expected "applied_scale" above 0, got {applied:.6g}'
            raise FormatError(found.path, problem)
        if applied != 1:
            world.poses = Rigid3(world.poses.translation_m / applied, world.poses.quat_xyzw)
            world.notes.append(f"scale: applied_scale {applied:.6g} was undone")
    if (given := found.members.get("applied_transform")) is None:
        return
    matrix, problem = read_matrix(found.path, given, 1)
    if problem:
        raise FormatError(found.path, problem.replace("transform_matrix", "applied_transform"))
    matrix = to_rows(matrix[None])[0][0]
    rotation = matrix[:3, :3]
    length = float(np.cbrt(abs(np.linalg.det(rotation))))
    is_turn = length > 1e-6 and np.allclose(rotation.T @ rotation, length**2 * np.eye(3), atol=1e-3)
    if not is_turn or np.linalg.det(rotation) < 0:
        world.notes.append("world: applied_transform is no turn with a scale, and is kept")
        return
    if is_app_turn(found):
        world.up = "definition"
    turn = quaternion.from_matrix(rotation / length)
    file_from_tracker = Rigid3(matrix[:3, 3], turn)
    undone = file_from_tracker.inverse() @ world.poses
    world.poses = Rigid3(undone.translation_m / length, undone.quat_xyzw)
    if not np.allclose(matrix, np.eye(4), atol=1e-9):
        world.notes.append("world: applied_transform was undone")
