"""EfficientNet-Lite0: EfficientNet-B0 made for phones, and its ImageNet weights.

As Google published it (TPU repository, `efficientnet/lite`): ReLU6 instead of swish and no
squeeze-and-excitation, so that 8 bits lose little. Weights come from TensorFlow, and with them its
padding, its epsilon of the norms, and its scale of pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

from vioapr.regression.networks.blocks import ConvNorm, InvertedResidual, initialize
from vioapr.regression.networks.efficientnet import DROP_PROBABILITY, STAGES
from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD

_MEAN_LEVEL, _LEVELS = 127.0, 128.0
"""The pixels that its weights were trained on: (grey level - 127) / 128."""


class SameConv2d(nn.Conv2d):
    """A convolution that pads as TensorFlow's SAME does.

    The output has a pixel for every started step of the stride; where the padding is odd, there is
    more of it on the right and below. Padding on both sides alike would move the picture by half a
    pixel at every stride.
    """

    def forward(self, input: Tensor) -> Tensor:
        """BCHW to BCHW."""
        height, width = (
            max((-(-size // step) - 1) * step + kernel - size, 0)
            for size, step, kernel in zip(
                input.shape[2:], self.stride, self.kernel_size, strict=True
            )
        )
        sides = (width // 2, width - width // 2, height // 2, height - height // 2)
        padded = functional.pad(input, sides) if any(sides) else input
        return functional.conv2d(padded, self.weight, None, self.stride, groups=self.groups)


class EfficientNetLite0(nn.Module):
    """Everything but the classifier, or the first stages alone."""

    CHANNELS = 1280
    FINE_CHANNELS, COARSE_CHANNELS = 40, 112
    """Of the maps that `forward_maps` gives."""

    _FINE_STAGE, _COARSE_STAGE = 3, 5

    scale: Tensor
    shift: Tensor

    def __init__(self, *, has_maps_alone: bool = False) -> None:
        """With random weights.

        Args:
            has_maps_alone: Without the stages that `forward_maps` does not need, which hold three
                quarters of the weights.
        """
        super().__init__()
        norm = partial(nn.BatchNorm2d, eps=0.001)
        conv = partial(ConvNorm, activation=nn.ReLU6, norm=norm, convolution=SameConv2d)
        inputs = 32
        layers: list[nn.Module] = [conv(3, inputs, 3, 2)]
        total, done = sum(stage[-1] for stage in STAGES), 0
        for expansion, kernel, stride, outputs, count in STAGES:
            blocks: list[nn.Module] = []
            for number in range(count):
                blocks.append(
                    InvertedResidual(
                        inputs, inputs * expansion, outputs, kernel, stride if number == 0 else 1,
                        nn.ReLU6, None, norm, DROP_PROBABILITY * done / total, SameConv2d,
                    )
                )  # fmt: skip
                inputs, done = outputs, done + 1
            layers.append(nn.Sequential(*blocks))
        layers.append(conv(inputs, self.CHANNELS, 1))
        self.features = nn.Sequential(
            *(layers[: self._COARSE_STAGE + 1] if has_maps_alone else layers)
        )
        initialize(self)
        # From images as our networks take them to those that the weights know.
        mean, std = (torch.tensor(v)[:, None, None] for v in (IMAGE_MEAN, IMAGE_STD))
        self.register_buffer("scale", 255 * std / _LEVELS, persistent=False)
        self.register_buffer("shift", (255 * mean - _MEAN_LEVEL) / _LEVELS, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Images (B, 3, H, W) to features (B, 1280, H/32, W/32)."""
        return self.features(images * self.scale + self.shift)

    def select(self, weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Choose its own of the weights of the whole network, as published or as it names them."""
        stages = [f"features.{number}." for number in range(len(self.features), len(STAGES) + 2)]
        named = rename_published(weights)
        return {name: v for name, v in named.items() if not name.startswith(tuple(stages))}

    def forward_maps(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Images (B, 3, H, W) to maps (B, 40, H/8, W/8) and (B, 112, H/16, W/16)."""
        scaled = images * self.scale + self.shift
        fine = self.features[: self._FINE_STAGE + 1](scaled)
        return fine, self.features[self._FINE_STAGE + 1 : self._COARSE_STAGE + 1](fine)


def rename_published(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Give the published weights the names of `EfficientNetLite0`; other names stay as they are.

    The published names count blocks through all stages: `_blocks.4._bn1.bias`. The classifier
    (`_fc.*`) is left out.
    """
    if "_conv_stem.weight" not in weights:
        return dict(weights)
    new_of_old = dict(_names_of_layers())
    renamed = {}
    for name, value in weights.items():
        layer, _, parameter = name.rpartition(".")
        if layer != "_fc":
            renamed[f"{new_of_old.get(layer, layer)}.{parameter}"] = value
    return renamed


def _names_of_layers() -> Iterator[tuple[str, str]]:
    """The published name of every layer, and ours."""
    yield from (("_conv_stem", "features.0.0"), ("_bn0", "features.0.1"))
    number = 0
    for stage, (expansion, *_, count) in enumerate(STAGES, start=1):
        for block in range(count):
            parts = ["_expand_conv", "_bn0", "_depthwise_conv", "_bn1", "_project_conv", "_bn2"]
            for row, part in enumerate(parts[2 if expansion == 1 else 0 :]):
                place = f"features.{stage}.{block}.block.{row // 2}.{row % 2}"
                yield f"_blocks.{number}.{part}", place
            number += 1
    head = f"features.{len(STAGES) + 1}"
    yield from (("_conv_head", f"{head}.0"), ("_bn1", f"{head}.1"))
