"""Export a trained regressor and a fusion method to the files that phones run."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import onnx
import torch
from msgspec import UNSET
from torch import Tensor, nn

from vioapr.errors import ParameterError
from vioapr.export.describe import (
    describe_apr,
    describe_carry,
    describe_fusion,
    describe_localizer,
)
from vioapr.export.graph import AprPose, CarryGraph, FusionGraph, LocalizerGraph, NetworkGraph
from vioapr.export.onnx_graph import finish, join, rename_input, trace
from vioapr.export.preprocess import Preprocessor
from vioapr.fusion.types import Method
from vioapr.schemas.contract import Contract, Regressor

_NETWORK_INPUT = "network_input"
_EXAMPLE = (480, 640, 3)


class Spec(Protocol):
    """The properties of a regressor that its file states (`vioapr.regression.spec`)."""

    @property
    def model(self) -> str:
        """The network's name."""
        ...

    @property
    def resize(self) -> int:
        """Side of the square that images are resized to, pixels."""
        ...

    @property
    def crop(self) -> int:
        """Side of the square that is cut out of its middle."""
        ...

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of the scenes that it knows."""
        ...


@dataclass(frozen=True)
class ExportedFile:
    """A file's content and its contract."""

    content: bytes
    contract: Contract


class Exporter:
    """One regressor with one fusion method, in any precision, whole or split."""

    def __init__(self, network: nn.Module, spec: Spec, method: Method, params: Any) -> None:
        """Build the modules.

        Args:
            network: See `NetworkGraph`.
            spec: Of the network.
            method: Of fusion.
            params: Of the method.

        Raises:
            ParameterError: The method cannot be exported.
        """
        if not method.is_batched:
            raise ParameterError(
                "method: expected one that runs as a graph of fixed size, such as chain or "
                f"vio-apr, got {method.name!r}"
            )
        # States of one regressor must not be fed to another.
        identity = f"{spec.model} {spec.scenes} {digest_weights(network)}"
        self.spec = spec
        self.preprocess = Preprocessor(spec.resize, spec.crop)
        self.network = NetworkGraph(network).eval()
        self.fusion = FusionGraph(method, params, identity).eval()

    @property
    def eager(self) -> LocalizerGraph:
        """The same computation in PyTorch."""
        return LocalizerGraph(self.preprocess, self.network, self.fusion)

    def export(
        self, precision: str = "fp32", calibration: Callable[[], list[Any]] | None = None
    ) -> ExportedFile:
        """Export the whole localizer as one file.

        Args:
            precision: See `change_precision`.
            calibration: Gives network inputs, see `change_precision`.
        """
        network = self._network(precision, calibration)
        fusion = onnx.ModelProto()
        fusion.CopyFrom(self._traced_fusion)
        rename_input(fusion, "has_apr", "has_image")
        contract = describe_localizer(*self._contracts(precision))
        parts = {"preprocess": self._traced_preprocess, "network": network, "fusion": fusion}
        return _file(parts, contract)

    def export_split(
        self, precision: str = "fp32", calibration: Callable[[], list[Any]] | None = None
    ) -> tuple[ExportedFile, ExportedFile, ExportedFile]:
        """Export regressor, fusion, and fusion of frames without prediction, as three files.

        Args:
            precision: See `change_precision`.
            calibration: Gives network inputs, see `change_precision`.
        """
        return (
            self.export_apr(precision, calibration),
            self.export_fusion(precision),
            self.export_carry(precision),
        )

    def export_apr(
        self, precision: str = "fp32", calibration: Callable[[], list[Any]] | None = None
    ) -> ExportedFile:
        """Export the regressor alone; see `export_split`."""
        parts = {
            "preprocess": self._traced_preprocess,
            "network": self._network(precision, calibration),
        }
        return _file(parts, describe_apr(self.preprocess, self._regressor, precision))

    def export_fusion(self, precision: str = "fp32") -> ExportedFile:
        """Export fusion alone, for a regressor of a precision."""
        return _file({"fusion": self._traced_fusion}, self._contracts(precision)[1])

    def export_carry(self, precision: str = "fp32") -> ExportedFile:
        """Export fusion of frames without prediction alone."""
        contract = describe_carry(self._contracts(precision)[1])
        return _file({"carry": self._traced_carry}, contract)

    @property
    def _regressor(self) -> Regressor:
        camera = getattr(getattr(self.spec, "points", None), "camera", UNSET)
        return Regressor(self.spec.model, self.spec.scenes, camera)

    def _contracts(self, precision: str) -> tuple[Contract, Contract]:
        return (
            describe_apr(self.preprocess, self._regressor, precision),
            describe_fusion(self.fusion, self._fused_names, self._regressor, precision),
        )

    @cached_property
    def _traced_preprocess(self) -> onnx.ModelProto:
        example = {"image": torch.zeros(_EXAMPLE, dtype=torch.uint8)}
        sizes = {"image": {0: "height", 1: "width"}}
        return trace(self.preprocess, example, [_NETWORK_INPUT], sizes)

    @cached_property
    def _traced_network(self) -> onnx.ModelProto:
        crop = self.preprocess.crop
        example = {_NETWORK_INPUT: torch.zeros(1, 3, crop, crop), "has_image": torch.ones(1)}
        return trace(self.network, example, AprPose._fields)

    def _network(
        self, precision: str, calibration: Callable[[], list[Any]] | None
    ) -> onnx.ModelProto:
        if precision == "fp32":
            return self._traced_network
        from vioapr.export.quantize import change_precision

        return change_precision(self._traced_network, precision, calibration)

    @cached_property
    def _fusion_and_names(self) -> tuple[onnx.ModelProto, tuple[str, ...]]:
        return trace_fusion(self.fusion)

    @property
    def _traced_fusion(self) -> onnx.ModelProto:
        return self._fusion_and_names[0]

    @cached_property
    def _traced_carry(self) -> onnx.ModelProto:
        return trace_carry(self.fusion, describe_carry(self._contracts("fp32")[1]))

    @property
    def _fused_names(self) -> tuple[str, ...]:
        return self._fusion_and_names[1]


def _file(parts: dict[str, onnx.ModelProto], contract: Contract) -> ExportedFile:
    return ExportedFile(finish(join(parts, contract.output_names), contract), contract)


def trace_fusion(fusion: FusionGraph) -> tuple[onnx.ModelProto, tuple[str, ...]]:
    """A fusion step as a graph of its own, and the names of its outputs in order."""
    with torch.no_grad():
        names = tuple(fusion(*example_inputs(fusion).values()))
    return trace(fusion, example_inputs(fusion), names), names


def trace_carry(fusion: FusionGraph, contract: Contract) -> onnx.ModelProto:
    """The step of frames without prediction, as a graph of its own with a contract's inputs."""
    example = example_inputs(fusion)
    inputs = {spec.name: example[spec.name] for spec in contract.inputs}
    return trace(CarryGraph(fusion).eval(), inputs, contract.output_names)


def example_inputs(fusion: FusionGraph) -> dict[str, Tensor]:
    """A frame for a fusion step."""
    identity = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    inputs = {
        "apr_world_from_cam": identity,
        "apr_sigma_position_m": torch.ones(1),
        "apr_sigma_orientation_deg": torch.ones(1),
        "has_apr": torch.ones(1),
        "vio_from_cam": identity.clone(),
        "timestamp_s": torch.ones(1),
        "tracking_ok": torch.ones(1),
        "tracking_reset": torch.zeros(1),
        "image_timestamp_s": torch.ones(1),
        "image_vio_from_cam": identity.clone(),
        "state": torch.zeros(fusion.layout.size),
    }
    if fusion.param_names:
        values = [float(getattr(fusion.params, name)) for name in fusion.param_names]
        inputs["params"] = torch.tensor(values)
    return inputs


def digest_weights(network: nn.Module) -> int:
    """The CRC-32 of all weights and buffers, in order."""
    digest = 0
    for tensor in network.state_dict().values():
        digest = zlib.crc32(tensor.detach().cpu().contiguous().numpy().tobytes(), digest)
    return digest
