"""The operators that the portable file may consist of.

Every operator here is in the documented lists of Unity's inference engine (2.4 and later) and of
onnxruntime-web (its WebAssembly backend runs all standard operators), so that one file runs on
phones, in browsers and in games.
"""

from __future__ import annotations

from collections.abc import Iterable

_ALLOWED = """
Abs Add And ArgMax Atan AveragePool BatchNormalization Cast Clip Concat Constant Conv Cos Div
Equal Erf Exp Expand Flatten Floor Gather Gemm GlobalAveragePool Greater GreaterOrEqual
HardSigmoid HardSwish Identity IsNaN LayerNormalization Less LessOrEqual Log LogSoftmax MatMul
Max MaxPool Min Mul Neg Not Or Pad Pow Range Reciprocal ReduceL2 ReduceMax ReduceMean
ReduceMin ReduceProd ReduceSum Relu Reshape Shape Sigmoid Sin Slice Softmax Softplus Split
Sqrt Squeeze Sub Tanh TopK Transpose Unsqueeze Where
"""

ALLOWED: frozenset[str] = frozenset(_ALLOWED.split())
"""Operators of opset 18 that the portable file may use: none that branches or loops (`If`,
`Loop`, `Scan`), none that quantizes (`QuantizeLinear`, `DequantizeLinear`)."""

QUANTIZED: frozenset[str] = frozenset({"QuantizeLinear", "DequantizeLinear"})
"""Further operators of precision int8-qdq, which Unity does not run."""


def find_forbidden(op_types: Iterable[str], *, is_quantized: bool = False) -> list[str]:
    """List the operators that are not allowed, in order of name."""
    allowed = ALLOWED | QUANTIZED if is_quantized else ALLOWED
    return sorted(set(op_types) - allowed)
