"""Give an exported localizer another fusion step, without the network's checkpoint."""

from __future__ import annotations

import zlib
from typing import Any

import msgspec
import onnx

from vioapr.errors import ParameterError
from vioapr.export.describe import describe_fusion, describe_localizer
from vioapr.export.exporter import ExportedFile, trace_fusion
from vioapr.export.graph import FusionGraph
from vioapr.export.onnx_graph import finish, join, rename_input
from vioapr.fusion.types import Method
from vioapr.schemas.contract import METADATA_KEY, Contract, parse

_APR = "apr"
_APR_OUTPUTS = ("apr_world_from_cam", "apr_sigma_position_m", "apr_sigma_orientation_deg")


def replace_fusion(content: bytes, method: Method, params: Any) -> ExportedFile:
    """Replace the fusion step of a whole localizer.

    Args:
        content: Of the file.
        method: The new one.
        params: Of it.

    Raises:
        FormatError: The file has no contract.
        ParameterError: The file is not a whole localizer, or the method cannot be exported.
    """
    model = onnx.load_from_string(content)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    contract = parse(metadata.get(METADATA_KEY), "localizer")
    if contract.part != "localizer":
        raise ParameterError(f"expected a whole localizer, got the part {contract.part!r}")
    if not method.is_batched:
        raise ParameterError(f"method: {method.name!r} cannot run as a graph of fixed size")
    apr = _apr_of(model)
    # States of one regressor must not be fed to another.
    weights = b"".join(one.SerializeToString(deterministic=True) for one in apr.graph.initializer)
    digest = zlib.crc32(weights)
    identity = f"{contract.regressor.model} {contract.regressor.scenes} {digest}"
    graph = FusionGraph(method, params, identity).eval()
    fusion, names = trace_fusion(graph)
    rename_input(fusion, "has_apr", "has_image")
    fused = describe_fusion(graph, names, contract.regressor, contract.precision)
    whole = describe_localizer(_apr_contract(contract), fused)
    model = join({_APR: apr, "fusion": fusion}, whole.output_names)
    return ExportedFile(finish(model, whole), whole)


def _apr_of(model: onnx.ModelProto) -> onnx.ModelProto:
    """The part from images to predictions."""
    apr = onnx.ModelProto(ir_version=model.ir_version)
    apr.opset_import.extend(model.opset_import)
    apr.graph.name = "apr"
    apr.graph.node.extend(node for node in model.graph.node if not _is_fusion(node.name))
    used = {name for node in apr.graph.node for name in node.input}
    apr.graph.initializer.extend(one for one in model.graph.initializer if one.name in used)
    apr.graph.input.extend(value for value in model.graph.input if value.name in used)
    for tensor in apr.graph.initializer:
        tensor.name = _bare(tensor.name)
    for node in apr.graph.node:
        node.input[:] = map(_bare, node.input)
        node.output[:] = map(_bare, node.output)
    apr.graph.output.extend(v for v in model.graph.output if v.name in _APR_OUTPUTS)
    return apr


def _bare(name: str) -> str:
    """Without what an earlier replacement put in front: names must not grow with each."""
    while name.startswith(f"{_APR}/"):
        name = name.removeprefix(f"{_APR}/")
    return name


def _is_fusion(name: str) -> bool:
    return name.split("/")[0] == "fusion"


def _apr_contract(contract: Contract) -> Contract:
    outputs = tuple(spec for spec in contract.outputs if spec.name in _APR_OUTPUTS)
    inputs = tuple(spec for spec in contract.inputs if spec.name in ("image", "has_image"))
    return msgspec.structs.replace(contract, part="apr", inputs=inputs, outputs=outputs)
