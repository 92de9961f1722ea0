"""PoseNet: a backbone, its mean over the image, one hidden layer, and the heads.

As in geomapnet (Brahmbhatt et al., CVPR 2018), which the paper follows (section Implementation),
but with a dropout that is off at test time; there it stayed on.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor, nn

from vioapr.regression.networks.base import Heads, PoseNetwork, Raw
from vioapr.regression.networks.rotation import RotationCode


class PoseNet(PoseNetwork):
    """One scene, one image, one pose."""

    def __init__(
        self,
        backbone: nn.Module,
        channels: int,
        hidden: int,
        activation: Callable[[], nn.Module],
        dropout: float,
        code: RotationCode,
    ) -> None:
        """From a backbone's feature maps of a number of channels."""
        super().__init__(code)
        self.backbone = backbone
        self.hidden = nn.Linear(channels, hidden)
        self.activation = activation()
        self.dropout = nn.Dropout(dropout)
        self.heads = Heads(hidden, code)
        nn.init.kaiming_normal_(self.hidden.weight)
        nn.init.zeros_(self.hidden.bias)

    def position_modules(self) -> tuple[nn.Module, ...]:
        """One layer each."""
        return self.heads.position, self.heads.log_sigma

    def forward_raw(self, images: Tensor, scene: Tensor | None = None) -> Raw:
        """Images (B, 3, H, W); there is one scene."""
        pooled = self.backbone(images).mean(dim=(2, 3))
        features = self.activation(self.hidden(pooled))
        return self.heads(features, self.dropout(features))
