"""Least-squares alignment of point sets (Umeyama 1991)."""

from __future__ import annotations

from typing import Generic, NamedTuple

import numpy as np

from vioapr.errors import ParameterError
from vioapr.geometry import quaternion
from vioapr.geometry.arrays import ArrayT, constant, namespace
from vioapr.geometry.rigid import Rigid3


class Sim3(NamedTuple, Generic[ArrayT]):
    """A similarity target_from_source: p_target = scale R p_source + t.

    Attributes:
        scale: Shape (...), target units per source unit.
        rigid: Rotation and translation, shape (...).
    """

    scale: ArrayT
    rigid: Rigid3[ArrayT]

    def apply(self, points: ArrayT) -> ArrayT:
        """Coordinates in the target frame, shape (..., 3)."""
        return self.rigid.apply(self.scale[..., None] * points)

    def apply_to(self, source_from_cam: Rigid3[ArrayT]) -> Rigid3[ArrayT]:
        """target_from_cam: positions are scaled, rotations turned."""
        return Rigid3(
            self.apply(source_from_cam.translation_m),
            quaternion.multiply(self.rigid.quat_xyzw, source_from_cam.quat_xyzw),
        )


def align_umeyama(source: ArrayT, target: ArrayT, *, with_scale: bool = False) -> Sim3[ArrayT]:
    """The similarity (or rigid transform) that maps source points best onto target points.

    Args:
        source: Points in the source frame, shape (..., n, 3).
        target: The same points in the target frame, shape (..., n, 3).
        with_scale: Estimate the scale; otherwise it is 1.

    Returns:
        target_from_source, batch shape (...).

    Raises:
        ParameterError: Fewer than three points, or points on one line, so that the rotation
            is not determined.
    """
    xp = namespace(source)
    if source.shape[-2] < 3:
        raise ParameterError(f"alignment needs at least 3 points, got {source.shape[-2]}")
    mean_source, mean_target = xp.mean(source, axis=-2), xp.mean(target, axis=-2)
    centred_source = source - mean_source[..., None, :]
    centred_target = target - mean_target[..., None, :]
    covariance = xp.matrix_transpose(centred_target) @ centred_source / source.shape[-2]
    u, singular, vt = xp.linalg.svd(covariance)
    if bool(xp.any(singular[..., 1] <= 1e-10 * singular[..., 0])):
        raise ParameterError(
            "alignment needs points that are not all on one line: the rotation is not determined"
        )
    handedness = xp.sign(xp.linalg.det(u) * xp.linalg.det(vt))
    signs = constant(np.array([1.0, 1.0, 0.0]), source) + handedness[..., None] * constant(
        np.array([0.0, 0.0, 1.0]), source
    )
    rotation = (u * signs[..., None, :]) @ vt
    variance = xp.mean(xp.sum(centred_source * centred_source, axis=-1), axis=-1)
    scale = xp.sum(singular * signs, axis=-1) / variance
    scale = scale if with_scale else xp.ones_like(scale)
    moved = (rotation @ mean_source[..., None])[..., 0]
    return Sim3(
        scale,
        Rigid3(mean_target - scale[..., None] * moved, quaternion.from_matrix(rotation)),
    )
