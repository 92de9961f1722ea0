"""XFeat: key points and their descriptors, fast enough for phones.

As published by Potje et al. (CVPR 2024), written in operators that every runtime has: sizes are
fixed when a graph is traced, so enlarging a map is a product with constant matrices.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from vioapr.schemas.regressor import IMAGE_STD

CELL = 8
"""Pixels of the image to a pixel of the maps."""

DESCRIPTOR = 64
"""Numbers of a descriptor."""

_NORM_EPS = 1e-5


class XFeatMaps(NamedTuple):
    """What the network sees in one image of H x W pixels.

    Attributes:
        descriptor: (64, H / 8, W / 8), unit vectors.
        keypoint: (H, W), how much a pixel is a key point, 0 to 1.
        reliability: (H / 8, W / 8), how well its surroundings can be found again, 0 to 1.
    """

    descriptor: Tensor
    keypoint: Tensor
    reliability: Tensor


class ConvBlock(nn.Module):
    """Convolution, norm without own scale, ReLU."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> None:
        """With "same" padding for odd kernels."""
        super().__init__()
        self.layer = nn.Sequential(
            nn.Conv2d(inputs, outputs, kernel, stride, padding=kernel // 2, bias=False),
            nn.BatchNorm2d(outputs, affine=False),
            nn.ReLU(),
        )

    def forward(self, features: Tensor) -> Tensor:
        """BCHW to BCHW."""
        return self.layer(features)


class XFeat(nn.Module):
    """The detector and descriptor; the names of its weights are those of the published file."""

    def __init__(self) -> None:
        """With random weights."""
        super().__init__()
        self.skip1 = nn.Sequential(nn.AvgPool2d(4, stride=4), nn.Conv2d(1, 24, 1))
        self.block1 = nn.Sequential(
            ConvBlock(1, 4), ConvBlock(4, 8, stride=2), ConvBlock(8, 8), ConvBlock(8, 24, stride=2)
        )
        self.block2 = nn.Sequential(ConvBlock(24, 24), ConvBlock(24, 24))
        self.block3 = nn.Sequential(
            ConvBlock(24, 64, stride=2), ConvBlock(64, 64), ConvBlock(64, 64, 1)
        )
        self.block4 = nn.Sequential(
            ConvBlock(64, 64, stride=2), ConvBlock(64, 64), ConvBlock(64, 64)
        )
        self.block5 = nn.Sequential(
            ConvBlock(64, 128, stride=2),
            ConvBlock(128, 128),
            ConvBlock(128, 128),
            ConvBlock(128, 64, 1),
        )
        self.block_fusion = nn.Sequential(
            ConvBlock(64, 64), ConvBlock(64, 64), nn.Conv2d(64, DESCRIPTOR, 1)
        )
        self.heatmap_head = nn.Sequential(
            ConvBlock(64, 64, 1), ConvBlock(64, 64, 1), nn.Conv2d(64, 1, 1), nn.Sigmoid()
        )
        self.keypoint_head = nn.Sequential(
            ConvBlock(64, 64, 1),
            ConvBlock(64, 64, 1),
            ConvBlock(64, 64, 1),
            nn.Conv2d(64, CELL**2 + 1, 1),
        )

    def load_published(self, state: Mapping[str, Tensor]) -> None:
        """Take the published weights; those of its dense matcher, which is not used, are left."""
        own = {name: value for name, value in state.items() if not name.startswith("fine_matcher")}
        self.load_state_dict(own)

    def forward(self, images: Tensor) -> XFeatMaps:
        """One normalized image (1, 3, H, W); H and W multiples of 32."""
        grey = _normalize_grey(images)
        fine = self.block3(self.block2(self.block1(grey) + self.skip1(grey)))
        middle = self.block4(fine)
        coarse = self.block5(middle)
        features = self.block_fusion(fine + _enlarge(middle, 2) + _enlarge(coarse, 4))
        logits = self.keypoint_head(functional.pixel_unshuffle(grey, CELL))
        # The last of the channels says that a cell has no key point.
        likely = torch.softmax(logits, dim=1)[:, : CELL**2]
        return XFeatMaps(
            functional.normalize(features, dim=1)[0],
            _spread_cells(likely[0]),
            self.heatmap_head(features)[0, 0],
        )


def _spread_cells(values: Tensor) -> Tensor:
    """The pixels of cells, (CELL^2, h, w), side by side, (h CELL, w CELL)."""
    _, height, width = values.shape
    cells = values.reshape(CELL, CELL, height, width).permute(2, 0, 3, 1)
    return cells.reshape(height * CELL, width * CELL)


def _normalize_grey(images: Tensor) -> Tensor:
    """The mean of the channels with mean 0 and deviation 1, (1, 1, H, W).

    What was subtracted from the channels makes no difference.
    """
    weight = torch.tensor(IMAGE_STD, dtype=images.dtype, device=images.device)[:, None, None]
    grey = (images * weight).mean(dim=1, keepdim=True)
    grey = grey - grey.mean(dim=(2, 3), keepdim=True)
    return grey / torch.sqrt((grey * grey).mean(dim=(2, 3), keepdim=True) + _NORM_EPS)


def _enlarge(features: Tensor, factor: int) -> Tensor:
    """Enlarge a map (B, C, H, W) bilinearly, edges half a pixel out."""
    height, width = (
        interpolation_matrix(size, size * factor).to(features) for size in features.shape[2:]
    )
    return height @ features @ width.T


def interpolation_matrix(size: int, to_size: int) -> Tensor:
    """The linear interpolation from `size` samples to `to_size`, as a matrix (to_size, size)."""
    place = (torch.arange(to_size, dtype=torch.float64) + 0.5) * size / to_size - 0.5
    place = place.clamp(0, size - 1)
    samples = torch.arange(size, dtype=torch.float64)
    return torch.clamp(1 - torch.abs(place[:, None] - samples), min=0.0).float()
