"""Camera poses from points and pixels, robustly: fixed Gauss-Newton steps, no branches.

Poses are cam_from_world, many hypotheses at once. Outliers lose their say gradually (graduated
non-convexity with Geman and McClure's kernel), or start without it where a hypothesis rests on
few matches.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

_NEAREST_M = 0.1
"""Depth below which a point is not seen."""

_DAMPING = 1e-3
"""Share of the diagonal that is added to it."""

_FLOOR = 1e-2
"""Added to the diagonal, so that it can be solved without any match."""

_LARGEST_RAD = 0.5
"""Of a step."""

_HOLD = 0.3
"""Share of the steps, at the end, with the smallest kernel."""


class Poses(NamedTuple):
    """Hypotheses of a camera's pose, cam_from_world.

    Attributes:
        rotation: (..., 3, 3).
        translation_m: (..., 3).
    """

    rotation: Tensor
    translation_m: Tensor

    def at(self, index: Tensor) -> Poses:
        """Choose along the first axis."""
        return Poses(*(torch.index_select(part, 0, index) for part in self))


class Matches(NamedTuple):
    """Points of the map and where the image shows them.

    Attributes:
        world_m: (..., N, 3).
        pixel: (..., N, 2).
        weight: (..., N), 0 for none.
    """

    world_m: Tensor
    pixel: Tensor
    weight: Tensor


class Residuals(NamedTuple):
    """Where points appear by a pose.

    Attributes:
        cam_m: (..., N, 3), in the camera's axes.
        inverse_depth: (..., N), 1 / m, bounded.
        gap: (..., N, 2), where they should appear less where the image shows them, pixels.
        is_in_front: (..., N), 1 or 0.
    """

    cam_m: Tensor
    inverse_depth: Tensor
    gap: Tensor
    is_in_front: Tensor

    @property
    def squared(self) -> Tensor:
        """Squared distances, pixels^2, (..., N)."""
        return (self.gap * self.gap).sum(dim=-1)


def project(camera: Tensor, poses: Poses, matches: Matches) -> Residuals:
    """Compare matches with poses.

    Args:
        camera: (4,), fx, fy, cx, cy in pixels.
        poses: (...).
        matches: (..., N); leading axes of both are broadcast.
    """
    cam_m = matches.world_m @ poses.rotation.mT + poses.translation_m[..., None, :]
    inverse_depth = 1 / torch.clamp(cam_m[..., 2], min=_NEAREST_M)
    seen = camera[:2] * cam_m[..., :2] * inverse_depth[..., None] + camera[2:]
    is_in_front = (cam_m[..., 2] > _NEAREST_M).to(cam_m.dtype)
    return Residuals(cam_m, inverse_depth, seen - matches.pixel, is_in_front)


def refine(
    camera: Tensor,
    poses: Poses,
    matches: Matches,
    *,
    steps: int,
    kernel_px: tuple[float, float],
) -> Poses:
    """Improve poses by Gauss-Newton steps.

    Args:
        camera: (4,), fx, fy, cx, cy in pixels.
        poses: To start from.
        matches: To fit.
        steps: How many.
        kernel_px: Size of the robust kernel at the beginning and at the end.
    """
    first, last = kernel_px
    shrinking = max(1, round(steps * (1 - _HOLD)) - 1)
    for step in range(steps):
        size = first * (last / first) ** min(1.0, step / shrinking)
        residuals = project(camera, poses, matches)
        weight = matches.weight * residuals.is_in_front * _kernel(residuals.squared, size)
        information, gradient = _normal_equations(camera, residuals, weight)
        poses = _moved(poses, -_solve(_damped(information), gradient))
    return poses


def score(
    camera: Tensor, poses: Poses, matches: Matches, kernel_px: float
) -> tuple[Tensor, Tensor]:
    """How well poses fit, (...): the robust sum, and how many matches lie within the kernel."""
    residuals = project(camera, poses, matches)
    weight = (matches.weight > 0).to(residuals.gap.dtype) * residuals.is_in_front
    is_inlier = (residuals.squared < kernel_px * kernel_px).to(weight.dtype)
    fit = (weight * _kernel(residuals.squared, kernel_px)).sum(dim=-1)
    return fit, (weight * is_inlier).sum(dim=-1)


def information_of(camera: Tensor, poses: Poses, matches: Matches, kernel_px: float) -> Tensor:
    """The inverse covariance of poses for a pixel of noise, (..., 6, 6): turn, then shift.

    Of small changes on the left, in the camera's axes: rad and m.
    """
    residuals = project(camera, poses, matches)
    weight = matches.weight * residuals.is_in_front * _kernel(residuals.squared, kernel_px)
    return _damped(_normal_equations(camera, residuals, weight)[0])


def inverse(information: Tensor) -> Tensor:
    """Invert positive definite matrices (..., 6, 6) by elimination, without branches."""
    size = information.shape[-1]
    unit = torch.eye(size, dtype=information.dtype, device=information.device)
    # Radians and metres differ so much that single precision needs rows of one size.
    scale = 1 / torch.sqrt((information * unit).sum(dim=-1))
    scale = scale[..., :, None] * scale[..., None, :]
    rows = torch.cat([information * scale, unit.expand_as(information)], dim=-1)
    return _eliminate(rows)[..., size:] * scale


def _kernel(squared: Tensor, size_px: float) -> Tensor:
    """Geman and McClure's weights."""
    share = 1 / (1 + squared / (size_px * size_px))
    return share * share


def _normal_equations(
    camera: Tensor, residuals: Residuals, weight: Tensor
) -> tuple[Tensor, Tensor]:
    """Information (..., 6, 6) and gradient (..., 6, 1) by a turn and a shift on the left."""
    inverse_depth = residuals.inverse_depth
    x, y = (residuals.cam_m[..., axis] * inverse_depth for axis in (0, 1))
    zero = torch.zeros_like(x)
    by_x = torch.stack([-x * y, 1 + x * x, -y, inverse_depth, zero, -x * inverse_depth], dim=-1)
    by_y = torch.stack([-1 - y * y, x * y, x, zero, inverse_depth, -y * inverse_depth], dim=-1)
    jacobian = torch.cat([by_x * camera[0], by_y * camera[1]], dim=-2)
    weighted = (jacobian * torch.cat([weight, weight], dim=-1)[..., None]).mT
    gap = torch.cat([residuals.gap[..., 0], residuals.gap[..., 1]], dim=-1)
    return weighted @ jacobian, weighted @ gap[..., None]


def _damped(information: Tensor) -> Tensor:
    unit = torch.eye(6, dtype=information.dtype, device=information.device)
    return information * (1 + _DAMPING * unit) + _FLOOR * unit


def _solve(information: Tensor, gradient: Tensor) -> Tensor:
    """(..., 6) from (..., 6, 6) and (..., 6, 1)."""
    return _eliminate(torch.cat([information, gradient], dim=-1))[..., 6]


def _eliminate(rows: Tensor) -> Tensor:
    """Gauss and Jordan's elimination of the first square of (..., n, m)."""
    count = rows.shape[-2]
    unit = torch.eye(count, dtype=rows.dtype, device=rows.device)
    for index in range(count):
        pivot = rows[..., index : index + 1, :] / rows[..., index : index + 1, index : index + 1]
        column = rows[..., :, index : index + 1] - unit[:, index : index + 1]
        rows = rows - column * pivot
    return rows


def _moved(poses: Poses, change: Tensor) -> Poses:
    """Poses after a turn and a shift on the left, (..., 6), of bounded size."""
    angle = torch.sqrt((change[..., :3] * change[..., :3]).sum(dim=-1, keepdim=True) + 1e-12)
    change = change * torch.clamp(_LARGEST_RAD / angle, max=1.0)
    turn = rotation_of(change[..., :3])
    return Poses(
        turn @ poses.rotation,
        (turn @ poses.translation_m[..., None])[..., 0] + change[..., 3:],
    )


def rotation_of(rotvec: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), by Rodrigues' formula."""
    squared = (rotvec * rotvec).sum(dim=-1)[..., None, None] + 1e-12
    angle = torch.sqrt(squared)
    x, y, z = rotvec[..., 0], rotvec[..., 1], rotvec[..., 2]
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1)
    cross = cross.reshape(*rotvec.shape[:-1], 3, 3)
    unit = torch.eye(3, dtype=rotvec.dtype, device=rotvec.device)
    return (
        unit + torch.sin(angle) / angle * cross + (1 - torch.cos(angle)) / squared * (cross @ cross)
    )
