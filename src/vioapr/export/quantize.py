"""Smaller and faster weights for the regressor; fusion stays in single precision."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from vioapr.errors import MissingExtraError, ParameterError

_SMALLEST = 1024
"""Elements from which a tensor's precision matters for the file's size."""

_OF_8_BITS = ("Conv", "Gemm", "MatMul", "Add", "MaxPool", "Relu")
"""Operators that int8-qdq quantizes."""

Calibration = Callable[[], list[NDArray[np.float32]]]


def change_precision(
    network: onnx.ModelProto, precision: str, calibration: Calibration | None
) -> onnx.ModelProto:
    """The network in another precision.

    Args:
        network: In single precision, as traced; it stays as it is.
        precision: `fp16w`: half-precision weights that are cast back, so that arithmetic stays
            in single precision. `int8w`: weights of 8 bits with a scale a channel, likewise.
            `int8-qdq`: arithmetic of 8 bits up to the last convolution, with ranges from
            calibration images; what follows is as with `int8w`.
        calibration: For int8-qdq: gives network inputs.

    Raises:
        ParameterError: Unknown precision, or no calibration images.
    """
    if precision == "fp16w":
        return _store(network, _as_half)
    if precision == "int8w":
        return _store(network, _as_int8)
    if precision != "int8-qdq":
        raise ParameterError(f"unknown precision {precision!r}")
    if calibration is None:
        raise ParameterError("int8-qdq needs images to calibrate on")
    return _store(_quantize(network, calibration()), _as_int8)


Stored = tuple[list[onnx.TensorProto], list[onnx.NodeProto]]


def _store(network: onnx.ModelProto, encode: Callable[[str, NDArray, bool], Stored]) -> Any:
    """Replace every large weight by a smaller tensor and the nodes that bring it back."""
    model = onnx.ModelProto()
    model.CopyFrom(network)
    kept, nodes = [], []
    channels = _channel_axes(model)
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.data_type != TensorProto.FLOAT or values.size < _SMALLEST:
            kept.append(tensor)
            continue
        stored, decoding = encode(tensor.name, values, channels.get(tensor.name, 0) == 1)
        kept += stored
        nodes += decoding
    nodes += model.graph.node
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(kept)
    model.graph.node.extend(nodes)
    return model


def _channel_axes(model: onnx.ModelProto) -> dict[str, int]:
    """The axis of the output channels of weights where that is not 0: of plain products."""
    axes = {}
    for node in model.graph.node:
        is_transposed = any(a.name == "transB" and a.i for a in node.attribute)
        if node.op_type == "MatMul" or (node.op_type == "Gemm" and not is_transposed):
            axes[node.input[1]] = 1
    return axes


def _as_half(name: str, values: NDArray, _: bool) -> Stored:
    limit = np.finfo(np.float16).max
    half = np.clip(values, -limit, limit).astype(np.float16)
    cast = helper.make_node("Cast", [f"{name}_fp16"], [name], to=TensorProto.FLOAT)
    return [numpy_helper.from_array(half, f"{name}_fp16")], [cast]


def _as_int8(name: str, values: NDArray, is_last: bool) -> Stored:
    axis = values.ndim - 1 if is_last else 0
    others = tuple(k for k in range(values.ndim) if k != axis)
    largest = np.abs(values).max(axis=others, keepdims=True)
    scale = np.where(largest > 0, largest / 127, 1.0).astype(np.float32)
    rounded = np.rint(values / scale).astype(np.int8)
    tensors = [
        numpy_helper.from_array(rounded, f"{name}_int8"),
        numpy_helper.from_array(scale, f"{name}_scale"),
    ]
    nodes = [
        helper.make_node("Cast", [f"{name}_int8"], [f"{name}_cast"], to=TensorProto.FLOAT),
        helper.make_node("Mul", [f"{name}_cast", f"{name}_scale"], [name]),
    ]
    return tensors, nodes


def _quantize(network: onnx.ModelProto, images: list[NDArray[np.float32]]) -> onnx.ModelProto:
    """Static quantization of convolutions and what lies between them, weights per channel."""
    try:
        from onnxruntime import quantization
        from onnxruntime.quantization.shape_inference import quant_pre_process
    except ImportError:
        raise MissingExtraError("--precision int8-qdq", "onnxruntime", "export") from None
    if not images:
        raise ParameterError("int8-qdq: expected images to calibrate on, got none")

    class Reader(quantization.CalibrationDataReader):
        def __init__(self) -> None:
            self._left = iter(images)

        def get_next(self) -> dict[str, NDArray] | None:  # type: ignore[override]
            image = next(self._left, None)
            has_image = np.ones(1, dtype=np.float32)
            return None if image is None else {"network_input": image, "has_image": has_image}

    with tempfile.TemporaryDirectory() as folder:
        plain, prepared, done = (str(Path(folder, f"{k}.onnx")) for k in range(3))
        onnx.save(network, plain)
        level = logging.root.level
        logging.root.setLevel(logging.ERROR)
        try:
            quant_pre_process(plain, prepared, skip_symbolic_shape=True)
            quantization.quantize_static(
                prepared,
                done,
                Reader(),
                quant_format=quantization.QuantFormat.QDQ,
                per_channel=True,
                activation_type=quantization.QuantType.QUInt8,
                weight_type=quantization.QuantType.QInt8,
                op_types_to_quantize=list(_OF_8_BITS),
                nodes_to_exclude=_after_last_convolution(onnx.load(prepared)),
                # Ranges are means over the images of each one's extremes: one odd image would
                # widen those of the largest values and take resolution from all others.
                extra_options={"CalibMovingAverage": True},
            )
        finally:
            logging.root.setLevel(level)
        return onnx.load(done)


def _after_last_convolution(model: onnx.ModelProto) -> list[str]:
    """Names of nodes: heads and arithmetic of poses, which 8 bits would round to decimetres."""
    nodes = model.graph.node
    last = max((row for row, node in enumerate(nodes) if node.op_type == "Conv"), default=-1)
    return [node.name for node in nodes[last + 1 :]]
