"""Changes between the axis conventions of other programs and ours.

Ours (docs/reference/conventions.md): `world` metres, z up; `vio` metres, y up; `cam` x right,
y down, z forward (OpenCV); `arcam` x right, y up, looking along -z (OpenGL, ARKit, ARCore, WebXR).
"""

from __future__ import annotations

import numpy as np

from vioapr.geometry import quaternion
from vioapr.geometry.arrays import ArrayT, FloatArray, constant
from vioapr.geometry.rigid import Rigid3

_HALF_TURN_ABOUT_X = np.array([1.0, 0.0, 0.0, 0.0])
_QUARTER_TURN_ABOUT_X = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def cam_from_arcam(target_from_arcam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """target_from_cam of a camera given with OpenGL axes; it is its own inverse.

    The name says what changes: the camera's axes, by diag(1, -1, -1) on the right.
    """
    half_turn = constant(_HALF_TURN_ABOUT_X, target_from_arcam.quat_xyzw)
    return target_from_arcam._replace(
        quat_xyzw=quaternion.multiply(target_from_arcam.quat_xyzw, half_turn)
    )


def z_up_from_y_up(y_up_from_cam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """Poses in the z-up world that shares x with a y-up world: (x, y, z) becomes (x, -z, y)."""
    return _turn_world(y_up_from_cam, _QUARTER_TURN_ABOUT_X)


def y_up_from_z_up(z_up_from_cam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """The inverse of `z_up_from_y_up`: (x, y, z) becomes (x, z, -y)."""
    return _turn_world(z_up_from_cam, _QUARTER_TURN_ABOUT_X * np.array([-1.0, 1.0, 1.0, 1.0]))


def mirror_y(left_handed_from_cam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """Unity's poses (left-handed, y up) as right-handed ones, both frames mirrored in y.

    Unity's world (x right, y up, z forward) becomes a y-down world and its camera becomes an
    OpenCV camera: positions y -> -y; of a quaternion, mirroring keeps the component along the
    mirrored axis and w, and negates the two others, which is the same rotation as y -> -y,
    w -> -w. It is its own inverse.
    """
    translation = left_handed_from_cam.translation_m
    quat = left_handed_from_cam.quat_xyzw
    return Rigid3(
        translation * constant(np.array([1.0, -1.0, 1.0]), translation),
        quat * constant(np.array([-1.0, 1.0, -1.0, 1.0]), quat),
    )


def mirror_z(left_handed_from_arcam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """Poses of a y-up left-handed world as y-up right-handed ones, both frames mirrored in z.

    Unity's world and camera become ARKit's: y up, the camera looking along -z. It is its own
    inverse.
    """
    translation = left_handed_from_arcam.translation_m
    quat = left_handed_from_arcam.quat_xyzw
    return Rigid3(
        translation * constant(np.array([1.0, 1.0, -1.0]), translation),
        quat * constant(np.array([-1.0, -1.0, 1.0, 1.0]), quat),
    )


def _turn_world(world_from_cam: Rigid3[ArrayT], turn_xyzw: FloatArray) -> Rigid3[ArrayT]:
    new_from_world = Rigid3(
        constant(np.zeros(3), world_from_cam.translation_m),
        constant(turn_xyzw, world_from_cam.quat_xyzw),
    )
    return new_from_world @ world_from_cam
