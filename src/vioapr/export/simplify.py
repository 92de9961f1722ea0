"""Fewer nodes, with the same numbers.

On small tensors a node costs about a microsecond whatever it computes, so their number is what
the fusion step costs. PyTorch's own optimization is not used: it takes additions of numbers below
1e-8 for additions of zero, and a denominator's `+ 1e-12` is there for a reason.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx_ir as ir
import onnx_ir.passes.common as passes
from onnxscript import optimizer, rewriter
from onnxscript.rewriter import pattern
from onnxscript.rewriter.rules import common


def simplify(model: Any) -> None:
    """Fold constants, drop what is not used or done twice, and merge nodes; in place."""
    passes.InlinePass()(model)
    for _ in range(2):
        optimizer.fold_constants_ir(model, onnx_shape_inference=True)
        rewriter.rewrite(model, _rules())
    tidying = ir.passes.Sequential(
        passes.IdentityEliminationPass(),
        passes.RemoveUnusedNodesPass(),
        passes.RemoveUnusedFunctionsPass(),
        passes.RemoveUnusedOpsetsPass(),
        passes.LiftConstantsToInitializersPass(lift_all_constants=True, size_limit=0),
        passes.DeduplicateInitializersPass(),
        passes.CommonSubexpressionEliminationPass(),
        passes.OutputFixPass(),
        passes.NameFixPass(),
    )
    tidying(model)


def _rules() -> list[Any]:
    return [
        common.collapse_slice_rule,
        common.collapse_slice2_rule,
        common.cast_cast_rule,
        common.no_op_cast_rule,
        common.no_op_expand_rule,
        common.no_op_transpose_rule,
        common.transpose_transpose_rule,
        common.reshape_reshape_rule,
        common.unsqueeze_unsqueeze_rule,
        common.materialize_reshape_shape_rule,
        common.fuse_batchnorm_into_conv_rule,
        common.fuse_batchnorm_into_gemm_rule,
        pattern.RewriteRule(_root_of_squares, _norm, name="norm"),
        pattern.RewriteRule(_root_of_dot, _last_norm, _is_dot, name="norm of a product"),
        pattern.RewriteRule(_square, _product, _is_two, name="square"),
    ]


def _root_of_squares(op: Any, values: Any, axes: Any) -> Any:
    squares = op.Mul(values, values)
    return op.Sqrt(op.ReduceSum(squares, axes, _allow_other_attributes=True, _outputs=["sum"]))


def _norm(op: Any, values: Any, axes: Any, **bound: Any) -> Any:
    keeps = bound["sum"].producer().attributes.get("keepdims")
    return op.ReduceL2(values, axes, keepdims=1 if keeps is None else keeps.as_int())


def _root_of_dot(op: Any, values: Any, row: Any, column: Any, first: Any, second: Any) -> Any:
    """How PyTorch traces the root of `vecdot(x, x)`: as a product of matrices."""
    product = op.MatMul(op.Unsqueeze(values, row), op.Unsqueeze(values, column))
    inner = op.Gather(product, first, _allow_other_attributes=True)
    return op.Sqrt(op.Gather(inner, second, _allow_other_attributes=True))


def _is_dot(_: Any, values: Any, row: Any, column: Any, **__: Any) -> bool:
    if values.shape is None or row.const_value is None or column.const_value is None:
        return False
    rank = len(values.shape)
    axes = [int(axis.const_value.numpy().item()) for axis in (row, column)]
    return axes == [rank - 1, rank]


def _last_norm(op: Any, values: Any, **_: Any) -> Any:
    axes = op.Constant(value=ir.tensor(np.array([-1], dtype=np.int64)))
    return op.ReduceL2(values, axes, keepdims=0)


def _square(op: Any, values: Any, exponent: Any) -> Any:
    return op.Pow(values, exponent)


def _is_two(_: Any, exponent: Any, **__: Any) -> bool:
    constant = exponent.const_value
    return constant is not None and constant.size == 1 and float(constant.numpy().item()) == 2.0


def _product(op: Any, values: Any, **_: Any) -> Any:
    return op.Mul(values, values)
