"""Regressors and states of training on disk: safetensors with a JSON header in one file.

One file, written under another name and moved when whole, is either old or new, never half of
each; a copy of the header lies beside it for people.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from vioapr.errors import FileMissingError, FormatError, ParameterError, UnwritableError
from vioapr.regression.files import REGRESSOR_FILE, note_of
from vioapr.regression.networks import PoseNetwork, build
from vioapr.regression.spec import RegressorSpec

_FORMATS = {"regressor": "vioapr regressor", "state": "vioapr training state"}
_VERSION = 1
_HEADER = "vioapr"


@dataclass(frozen=True, eq=False)
class LoadedRegressor:
    """A trained network, ready to predict.

    Attributes:
        network: In evaluation mode, on the CPU.
        spec: What it is, and what it must be fed with.
        trained: How it was trained, and what came out, for people.
    """

    network: PoseNetwork
    spec: RegressorSpec
    trained: dict[str, Any]


def save_regressor(
    path: Path, network: PoseNetwork, spec: RegressorSpec, trained: dict[str, Any]
) -> None:
    """Write a regressor, whole or not at all.

    Raises:
        FormatError: It cannot be written; what was there stays.
    """
    content = {"spec": spec.to_json(), "trained": trained}
    save_tensors(path, "regressor", dict(network.state_dict()), content)


def load(path: Path) -> LoadedRegressor:
    """A regressor from its file, or from the folder that training left it in.

    Raises:
        FormatError: It is missing, broken, half-written or something else.
    """
    path = Path(path)
    path = path / REGRESSOR_FILE if path.is_dir() else path
    tensors, content = load_tensors(path, "regressor")
    try:
        spec = RegressorSpec.from_json(content["spec"])
        network = build(spec)
    except (KeyError, ParameterError) as error:
        raise FormatError(path, f"expected a regressor's specification: {error}") from None
    load_into(network, tensors, path)
    return LoadedRegressor(network.eval(), spec, content.get("trained", {}))


def load_into(network: PoseNetwork, tensors: dict[str, Tensor], path: Path) -> None:
    """Set a network's weights, all of them.

    Raises:
        FormatError: Names or shapes differ; says which.
    """
    own = network.state_dict()
    problem = describe_differences(own, tensors)
    if problem:
        raise FormatError(path, f"expected the weights of another network: {problem}")
    network.load_state_dict(tensors)


def describe_differences(own: dict[str, Tensor], given: dict[str, Tensor]) -> str | None:
    """How names and shapes differ, or None."""
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


def save_tensors(
    path: Path, kind: str, tensors: dict[str, Tensor], content: dict[str, Any]
) -> None:
    """Write tensors and plain values.

    Args:
        path: The file, ending in .safetensors.
        kind: "regressor" or "state".
        tensors: By name.
        content: Anything that JSON can say.

    Raises:
        FormatError: It cannot be written; what was there stays.
    """
    header = {"format": _FORMATS[kind], "version": _VERSION, **content}
    owned = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    partial = path.with_name(f".{path.name}.partial")
    note = note_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_file(owned, partial, metadata={_HEADER: json.dumps(header)})
        partial.replace(path)
        note_partial = note.with_name(f".{note.name}.partial")
        note_partial.write_text(json.dumps(header, indent=1) + "\n")
        note_partial.replace(note)
    except (OSError, SafetensorError) as error:
        if isinstance(error, OSError):
            raise UnwritableError.of(path, error) from None
        raise UnwritableError(path, f"cannot be written: {error}") from None
    finally:
        partial.unlink(missing_ok=True)


def load_tensors(path: Path, kind: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Inverse of `save_tensors`.

    Raises:
        FormatError: It is missing, broken or of another kind.
    """
    expected = _FORMATS[kind]
    if not path.is_file():
        raise FileMissingError(path, f"expected a {expected}, found no file of this name")
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {})[_HEADER])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except KeyError:
        raise FormatError(path, f"expected a {expected}, got other safetensors") from None
    except (OSError, SafetensorError, ValueError, RuntimeError) as error:
        problem = f"expected a {expected}; broken or half-written: {error}"
        raise FormatError(path, problem) from None
    if header.get("format") != expected:
        raise FormatError(path, f"expected a {expected}, got a {header.get('format')}")
    if header.get("version") != _VERSION:
        found = header.get("version")
        raise FormatError(path, f"expected version {_VERSION}, got {found}: a newer vioapr's?")
    return tensors, header


def load_backbone_weights(network: PoseNetwork, path: Path) -> None:
    """Pretrained weights of the backbone, e.g. torchvision's of ImageNet, from a local file.

    Args:
        network: Its backbone's weights are replaced.
        path: A `.safetensors` file, or a `.pth` file with a state_dict. A classifier in it
            (`fc.*`, `classifier.*`) is left out.

    Raises:
        FormatError: It is missing or broken, or of another network; says which names differ.
    """
    backbone: torch.nn.Module = network.backbone  # type: ignore[assignment]
    given = {
        name.removeprefix("module."): value
        for name, value in _read_weights(path).items()
        if not name.removeprefix("module.").startswith(("fc.", "classifier."))
    }
    own = backbone.state_dict()
    counters = {name for name in own if name.endswith("num_batches_tracked")}
    given = {name: own[name] for name in counters} | given
    problem = describe_differences(own, given)
    if problem:
        raise FormatError(path, f"expected weights of {type(backbone).__name__}: {problem}")
    backbone.load_state_dict(given)


def _read_weights(path: Path) -> dict[str, Tensor]:
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
