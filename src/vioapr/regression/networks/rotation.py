"""Codes of rotations: log-quaternion, quaternion, or two columns of a matrix.

Every code turns network outputs, shape (B, code.size), into unit quaternions xyzw of
world_from_cam, shape (B, 4), and says how far outputs are from a true rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from vioapr.geometry import quaternion

_TINY = 1e-12
_EYE_6D = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class RotationCode(NamedTuple):
    """A code of rotations.

    Attributes:
        name: On the command line.
        size: Numbers that a network puts out.
        start: The code of no rotation, which an untrained network should put out.
        to_quat: Outputs (B, size) to quaternions xyzw (B, 4).
        residual: Outputs (B, size) and true quaternions xyzw (B, 4) to differences (B, k), whose
            norm the losses take.
    """

    name: str
    size: int
    start: tuple[float, ...]
    to_quat: Callable[[Tensor], Tensor]
    residual: Callable[[Tensor, Tensor], Tensor]


def quat_of_log(log_quat: Tensor) -> Tensor:
    """Convert log-quaternions, axis times half the angle in rad; (B, 3) to (B, 4).

    As `quaternion.from_rotvec` of the double, but with a gradient at zero, which networks need.
    """
    half = torch.sqrt((log_quat * log_quat).sum(dim=-1, keepdim=True) + _TINY)
    return torch.cat([log_quat * (torch.sin(half) / half), torch.cos(half)], dim=-1)


def _columns(code: Tensor) -> Tensor:
    """Make the rotation's first two columns, orthonormal, shape (B, 2, 3), by Gram-Schmidt."""
    first = functional.normalize(code[:, :3], dim=-1)
    second = code[:, 3:] - (first * code[:, 3:]).sum(dim=-1, keepdim=True) * first
    return torch.stack([first, functional.normalize(second, dim=-1)], dim=1)


def quat_of_6d(code: Tensor) -> Tensor:
    """Convert two columns of a matrix, made orthonormal; (B, 6) to (B, 4)."""
    first, second = _columns(code).unbind(dim=1)
    third = torch.linalg.cross(first, second, dim=-1)
    return quaternion.from_matrix(torch.stack([first, second, third], dim=-1))


def residual_6d(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    """Subtract the true columns from the orthonormal ones, shape (B, 6)."""
    true = quaternion.to_matrix(quat_xyzw)[:, :, :2].transpose(1, 2)
    return (_columns(code) - true).flatten(1)


def residual_quat(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    """Subtract the nearer of q and -q, which are one rotation, shape (B, 4)."""
    found = functional.normalize(code, dim=-1)
    sign = torch.where((found * quat_xyzw).sum(dim=-1, keepdim=True) < 0, -1.0, 1.0)
    return found - sign * quat_xyzw


def residual_log(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    """Subtract the true log-quaternion, shape (B, 3)."""
    return code - quaternion.to_rotvec(quat_xyzw) / 2


ROTATION_CODES = {
    code.name: code
    for code in (
        # Brahmbhatt et al., CVPR 2018: what the paper's PoseNet uses.
        RotationCode("log-quat", 3, (0.0, 0.0, 0.0), quat_of_log, residual_log),
        # Kendall et al., ICCV 2015; MS-Transformer.
        RotationCode(
            "quat", 4, (0.0, 0.0, 0.0, 1.0),
            lambda code: functional.normalize(code, dim=-1), residual_quat,
        ),
        # Zhou et al., CVPR 2019: without the jump that the others have at half turns.
        RotationCode("6d", 6, _EYE_6D, quat_of_6d, residual_6d),
    )
}  # fmt: skip
