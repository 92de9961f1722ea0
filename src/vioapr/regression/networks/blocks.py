"""Building blocks of the backbones, with torchvision's names of parameters.

Shapes: B batch, C channels, H height, W width.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor, nn

Activation = Callable[..., nn.Module]
Norm = Callable[[int], nn.Module]


class ConvNorm(nn.Sequential):
    """Convolution, batch normalization and, if asked for, an activation; BCHW to BCHW."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        kernel: int,
        stride: int = 1,
        groups: int = 1,
        activation: Activation | None = None,
        norm: Norm = nn.BatchNorm2d,
        convolution: type[nn.Conv2d] = nn.Conv2d,
    ) -> None:
        """Padding keeps the size, up to the stride."""
        padding = (kernel - 1) // 2
        first = convolution(inputs, outputs, kernel, stride, padding, groups=groups, bias=False)
        layers: list[nn.Module] = [first, norm(outputs)]
        if activation is not None:
            layers.append(activation(inplace=True))
        super().__init__(*layers)


class SqueezeExcitation(nn.Module):
    """Channels weighted by what the whole image shows (Hu et al., CVPR 2018)."""

    def __init__(
        self, channels: int, squeezed: int, activation: Activation, gate: Callable[[], nn.Module]
    ) -> None:
        """Of a number of channels, squeezed to `squeezed` ones."""
        super().__init__()
        self.fc1 = nn.Conv2d(channels, squeezed, 1)
        self.fc2 = nn.Conv2d(squeezed, channels, 1)
        self.activation = activation()
        self.gate = gate()

    def forward(self, features: Tensor) -> Tensor:
        """BCHW to BCHW."""
        # A mean over both axes: exports as one ReduceMean, where AdaptiveAvgPool2d does not.
        pooled = features.mean(dim=(2, 3), keepdim=True)
        return features * self.gate(self.fc2(self.activation(self.fc1(pooled))))


class StochasticDepth(nn.Module):
    """Leaves a residual branch out for whole images while training (Huang et al., ECCV 2016)."""

    def __init__(self, probability: float) -> None:
        """With this probability."""
        super().__init__()
        self.probability = probability

    def forward(self, branch: Tensor) -> Tensor:
        """BCHW to BCHW."""
        if not self.training or self.probability == 0:
            return branch
        kept = 1 - self.probability
        shape = (len(branch), 1, 1, 1)
        mask = torch.empty(shape, dtype=branch.dtype, device=branch.device).bernoulli_(kept)
        return branch * mask / kept


class InvertedResidual(nn.Module):
    """Expand, filter each channel, weigh the channels, project (MobileNetV2 and later)."""

    def __init__(
        self,
        inputs: int,
        expanded: int,
        outputs: int,
        kernel: int,
        stride: int,
        activation: Activation,
        squeeze: Callable[[int], nn.Module] | None,
        norm: Norm = nn.BatchNorm2d,
        drop_probability: float = 0.0,
        convolution: type[nn.Conv2d] = nn.Conv2d,
    ) -> None:
        """With a residual connection where the shape stays."""
        super().__init__()
        conv = partial(ConvNorm, norm=norm, convolution=convolution)
        layers: list[nn.Module] = []
        if expanded != inputs:
            layers.append(conv(inputs, expanded, 1, activation=activation))
        layers.append(conv(expanded, expanded, kernel, stride, expanded, activation))
        if squeeze is not None:
            layers.append(squeeze(expanded))
        projection = conv(expanded, outputs, 1)
        layers.append(projection)
        self.block = nn.Sequential(*layers)
        self.stochastic_depth = StochasticDepth(drop_probability)
        self.is_residual = stride == 1 and inputs == outputs
        if self.is_residual:
            # The block passes its input on at first (Goyal et al., 2017, section 5.1): training
            # from random weights is much faster with it (docs/results/regressors.md).
            nn.init.zeros_(projection.get_parameter("1.weight"))

    def forward(self, features: Tensor) -> Tensor:
        """BCHW to BCHW."""
        branch = self.block(features)
        return features + self.stochastic_depth(branch) if self.is_residual else branch


def initialize(network: nn.Module) -> None:
    """He's initialization for training from scratch."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, mode="fan_out")
            if module.bias is not None:
                nn.init.zeros_(module.bias)
