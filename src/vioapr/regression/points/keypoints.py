"""A fixed number of key points of an image, in tensors of fixed shape."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from vioapr.regression.networks.xfeat import CELL, XFeatMaps, interpolation_matrix

_LEAST = 0.05
"""Of what a key point is; XFeat's own threshold."""

_AROUND = 5
"""Pixels of the square of which a key point is the largest."""


class Keypoints(NamedTuple):
    """Key points of one image, N of them, the best first.

    Attributes:
        xy: (N, 2), pixels of the network's image; the middle of the first pixel is (0.5, 0.5).
        descriptor: (N, 64), unit vectors.
        score: (N,), 0 where there are fewer than N.
    """

    xy: Tensor
    descriptor: Tensor
    score: Tensor


def find_keypoints(maps: XFeatMaps, count: int) -> Keypoints:
    """Find the key points of an image."""
    heat = maps.keypoint
    height, width = heat.shape
    largest = functional.max_pool2d(heat[None, None], _AROUND, 1, _AROUND // 2)[0, 0]
    rows = interpolation_matrix(height // CELL, height).to(heat)
    columns = interpolation_matrix(width // CELL, width).to(heat)
    reliable = rows @ maps.reliability @ columns.T
    is_peak = ((heat >= largest) & (heat > _LEAST)).to(heat.dtype)
    score, place = torch.topk((heat * reliable * is_peak).reshape(-1), count)
    row = torch.div(place, width, rounding_mode="floor")
    x, y = (place - row * width).to(heat.dtype), row.to(heat.dtype)
    return Keypoints(
        torch.stack([x, y], dim=-1) + 0.5,
        functional.normalize(_sample(maps.descriptor, x, y, (height, width)), dim=-1),
        score,
    )


def _sample(maps: Tensor, x: Tensor, y: Tensor, image_size: tuple[int, int]) -> Tensor:
    """Values (N, C) of maps (C, h, w) at pixels of the image, bilinearly.

    A map's corner lies where XFeat's own sampling has it: it learned with that.
    """
    channels, height, width = maps.shape
    flat = maps.reshape(channels, height * width).T
    found = torch.zeros(1, dtype=maps.dtype, device=maps.device)
    across, down = (
        place * size / (whole - 1) - 0.5
        for place, size, whole in ((x, width, image_size[1]), (y, height, image_size[0]))
    )
    left, top = torch.floor(across), torch.floor(down)
    for column in (0, 1):
        for row in (0, 1):
            weight = (1 - torch.abs(across - left - column)) * (1 - torch.abs(down - top - row))
            at_x = torch.clamp(left + column, 0, width - 1).to(torch.int64)
            at_y = torch.clamp(top + row, 0, height - 1).to(torch.int64)
            found = found + weight[:, None] * torch.index_select(flat, 0, at_y * width + at_x)
    return found
