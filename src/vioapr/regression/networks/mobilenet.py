"""MobileNetV3-Large (Howard et al., ICCV 2019), with torchvision's names of parameters."""

from __future__ import annotations

from functools import partial

from torch import Tensor, nn

from vioapr.regression.networks.blocks import (
    ConvNorm,
    InvertedResidual,
    SqueezeExcitation,
    initialize,
)

# Kernel, expanded channels, output channels, squeeze-and-excitation, hard swish, stride
# (table 1 of the paper).
_BLOCKS = (
    (3, 16, 16, False, False, 1),
    (3, 64, 24, False, False, 2),
    (3, 72, 24, False, False, 1),
    (5, 72, 40, True, False, 2),
    (5, 120, 40, True, False, 1),
    (5, 120, 40, True, False, 1),
    (3, 240, 80, False, True, 2),
    (3, 200, 80, False, True, 1),
    (3, 184, 80, False, True, 1),
    (3, 184, 80, False, True, 1),
    (3, 480, 112, True, True, 1),
    (3, 672, 112, True, True, 1),
    (5, 672, 160, True, True, 2),
    (5, 960, 160, True, True, 1),
    (5, 960, 160, True, True, 1),
)


class MobileNetV3Large(nn.Module):
    """Everything but the classifier."""

    CHANNELS = 960

    def __init__(self) -> None:
        """With random weights."""
        super().__init__()
        # torchvision's momentum of 0.01 needs thousands of steps before a network in evaluation
        # is the one that was trained; one place is learned in hundreds.
        norm = partial(nn.BatchNorm2d, eps=0.001, momentum=0.1)
        inputs = 16
        layers: list[nn.Module] = [
            ConvNorm(3, inputs, 3, 2, activation=nn.Hardswish, norm=norm),
        ]
        for kernel, expanded, outputs, squeezes, is_hard, stride in _BLOCKS:
            activation = nn.Hardswish if is_hard else nn.ReLU
            squeeze = squeeze_excitation if squeezes else None
            layers.append(
                InvertedResidual(
                    inputs, expanded, outputs, kernel, stride, activation, squeeze, norm
                )
            )
            inputs = outputs
        layers.append(ConvNorm(inputs, self.CHANNELS, 1, activation=nn.Hardswish, norm=norm))
        self.features = nn.Sequential(*layers)
        initialize(self)

    def forward(self, images: Tensor) -> Tensor:
        """Images (B, 3, H, W) to features (B, 960, H/32, W/32)."""
        return self.features(images)


def squeeze_excitation(channels: int) -> SqueezeExcitation:
    """Make MobileNetV3's: a quarter of the channels, rounded to a multiple of 8.

    At least 8, and not more than 10 % below the quarter.
    """
    squeezed = max(8, int(channels / 4 + 4) // 8 * 8)
    squeezed += 8 if squeezed < 0.9 * channels / 4 else 0
    return SqueezeExcitation(channels, squeezed, nn.ReLU, nn.Hardsigmoid)
