"""The pose conventions of files, each a conversion to world_from_cam with OpenCV axes.

A file gives seven numbers, a vector and a quaternion, and what they mean differs. Every
function here takes the poses as a file has them to ours, and, being its own inverse, takes
ours to the file's.
"""

from __future__ import annotations

from vioapr.geometry import frames, quaternion
from vioapr.geometry.rigid import Rigid3


def world_from_cam(poses: Rigid3) -> Rigid3:
    """Position and rotation of an OpenCV camera in the world: as ours."""
    return poses


def cam_from_world(poses: Rigid3) -> Rigid3:
    """COLMAP: p_cam = R p_world + t; t is not the camera's position."""
    return poses.inverse()


def centre_and_cam_from_world(poses: Rigid3) -> Rigid3:
    """VisualSfM: the camera's position in the world, but the rotation cam_from_world."""
    return poses._replace(quat_xyzw=quaternion.inverse(poses.quat_xyzw))


def world_from_arcam(poses: Rigid3) -> Rigid3:
    """Position and rotation of an OpenGL camera (y up, looking along -z) in the world."""
    return frames.cam_from_arcam(poses)


def unity(poses: Rigid3) -> Rigid3:
    """Position and rotation of a Unity camera in Unity's left-handed, y-up world.

    Mirroring z makes of Unity's world a right-handed one that is still y up, as the `vio`
    frame must be, and of its camera one with OpenGL axes, which is then turned to OpenCV's.
    (Mirroring y instead gives the OpenCV camera at once, but a world that is y down.)
    """
    return frames.cam_from_arcam(frames.mirror_z(poses))
