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


def simplify(model: ir.Model) -> None:
    """Fold constants, drop nodes that are not used or done twice, and merge nodes; in place."""
    rules = [
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
        common.normalize_pad_format_conv_rule,
        common.fuse_pad_into_conv_rule,
        common.fuse_batchnorm_into_conv_rule,
        common.fuse_batchnorm_into_gemm_rule,
        RootOfSquares.rule(),
        RootOfDotProduct.rule(),
        SquareAsPower.rule(),
    ]
    passes.InlinePass()(model)
    for _ in range(2):
        optimizer.fold_constants_ir(model, onnx_shape_inference=True)
        rewriter.rewrite(model, rules)
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


class RootOfSquares(pattern.RewriteRuleClassBase):
    """The root of a sum of squares is a norm: one operator instead of three."""

    def pattern(self, op: Any, values: Any, axes: Any) -> Any:
        """Sqrt(ReduceSum(values * values, axes))."""
        squares = op.Mul(values, values)
        return op.Sqrt(op.ReduceSum(squares, axes, _allow_other_attributes=True, _outputs=["sum"]))

    def rewrite(self, op: Any, values: Any, axes: Any, sum: Any) -> Any:
        """ReduceL2(values, axes)."""
        keeps = sum.producer().attributes.get("keepdims")
        return op.ReduceL2(values, axes, keepdims=1 if keeps is None else keeps.as_int())


class RootOfDotProduct(pattern.RewriteRuleClassBase):
    """The root of `vecdot(x, x)` is a norm; PyTorch traces it as a product of matrices."""

    def pattern(self, op: Any, values: Any, row: Any, column: Any, first: Any, second: Any) -> Any:
        """Sqrt of a row times a column."""
        product = op.MatMul(op.Unsqueeze(values, row), op.Unsqueeze(values, column))
        inner = op.Gather(product, first, _allow_other_attributes=True)
        return op.Sqrt(op.Gather(inner, second, _allow_other_attributes=True))

    def check(self, context: Any, values: Any, row: Any, column: Any, **_: Any) -> bool:
        """Row and column are the last two axes."""
        if values.shape is None or row.const_value is None or column.const_value is None:
            return False
        axes = [int(axis.const_value.numpy().item()) for axis in (row, column)]
        return axes == [len(values.shape) - 1, len(values.shape)]

    def rewrite(self, op: Any, values: Any, **_: Any) -> Any:
        """ReduceL2 over the last axis."""
        axes = op.Constant(value=ir.tensor(np.array([-1], dtype=np.int64)))
        return op.ReduceL2(values, axes, keepdims=0)


class SquareAsPower(pattern.RewriteRuleClassBase):
    """The second power is a product, which is faster."""

    def pattern(self, op: Any, values: Any, exponent: Any) -> Any:
        """Pow(values, exponent)."""
        return op.Pow(values, exponent)

    def check(self, context: Any, exponent: Any, **_: Any) -> bool:
        """The exponent is 2."""
        constant = exponent.const_value
        return constant is not None and constant.size == 1 and float(constant.numpy().item()) == 2.0

    def rewrite(self, op: Any, values: Any, **_: Any) -> Any:
        """The product of the values with themselves."""
        return op.Mul(values, values)
