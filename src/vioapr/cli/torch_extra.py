"""Verbs that need PyTorch say so, instead of failing on an import."""

from __future__ import annotations

from importlib.util import find_spec

from vioapr.errors import MissingExtraError

_PACKAGES = {"torch": "torch", "safetensors": "safetensors", "lightning_fabric": "lightning-fabric"}


def require_torch(feature: str) -> None:
    """Check that the packages of the extra `train` are there.

    Raises:
        MissingExtraError: One is not.
    """
    for module, package in _PACKAGES.items():
        if find_spec(module) is None:
            raise MissingExtraError(feature, package, "train")
