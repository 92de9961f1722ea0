"""Smaller and faster weights for the regressor; fusion stays in single precision."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from vioapr.errors import FormatError, MissingExtraError, ParameterError
from vioapr.export.onnx_graph import quiet_loggers
from vioapr.export.preprocess import Preprocessor
from vioapr.files.images import read_rgb
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import Scene

_SMALLEST = 1024
"""Elements from which a tensor's precision matters for the file's size."""

_OF_8_BITS = ("Conv", "Gemm", "MatMul", "Add", "MaxPool", "Relu", "Clip")
"""Operators that int8-qdq quantizes."""

CALIBRATION_IMAGES = 100
"""More do not change the ranges by much."""

Calibration = Callable[[], list[NDArray[np.float32]]]
"""Gives the network's inputs, shape (1, 3, crop, crop) each."""

Stored = tuple[list[onnx.TensorProto], list[onnx.NodeProto]]
"""A weight's smaller tensors, and the nodes that bring it back."""


def change_precision(
    network: onnx.ModelProto, precision: str, calibration: Calibration | None
) -> onnx.ModelProto:
    """The network in another precision.

    Args:
        network: In single precision, as traced; it stays as it is.
        precision: `fp16w`: half-precision weights that are cast back, so that arithmetic stays
            in single precision. `int8w`: weights of 8 bits with a scale a channel, and arithmetic
            in single precision. `int8-qdq`: arithmetic of 8 bits up to the last convolution, with
            ranges from calibration images; the rest is as with `int8w`.
        calibration: For int8-qdq: gives network inputs.

    Raises:
        ParameterError: Unknown precision, or no calibration images.
    """
    if precision == "fp16w":
        return store_weights(network, to_fp16)
    if precision == "int8w":
        return store_weights(network, to_int8)
    if precision != "int8-qdq":
        raise ParameterError(f"unknown precision {precision!r}")
    if calibration is None:
        raise ParameterError("int8-qdq needs images to calibrate on")
    return store_weights(quantize(network, calibration()), to_int8)


def store_weights(
    network: onnx.ModelProto, encode: Callable[[str, NDArray, int], Stored]
) -> onnx.ModelProto:
    """Replace every large weight by a smaller tensor and the nodes that bring it back.

    Args:
        network: It stays as it is.
        encode: Given a weight's name, values and axis of output channels.
    """
    model = onnx.ModelProto()
    model.CopyFrom(network)
    # Weights of convolutions begin with the output channels, those of plain products end so.
    products = set()
    for node in model.graph.node:
        is_transposed = any(a.name == "transB" and a.i for a in node.attribute)
        if node.op_type == "MatMul" or (node.op_type == "Gemm" and not is_transposed):
            products.add(node.input[1])
    # Rows that are looked up are no weights: poses in 8 bits would be off by decimetres.
    tables = {node.input[0] for node in model.graph.node if node.op_type == "Gather"}
    kept, nodes = [], []
    for tensor in network.graph.initializer:
        values = numpy_helper.to_array(tensor)
        is_weight = tensor.data_type == TensorProto.FLOAT and tensor.name not in tables
        if not is_weight or values.size < _SMALLEST:
            kept.append(tensor)
            continue
        axis = values.ndim - 1 if tensor.name in products else 0
        stored, decoding = encode(tensor.name, values, axis)
        kept += stored
        nodes += decoding
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(kept)
    model.graph.node.extend([*nodes, *network.graph.node])
    return model


def to_fp16(name: str, values: NDArray, axis: int) -> Stored:
    """Store a weight in half precision; larger numbers become its largest."""
    limit = np.finfo(np.float16).max
    half = np.clip(values, -limit, limit).astype(np.float16)
    cast = helper.make_node("Cast", [f"{name}_fp16"], [name], to=TensorProto.FLOAT)
    return [numpy_helper.from_array(half, f"{name}_fp16")], [cast]


def to_int8(name: str, values: NDArray, axis: int) -> Stored:
    """Store a weight in 8 bits, with a scale for every output channel (along the axis)."""
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


def quantize(network: onnx.ModelProto, images: list[NDArray[np.float32]]) -> onnx.ModelProto:
    """Quantize convolutions and the operators between them statically, weights per channel.

    Heads and arithmetic of poses, behind the last convolution, stay in single precision: 8 bits
    would round poses to decimetres.

    Args:
        network: As traced.
        images: Network inputs, by which the ranges are found.

    Raises:
        ParameterError: No images.
        MissingExtraError: onnxruntime is not installed.
    """
    try:
        from onnxruntime import quantization
        from onnxruntime.quantization.shape_inference import quant_pre_process
    except ImportError:
        raise MissingExtraError("precision int8-qdq", "onnxruntime", "export") from None
    if not images:
        raise ParameterError("int8-qdq: expected images to calibrate on, got none")

    class Reader(quantization.CalibrationDataReader):
        def __init__(self) -> None:
            self._left = iter(images)

        def get_next(self) -> dict[str, NDArray[Any]] | None:  # type: ignore[override]
            image = next(self._left, None)
            has_image = np.ones(1, dtype=np.float32)
            return None if image is None else {"network_input": image, "has_image": has_image}

    with tempfile.TemporaryDirectory() as folder, quiet_loggers(""):
        plain, prepared, done = (str(Path(folder, f"{k}.onnx")) for k in range(3))
        onnx.save(network, plain)
        quant_pre_process(plain, prepared, skip_symbolic_shape=True)
        nodes = onnx.load(prepared).graph.node
        last = max((row for row, node in enumerate(nodes) if node.op_type == "Conv"), default=-1)
        quantization.quantize_static(
            prepared,
            done,
            Reader(),
            quant_format=quantization.QuantFormat.QDQ,
            per_channel=True,
            activation_type=quantization.QuantType.QUInt8,
            weight_type=quantization.QuantType.QInt8,
            op_types_to_quantize=list(_OF_8_BITS),
            nodes_to_exclude=[node.name for node in nodes[last + 1 :]],
            # Ranges are means over the images of each one's extremes: one odd image would
            # widen those of the largest values and take resolution from all others.
            extra_options={"CalibMovingAverage": True},
        )
        return onnx.load(done)


def training_images(scene_folder: Path, preprocess: Preprocessor) -> Calibration:
    """Give the network's inputs of some training images, evenly spread.

    Raises:
        FileError: The scene cannot be read.
        FormatError: It has no training images.
    """
    scene = Scene.open(scene_folder)
    paths = []
    for id_ in scene.splits["train"]:
        names = scene.recording(id_).frames.image
        paths += [scene.recording_folder(id_) / IMAGES_FOLDER / name for name in names if name]
    if not paths:
        raise FormatError(scene_folder, "expected training images, found none")
    rows = np.unique(np.linspace(0, len(paths) - 1, CALIBRATION_IMAGES).astype(int))

    def load() -> list[NDArray[np.float32]]:
        with torch.no_grad():
            images = (torch.from_numpy(np.array(read_rgb(paths[row]))) for row in rows)
            return [preprocess(image).numpy() for image in images]

    return load
