"""EfficientNet-B0 (Tan and Le, ICML 2019), with torchvision's names of parameters."""

from __future__ import annotations

from torch import Tensor, nn

from vioapr.regression.networks.blocks import (
    ConvNorm,
    InvertedResidual,
    SqueezeExcitation,
    initialize,
)

# Expansion, kernel, stride, output channels, blocks (table 1 of the paper).
STAGES = (
    (1, 3, 1, 16, 1),
    (6, 3, 2, 24, 2),
    (6, 5, 2, 40, 2),
    (6, 3, 2, 80, 3),
    (6, 5, 1, 112, 3),
    (6, 5, 2, 192, 4),
    (6, 3, 1, 320, 1),
)
"""Of B0, and of EfficientNet-Lite0."""
DROP_PROBABILITY = 0.2
"""Stochastic depth of the last block; growing linearly from 0 at the first."""


class EfficientNetB0(nn.Module):
    """Everything but the classifier."""

    CHANNELS = 1280
    FINE_CHANNELS, COARSE_CHANNELS = 40, 112
    """Of the maps that `forward_maps` gives."""

    _FINE_STAGE, _COARSE_STAGE = 3, 5

    def __init__(self) -> None:
        """With random weights."""
        super().__init__()
        inputs = 32
        layers: list[nn.Module] = [ConvNorm(3, inputs, 3, 2, activation=nn.SiLU)]
        total, done = sum(stage[-1] for stage in STAGES), 0
        for expansion, kernel, stride, outputs, count in STAGES:
            blocks: list[nn.Module] = []
            for number in range(count):
                drop = DROP_PROBABILITY * done / total
                first = stride if number == 0 else 1
                blocks.append(mb_conv(inputs, expansion, outputs, kernel, first, drop))
                inputs, done = outputs, done + 1
            layers.append(nn.Sequential(*blocks))
        layers.append(ConvNorm(inputs, self.CHANNELS, 1, activation=nn.SiLU))
        self.features = nn.Sequential(*layers)
        initialize(self)

    def forward(self, images: Tensor) -> Tensor:
        """Images (B, 3, H, W) to features (B, 1280, H/32, W/32)."""
        return self.features(images)

    def forward_maps(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Images (B, 3, H, W) to maps (B, 40, H/8, W/8) and (B, 112, H/16, W/16)."""
        fine = self.features[: self._FINE_STAGE + 1](images)
        return fine, self.features[self._FINE_STAGE + 1 : self._COARSE_STAGE + 1](fine)

    def freeze_unmapped(self) -> None:
        """Take the stages that `forward_maps` does not use out of training."""
        for parameter in self.features[self._COARSE_STAGE + 1 :].parameters():
            parameter.requires_grad_(False)


def mb_conv(
    inputs: int, expansion: int, outputs: int, kernel: int, stride: int, drop: float
) -> InvertedResidual:
    """Make EfficientNet's block: squeezed to a quarter of the inputs, dropped by chance."""

    def squeeze(channels: int) -> nn.Module:
        return SqueezeExcitation(channels, max(1, inputs // 4), nn.SiLU, nn.Sigmoid)

    expanded = inputs * expansion
    return InvertedResidual(
        inputs, expanded, outputs, kernel, stride, nn.SiLU, squeeze, drop_probability=drop
    )
