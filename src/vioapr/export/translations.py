"""What PyTorch's functions become in ONNX where its own translation is none that runtimes share.

ONNX has no Cholesky factorization, its sort is `TopK`, and runtimes have no choice between
booleans. `torch.onnx.export` takes these in its table of translations, under the unchanged source
of the fusion methods; the rest of PyTorch's functions are translated by PyTorch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnx_ir as ir
import torch
from onnxscript import opset18

Value = Any
"""A tensor of the graph: an `onnx_ir.Value`, whose type and shape are known."""

op: Any = opset18
"""The operators; while PyTorch exports, calling one adds a node to the graph."""


def sort(values: Value, dim: int = -1, descending: bool = False) -> tuple[Value, Value]:
    """`torch.sort` by the operator `TopK`; ties come in any order."""
    count = op.Constant(value_ints=[values.shape[dim]])
    return op.TopK(values, count, axis=dim, largest=int(descending), sorted=1)


def stable_sort(
    values: Value, stable: bool | None = None, dim: int = -1, descending: bool = False
) -> tuple[Value, Value]:
    """`torch.sort` by its other signature; only values are used, so ties do not matter."""
    return sort(values, dim, descending)


def where(condition: Value, if_true: Value, if_false: Value) -> Value:
    """`torch.where`; runtimes have no `Where` that chooses between booleans."""
    if if_true.dtype != ir.DataType.BOOL:
        return op.Where(condition, if_true, if_false)
    return op.Or(op.And(condition, if_true), op.And(op.Not(condition), if_false))


def vecdot(left: Value, right: Value, dim: int = -1) -> Value:
    """`torch.linalg.vecdot`, in two operators instead of four."""
    return op.ReduceSum(op.Mul(left, right), op.Constant(value_ints=[dim]), keepdims=0)


def diagonal(matrix: Value, offset: int = 0, dim1: int = -2, dim2: int = -1) -> Value:
    """`torch.linalg.diagonal` of square matrices."""
    identity = op.Constant(value=ir.tensor(np.eye(matrix.shape[-1], dtype=np.float32)))
    return op.ReduceSum(op.Mul(matrix, identity), op.Constant(value_ints=[-1]), keepdims=0)


def cholesky(matrix: Value, upper: bool = False) -> Value:
    """`torch.linalg.cholesky`: the lower triangular L with L L^T = matrix, shape (..., n, n).

    Right-looking, six operators a column: what a column explains is taken out of the part that
    is left, which shrinks.
    """
    size, rank = matrix.shape[-1], len(matrix.shape)

    def split(values: Value, axis: int, count: int) -> tuple[Value, Value]:
        sizes = op.Constant(value_ints=[1, count - 1])
        parts = op.SplitToSequence(values, sizes, axis=axis)
        first, rest = (op.SequenceAt(parts, op.Constant(value_int=k)) for k in (0, 1))
        return first, rest

    rows, rest = [], matrix
    for count in range(size, 1, -1):
        row, below = split(rest, -2, count)
        column, inner = split(below, -1, count)
        pivot, right = split(row, -1, count)
        rows.append(row)
        rest = op.Sub(inner, op.Mul(column, op.Div(right, pivot)))
    rows.append(rest)
    # Rows of D^1/2 L^T without their zeros: put these in front, and scale by the pivots.
    for index in range(1, size):
        front = op.Constant(value_ints=[0] * (rank - 1) + [index] + [0] * rank)
        rows[index] = op.Pad(rows[index], front)
    scaled = op.Concat(*rows, axis=-2)
    identity = op.Constant(value=ir.tensor(np.eye(size, dtype=np.float32)))
    last_axis = op.Constant(value_ints=[-1])
    pivots = op.ReduceSum(op.Mul(scaled, identity), last_axis, keepdims=1)
    order = [*range(rank - 2), rank - 1, rank - 2]
    return op.Transpose(op.Div(scaled, op.Sqrt(pivots)), perm=order)


TRANSLATIONS: dict[Callable[..., Any], Callable[..., Any]] = {
    torch.ops.aten.sort.default: sort,
    torch.ops.aten.sort.stable: stable_sort,
    torch.ops.aten.where.self: where,
    torch.ops.aten.linalg_vecdot.default: vecdot,
    torch.ops.aten.diagonal.default: diagonal,
    torch.ops.aten.linalg_diagonal.default: diagonal,
    torch.ops.aten.linalg_cholesky.default: cholesky,
}
"""For `torch.onnx.export`, by PyTorch's operator."""
