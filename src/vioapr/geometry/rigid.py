"""Rigid transforms `target_from_source`, batched, on any Array API backend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from vioapr.geometry import quaternion
from vioapr.geometry.arrays import (
    Array,
    ArrayT,
    FloatArray,
    Mask,
    constant,
    namespace,
    norm,
    select,
    zeros,
)
from vioapr.geometry.tree import tree_at, tree_map, tree_stack

OtherT = TypeVar("OtherT", bound=Array)


class Rigid3(NamedTuple, Generic[ArrayT]):
    """A rigid transform target_from_source: p_target = R p_source + t.

    Of a camera's `world_from_cam`, the translation is the camera's position in the world.

    Attributes:
        translation_m: Shape (..., 3), metres, in the target frame.
        quat_xyzw: Shape (..., 4), unit, Hamilton.
    """

    translation_m: ArrayT
    quat_xyzw: ArrayT

    def __matmul__(self, other: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
        """Compose: `a_from_b @ b_from_c` is a_from_c."""
        return Rigid3(
            self.apply(other.translation_m), quaternion.multiply(self.quat_xyzw, other.quat_xyzw)
        )

    def inverse(self) -> Rigid3[ArrayT]:
        """source_from_target."""
        source_from_target = quaternion.inverse(self.quat_xyzw)
        return Rigid3(
            -quaternion.rotate(source_from_target, self.translation_m), source_from_target
        )

    def apply(self, points_m: ArrayT) -> ArrayT:
        """Coordinates of points in the target frame, from those in the source, (..., 3)."""
        return quaternion.rotate(self.quat_xyzw, points_m) + self.translation_m

    def to_matrix(self) -> ArrayT:
        """The homogeneous matrix, shape (..., 4, 4)."""
        xp = namespace(self.translation_m)
        rotation = quaternion.to_matrix(self.quat_xyzw)
        top = xp.concat([rotation, self.translation_m[..., None]], axis=-1)
        bottom = constant(np.array([[0.0, 0.0, 0.0, 1.0]]), top) + 0 * top[..., :1, :]
        return xp.concat([top, bottom], axis=-2)

    @staticmethod
    def from_matrix(matrix: OtherT) -> Rigid3[OtherT]:
        """From homogeneous matrices, shape (..., 4, 4) or (..., 3, 4)."""
        return Rigid3(matrix[..., :3, 3], quaternion.from_matrix(matrix[..., :3, :3]))

    @staticmethod
    def identity(batch_shape: tuple[int, ...] = (), *, like: Array | None = None) -> Rigid3[Any]:
        """Identity transforms in the backend, dtype and device of `like` (NumPy float64)."""
        like = np.zeros(()) if like is None else like
        translation = zeros((*batch_shape, 3), like)
        quat = zeros((*batch_shape, 4), like) + constant(np.array([0.0, 0.0, 0.0, 1.0]), like)
        return Rigid3(translation, quat)

    @staticmethod
    def unknown(batch_shape: tuple[int, ...] = ()) -> Rigid3[FloatArray]:
        """Poses that are not known: NaN in all their numbers, NumPy float64."""
        return Rigid3(np.full((*batch_shape, 3), np.nan), np.full((*batch_shape, 4), np.nan))

    @property
    def is_known(self) -> Any:
        """Which poses are known, shape (...): an unknown one is NaN in all its numbers."""
        xp = namespace(self.translation_m)
        return xp.all(xp.isfinite(self.translation_m), axis=-1)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The leading axes."""
        return tuple(self.translation_m.shape[:-1])

    def at(self, index: Any) -> Rigid3[ArrayT]:
        """The transforms at an index of the leading axes."""
        return tree_at(self, index)


def stack(transforms: Sequence[Rigid3[ArrayT]], axis: int = 0) -> Rigid3[ArrayT]:
    """Join transforms along a new batch axis.

    Args:
        transforms: Of one batch shape (...).
        axis: The new axis: from 0 at the front, or, counted from the components' axis, from
            -2 at the back.
    """
    return tree_stack(transforms, axis)


def choose(condition: Mask, if_true: Rigid3[ArrayT], if_false: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """Elementwise choice, condition of shape (...) over transforms of shape (...)."""
    return tree_map(lambda a, b: select(condition, a, b), if_true, if_false)


def between(target_from_a: Rigid3[ArrayT], target_from_b: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
    """a_from_b of two poses in one target frame.

    The same as `target_from_a.inverse() @ target_from_b`, but it subtracts positions before
    it turns them, which keeps single precision exact far from the target's origin.
    """
    a_from_target = quaternion.inverse(target_from_a.quat_xyzw)
    offset = target_from_b.translation_m - target_from_a.translation_m
    return Rigid3(
        quaternion.rotate(a_from_target, offset),
        quaternion.multiply(a_from_target, target_from_b.quat_xyzw),
    )


def distance_m(left: Rigid3[ArrayT], right: Rigid3[ArrayT]) -> ArrayT:
    """Distance between the source origins, both in the same target frame, shape (...)."""
    return norm(left.translation_m - right.translation_m)


def angle_deg(left: Rigid3[ArrayT], right: Rigid3[ArrayT]) -> ArrayT:
    """Angle of the relative rotation in degrees, shape (...)."""
    return quaternion.angle_between_deg(left.quat_xyzw, right.quat_xyzw)


def interpolate(start: Rigid3[ArrayT], end: Rigid3[ArrayT], fraction: ArrayT) -> Rigid3[ArrayT]:
    """Positions linearly, rotations along the shorter arc; fraction of shape (...)."""
    translation = start.translation_m + fraction[..., None] * (
        end.translation_m - start.translation_m
    )
    return Rigid3(translation, quaternion.slerp(start.quat_xyzw, end.quat_xyzw, fraction))
