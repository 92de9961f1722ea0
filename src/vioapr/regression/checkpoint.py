"""Regressors on disk: safetensors with a JSON header in one file.

The one file is either old or new, never half of each; a copy of the header lies beside it.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from vioapr.errors import (
    DiskFullError,
    FileMissingError,
    FormatError,
    ParameterError,
    UnwritableError,
)
from vioapr.files.atomic import replacing, write_atomically
from vioapr.regression.model_card import card_of, model_card
from vioapr.regression.networks import PoseNetwork, build
from vioapr.regression.networks.efficientnet_lite import EfficientNetLite0
from vioapr.schemas.base import Document, DocumentType, decode, encode
from vioapr.schemas.regressor import (
    REGRESSOR_FILE,
    RegressorHeader,
    RegressorSpec,
    Trained,
    note_of,
)

_HEADER = "vioapr"
"""The header's name in the metadata."""


@dataclass(frozen=True, eq=False)
class LoadedRegressor:
    """A trained network, ready to predict.

    Attributes:
        network: In evaluation mode, on the CPU.
        spec: The network's specification.
        trained: Where its weights come from, for people.
    """

    network: PoseNetwork
    spec: RegressorSpec
    trained: Trained


def save_regressor(
    path: Path, network: PoseNetwork, spec: RegressorSpec, trained: Trained | None = None
) -> None:
    """Write a regressor, whole or not at all, and its model card beside it.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    header = RegressorHeader(spec=spec, trained=trained or Trained())
    save_tensors(path, dict(network.state_dict()), header)
    write_atomically(card_of(path), model_card(spec, header.trained).encode())


def load(path: Path) -> LoadedRegressor:
    """Read a regressor from its file, or from the folder that training left it in.

    Raises:
        FileMissingError: There is none.
        FormatError: It is broken, half-written or something else.
        VersionError: A newer vioapr wrote it.
    """
    path = Path(path)
    path = path / REGRESSOR_FILE if path.is_dir() else path
    try:
        tensors, header = load_tensors(path, RegressorHeader)
        network = build(header.spec)
    except ParameterError as error:
        raise FormatError(path, f"expected a regressor's specification: {error}") from None
    problem = describe_differences(network.state_dict(), tensors)
    if problem:
        raise FormatError(path, f"expected the weights of another network: {problem}")
    network.load_state_dict(tensors)
    return LoadedRegressor(network.eval(), header.spec, header.trained)


def save_tensors(path: Path, tensors: dict[str, Tensor], header: Document) -> None:
    """Write tensors and their header, and the header's copy beside them.

    Args:
        path: The file, ending in .safetensors.
        tensors: By name.
        header: Says what they are.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    owned = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    try:
        with replacing(path) as partial:
            save_file(owned, partial, metadata={_HEADER: encode(header, indent=None)})
    except SafetensorError as error:  # of the system, as the library reports it
        is_full = f"os error {errno.ENOSPC}" in str(error)
        kind = DiskFullError if is_full else UnwritableError
        raise kind(path, f"cannot be written: {error}") from None
    write_atomically(note_of(path), encode(header, indent=1).encode())


def load_tensors(path: Path, kind: type[DocumentType]) -> tuple[dict[str, Tensor], DocumentType]:
    """Read a file of `save_tensors`.

    Args:
        path: The file.
        kind: The header that is expected.

    Raises:
        FileMissingError: There is none.
        FormatError: It is broken, half-written or of another kind.
        VersionError: A newer vioapr wrote it.
    """
    if not path.is_file():
        raise FileMissingError(path, f"expected a {kind.FORMAT}, found no file of this name")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(_HEADER)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, ValueError, RuntimeError) as error:
        problem = f"expected a {kind.FORMAT}; broken or half-written: {error}"
        raise FormatError(path, problem) from None
    if text is None:
        raise FormatError(path, f"expected a {kind.FORMAT}, got other safetensors")
    return tensors, decode(path, text, kind)


def describe_differences(own: dict[str, Tensor], given: dict[str, Tensor]) -> str | None:
    """Say how names and shapes of a network's tensors differ from those given, or None."""
    missing, unknown = sorted(own.keys() - given.keys()), sorted(given.keys() - own.keys())
    wrong = [
        f"{name} {tuple(given[name].shape)} instead of {tuple(own[name].shape)}"
        for name in sorted(own.keys() & given.keys())
        if own[name].shape != given[name].shape
    ]
    parts = [
        f"{len(names)} {what} ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"
        for what, names in (("missing", missing), ("unknown", unknown), ("of another shape", wrong))
        if names
    ]
    return "; ".join(parts) or None


def load_backbone_weights(network: PoseNetwork, path: Path) -> None:
    """Set a network's backbone to pretrained weights, e.g. torchvision's of ImageNet.

    Args:
        network: Its backbone's weights are replaced.
        path: A `.safetensors` file, or a `.pth` file with a state_dict. A classifier in it
            (`fc.*`, `classifier.*`) is left out. Of EfficientNet-Lite0, names may be those of
            the published file.

    Raises:
        FileMissingError: There is no such file.
        FormatError: It is broken, or of another network; says which names differ.
    """
    backbone: torch.nn.Module = network.backbone  # type: ignore[assignment]
    given = {
        name.removeprefix("module."): value
        for name, value in read_state_dict(path).items()
        if not name.removeprefix("module.").startswith(("fc.", "classifier."))
    }
    if isinstance(backbone, EfficientNetLite0):
        given = backbone.select(given)
    own = backbone.state_dict()
    # Before PyTorch 0.4.1 batches were not counted.
    counters = {name for name in own if name.endswith("num_batches_tracked")}
    given = {name: own[name] for name in counters} | given
    problem = describe_differences(own, given)
    if problem:
        raise FormatError(path, f"expected weights of {type(backbone).__name__}: {problem}")
    backbone.load_state_dict(given)


def read_state_dict(path: Path) -> dict[str, Tensor]:
    """Read tensors by name: `.safetensors`, or PyTorch's own format, without running its code.

    Raises:
        FileMissingError: There is no such file.
        FormatError: It is broken, or holds something else.
    """
    if not path.is_file():
        raise FileMissingError(path, "expected weights, found no file of this name")
    try:
        if path.suffix == ".safetensors":
            with safe_open(path, framework="pt") as file:
                return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch.load raises whatever unpickling runs into
        raise FormatError(
            path, f"expected weights as .safetensors or a state_dict; broken, or cut off: {error}"
        ) from None
    content = content.get("state_dict", content) if isinstance(content, dict) else content
    is_state = isinstance(content, dict) and all(isinstance(v, Tensor) for v in content.values())
    if not is_state:
        raise FormatError(path, "expected a state_dict: names and tensors")
    return content
