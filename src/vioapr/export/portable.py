"""What fusion methods compute with, out of operators that every runtime has.

ONNX has neither a Cholesky factorization nor a sort, and runtimes have no choice between
booleans. While `PortableFunctions` is active, PyTorch's own are replaced, under the unchanged
source of the fusion methods.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode


class PortableFunctions(TorchFunctionMode):
    """A context in which some of PyTorch's functions are those below."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """PyTorch's hook: every call of its functions passes here."""
        return _REPLACEMENTS.get(func, func)(*args, **(kwargs or {}))


def sort(values: Tensor, dim: int = -1, descending: bool = False, stable: bool = False) -> Any:
    """As `torch.sort`, by the operator `TopK`; ties come in any order."""
    return torch.topk(values, values.shape[dim], dim=dim, largest=descending, sorted=True)


def where(condition: Tensor, if_true: Any, if_false: Any) -> Tensor:
    """As `torch.where`; runtimes have no `Where` that chooses between booleans."""
    if isinstance(if_true, Tensor) and if_true.dtype == torch.bool:
        return (condition & if_true) | (~condition & if_false)
    return _where(condition, if_true, if_false)


_where = torch.where


def cholesky(matrix: Tensor) -> Tensor:
    """The lower triangular L with L L^T = matrix, shape (..., n, n).

    Right-looking, six operators a column: what a column explains is taken out of the part that
    is left, which shrinks.
    """
    size = matrix.shape[-1]
    columns = []
    rest = matrix
    for _ in range(size - 1):
        row, below = rest.split([1, rest.shape[-2] - 1], dim=-2)
        column, inner = below.split([1, rest.shape[-1] - 1], dim=-1)
        columns.append(row)
        pivot, right = row.split([1, row.shape[-1] - 1], dim=-1)
        rest = inner - column * (right / pivot)
    columns.append(rest)
    # Rows of D^1/2 L^T without their zeros: put these in front, and scale by the pivots.
    padded = [torch.nn.functional.pad(row, (size - row.shape[-1], 0)) for row in columns]
    upper = torch.cat(padded, dim=-2)
    pivots = torch.sum(upper * torch.tensor(np.eye(size), dtype=matrix.dtype), dim=-1, keepdim=True)
    return torch.transpose(upper * torch.rsqrt(pivots), -1, -2)


def diagonal(matrix: Tensor, **_: Any) -> Tensor:
    """As `torch.linalg.diagonal` of square matrices."""
    identity = torch.tensor(np.eye(matrix.shape[-1]), dtype=matrix.dtype)
    return torch.sum(matrix * identity, dim=-1)


def vecdot(left: Tensor, right: Tensor, *, dim: int = -1) -> Tensor:
    """As `torch.linalg.vecdot`, in two operators instead of four."""
    return torch.sum(left * right, dim=dim)


_REPLACEMENTS: dict[Any, Any] = {
    torch.linalg.vecdot: vecdot,
    torch.diagonal: diagonal,
    torch.linalg.diagonal: diagonal,
    torch.sort: sort,
    torch.where: where,
    torch.linalg.cholesky: cholesky,
}
