"""How networks say a rotation: as log-quaternion, quaternion or two columns of a matrix.

Every code turns network outputs, shape (B, code.size), into unit quaternions xyzw of
world_from_cam, shape (B, 4), and says how far outputs are from a true rotation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

_TINY = 1e-12
_EYE_6D = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class RotationCode(NamedTuple):
    """A way to say a rotation.

    Attributes:
        name: On the command line.
        size: Numbers that a network puts out.
        start: What an untrained network should say: no rotation.
        to_quat: Outputs (B, size) to quaternions xyzw (B, 4).
        residual: Outputs (B, size) and true quaternions xyzw (B, 4) to differences (B, k), whose
            norm the losses take.
    """

    name: str
    size: int
    start: tuple[float, ...]
    to_quat: Callable[[Tensor], Tensor]
    residual: Callable[[Tensor, Tensor], Tensor]


def log_of_quat(quat_xyzw: Tensor) -> Tensor:
    """Log-quaternion: axis times half the angle, rad; (B, 4) to (B, 3)."""
    quat_xyzw = torch.where(quat_xyzw[:, 3:] < 0, -quat_xyzw, quat_xyzw)
    vector, scalar = quat_xyzw[:, :3], quat_xyzw[:, 3:]
    length = torch.linalg.vector_norm(vector, dim=-1, keepdim=True).clamp_min(_TINY)
    return vector / length * torch.atan2(length, scalar)


def quat_of_log(log_quat: Tensor) -> Tensor:
    """Inverse of `log_of_quat`."""
    half = torch.sqrt((log_quat * log_quat).sum(dim=-1, keepdim=True) + _TINY)
    return torch.cat([log_quat * (torch.sin(half) / half), torch.cos(half)], dim=-1)


def matrix_of_quat(quat_xyzw: Tensor) -> Tensor:
    """Unit quaternions xyzw (B, 4) to rotation matrices (B, 3, 3)."""
    x, y, z, w = quat_xyzw.unbind(dim=-1)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def quat_of_matrix(matrix: Tensor) -> Tensor:
    """Rotation matrices (B, 3, 3) to unit quaternions xyzw (B, 4).

    Of the four products of a quaternion with one of its own components, the one with the
    largest component is exact (Shepperd 1978); chosen without branches.
    """
    m = matrix
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    xw, yw, zw = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    products = torch.stack(
        [
            torch.stack([1 + xx - yy - zz, xy, xz, xw], dim=-1),
            torch.stack([xy, 1 - xx + yy - zz, yz, yw], dim=-1),
            torch.stack([xz, yz, 1 - xx - yy + zz, zw], dim=-1),
            torch.stack([xw, yw, zw, 1 + xx + yy + zz], dim=-1),
        ],
        dim=-2,
    )
    squares = products.diagonal(dim1=-2, dim2=-1)
    is_largest = (squares >= squares.amax(dim=-1, keepdim=True)).to(matrix.dtype)
    # Two may be equal: their rows agree up to sign, so the first alone must count.
    is_first = is_largest * (is_largest.cumsum(dim=-1) < 1.5).to(matrix.dtype)
    return functional.normalize((products * is_first[..., None]).sum(dim=-2), dim=-1)


def _columns(code: Tensor) -> Tensor:
    """Six numbers to the rotation's first two columns, orthonormal, shape (B, 2, 3)."""
    first = functional.normalize(code[:, :3], dim=-1)
    second = code[:, 3:] - (first * code[:, 3:]).sum(dim=-1, keepdim=True) * first
    return torch.stack([first, functional.normalize(second, dim=-1)], dim=1)


def _quat_of_6d(code: Tensor) -> Tensor:
    first, second = _columns(code).unbind(dim=1)
    third = torch.linalg.cross(first, second, dim=-1)
    return quat_of_matrix(torch.stack([first, second, third], dim=-1))


def _residual_6d(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    true = matrix_of_quat(quat_xyzw)[:, :, :2].transpose(1, 2)
    return (_columns(code) - true).flatten(1)


def _residual_quat(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    found = functional.normalize(code, dim=-1)
    # q and -q are one rotation.
    sign = torch.where((found * quat_xyzw).sum(dim=-1, keepdim=True) < 0, -1.0, 1.0)
    return found - sign * quat_xyzw


def _residual_log(code: Tensor, quat_xyzw: Tensor) -> Tensor:
    return code - log_of_quat(quat_xyzw)


ROTATION_CODES = {
    code.name: code
    for code in (
        # Brahmbhatt et al., CVPR 2018: what the paper's PoseNet uses.
        RotationCode("log-quat", 3, (0.0, 0.0, 0.0), quat_of_log, _residual_log),
        # Kendall et al., ICCV 2015; MS-Transformer.
        RotationCode(
            "quat", 4, (0.0, 0.0, 0.0, 1.0),
            lambda code: functional.normalize(code, dim=-1), _residual_quat,
        ),
        # Zhou et al., CVPR 2019: without the jump that the others have at half turns.
        RotationCode("6d", 6, _EYE_6D, _quat_of_6d, _residual_6d),
    )
}  # fmt: skip


def angle_rad(left_xyzw: Tensor, right_xyzw: Tensor) -> Tensor:
    """Between rotations, shape (B,)."""
    cosine = (left_xyzw * right_xyzw).sum(dim=-1).abs()
    sine = torch.sqrt((1 - cosine * cosine).clamp_min(_TINY))
    return 2 * torch.atan2(sine, cosine)
