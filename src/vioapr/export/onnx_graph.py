"""ONNX graphs that every runtime can run: trace modules, join graphs, check their operators."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import onnx
import torch
from torch import Tensor, nn

from vioapr.errors import VioAprError
from vioapr.export.operators import find_forbidden
from vioapr.export.simplify import simplify
from vioapr.export.translations import TRANSLATIONS
from vioapr.schemas.contract import METADATA_KEY, Contract

OPSET = 18


def trace(
    module: nn.Module,
    inputs: Mapping[str, Tensor],
    outputs: Sequence[str],
    free_sizes: Mapping[str, Mapping[int, str]] | None = None,
) -> onnx.ModelProto:
    """Export a module.

    Args:
        module: In evaluation mode.
        inputs: An example of every input, by name and in order.
        outputs: Names.
        free_sizes: By input, axes of any size and their names.

    Raises:
        VioAprError: It uses a function that ONNX does not have.
    """
    dims = {
        name: {axis: torch.export.Dim(size) for axis, size in axes.items()}
        for name, axes in (free_sizes or {}).items()
    }
    with warnings.catch_warnings(), quiet_loggers("torch.onnx", "onnxscript", "onnx_ir"):
        warnings.simplefilter("ignore")  # about PyTorch's own insides
        try:
            program = torch.onnx.export(
                module,
                tuple(inputs.values()),
                dynamo=True,
                opset_version=OPSET,
                input_names=list(inputs),
                output_names=list(outputs),
                dynamic_shapes=tuple(dims.get(name) for name in inputs),
                custom_translation_table=TRANSLATIONS,
                optimize=False,
                verbose=False,
            )
        except torch.onnx.errors.OnnxExporterError as error:
            reason = str(error.__cause__ or error).strip().splitlines()[0]
            raise VioAprError(f"this model cannot be exported to ONNX: {reason}") from error
        assert program is not None
        simplify(program.model)
    model = program.model_proto
    # Words on where in the source a node came from are most of a small graph's bytes.
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""
    for value in (*model.graph.input, *model.graph.output, *model.graph.initializer):
        del value.metadata_props[:]
    del model.graph.metadata_props[:], model.graph.value_info[:], model.metadata_props[:]
    return model


@contextmanager
def quiet_loggers(*names: str) -> Iterator[None]:
    """Keep warnings of other packages away, which say nothing to the user."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def join(parts: Mapping[str, onnx.ModelProto], outputs: Sequence[str]) -> onnx.ModelProto:
    """Join models into one: the output of one is the input of the same name of later ones.

    Args:
        parts: In order of execution; their names become prefixes of nodes and inner tensors.
        outputs: Names of the outputs of the whole, in order.
    """
    first = next(iter(parts.values()))
    whole = onnx.ModelProto(ir_version=first.ir_version, producer_name="vioapr")
    whole.graph.name = "localizer"
    whole.opset_import.extend(first.opset_import)
    inputs: dict[str, onnx.ValueInfoProto] = {}
    made: dict[str, onnx.ValueInfoProto] = {}
    for prefix, part in parts.items():
        graph = onnx.GraphProto()
        graph.CopyFrom(part.graph)
        outer = {value.name for value in (*graph.input, *graph.output)} | {""}

        def rename(name: str, outer: set[str] = outer, prefix: str = prefix) -> str:
            return name if name in outer else f"{prefix}/{name}"

        for index, node in enumerate(graph.node):
            node.name = f"{prefix}/{node.op_type}_{index}"
            node.input[:] = [rename(name) for name in node.input]
            node.output[:] = [rename(name) for name in node.output]
        for tensor in graph.initializer:
            tensor.name = rename(tensor.name)
        for value in graph.input:
            if value.name not in made:
                inputs.setdefault(value.name, value)
        made.update({value.name: value for value in graph.output})
        whole.graph.node.extend(graph.node)
        whole.graph.initializer.extend(graph.initializer)
    whole.graph.input.extend(inputs.values())
    whole.graph.output.extend(made[name] for name in outputs)
    return whole


def rename_input(model: onnx.ModelProto, old: str, new: str) -> None:
    """Rename an input of a model, in place."""
    for value in model.graph.input:
        if value.name == old:
            value.name = new
    for node in model.graph.node:
        node.input[:] = [new if name == old else name for name in node.input]


def finish(model: onnx.ModelProto, contract: Contract) -> bytes:
    """Put in the contract, check the model, and serialize it.

    Raises:
        VioAprError: The network uses an operator that not all runtimes have.
    """
    del model.metadata_props[:]
    model.metadata_props.add(key=METADATA_KEY, value=contract.to_json())
    used = (node.op_type for node in model.graph.node)
    if forbidden := find_forbidden(used, is_quantized=contract.precision == "int8-qdq"):
        raise VioAprError(
            f"the graph uses operators that not every runtime has: {', '.join(forbidden)} "
            "(vioapr.export.operators lists those that may be used)"
        )
    assert [i.name for i in model.graph.input] == [spec.name for spec in contract.inputs]
    assert [o.name for o in model.graph.output] == list(contract.output_names)
    onnx.checker.check_model(model)
    return model.SerializeToString()
