"""From camera pixels to the network's input, as matrix products.

A resize is a product with a matrix of filter weights. Building those matrices in the graph, from
the image's height and width, makes one file fit all cameras, and avoids the operator `Resize`,
whose antialiasing differs by runtime. The filter is PIL's antialiased bilinear one (a triangle
as wide as the reduction), which training uses too. Rows are only touched by the few output rows
that they fall into, so the product is done in blocks: dense, it would cost more than a network
for phones.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from vioapr.errors import ParameterError
from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD

_BLOCK = 16
"""Output rows that share a window of input rows."""


class Preprocessor(nn.Module):
    """Resize to a square, crop its centre, normalize: as in the paper (section 5.1)."""

    factor: Tensor
    offset: Tensor

    def __init__(self, resize: int, crop: int) -> None:
        """Fix the sizes.

        Args:
            resize: Side of the square that the image is resized to, pixels.
            crop: Side of the square that is cut out of its middle, pixels.

        Raises:
            ParameterError: The crop is larger than the square.
        """
        super().__init__()
        if not 0 < crop <= resize:
            raise ParameterError(f"expected a crop of 1 to {resize} pixels, got {crop}")
        self.resize, self.crop = resize, crop
        # Grey levels to normalized values, folded into one factor and offset a channel.
        mean, std = torch.tensor(IMAGE_MEAN), torch.tensor(IMAGE_STD)
        self.register_buffer("factor", (1 / (255 * std)).reshape(1, 3, 1, 1), persistent=False)
        self.register_buffer("offset", (-mean / std).reshape(1, 3, 1, 1), persistent=False)

    def forward(self, image: Tensor) -> Tensor:
        """Prepare an image.

        Args:
            image: Shape (height, width, 3), uint8, RGB.

        Returns:
            Shape (1, 3, crop, crop).
        """
        height, width, crop = image.shape[0], image.shape[1], self.crop
        rows = self._shrink(image.reshape(height, width * 3), height)
        columns = rows.reshape(crop, width, 3).permute(1, 2, 0).reshape(width, 3 * crop)
        square = self._shrink(columns, width).reshape(crop, 3, crop).permute(1, 2, 0)
        return square[None] * self.factor + self.offset

    def _shrink(self, rows: Tensor, count: int) -> Tensor:
        """Filter along the first axis, shape (count, k) to (crop, k)."""
        blocks = -(-self.crop // _BLOCK)
        scale = torch.full((1,), 1.0 / self.resize) * count  # input rows an output row
        support = torch.clamp(scale, min=1.0)
        centers = (self._output_rows(blocks) + 0.5) * scale
        first = torch.floor(centers[:, :1] - support)
        # Wide enough for any size: (_BLOCK - 1) rows apart, and the support on both sides.
        window = ((_BLOCK + 1) * count) // self.resize + 5
        index = first + torch.arange(window).to(torch.float32)
        weights = self._weights(index, centers, support, count)
        last = torch.full((1,), 1.0) * (count - 1)
        inside = torch.minimum(torch.clamp(index, min=0.0), last).to(torch.int32)
        gathered = torch.index_select(rows, 0, inside.reshape(-1)).to(torch.float32)
        shrunk = weights @ gathered.reshape(blocks, window, -1)
        return shrunk.reshape(blocks * _BLOCK, -1)[: self.crop]

    def _output_rows(self, blocks: int) -> Tensor:
        """Row numbers in the resized square, shape (blocks, _BLOCK)."""
        margin = (self.resize - self.crop) // 2
        return margin + torch.arange(blocks * _BLOCK, dtype=torch.float32).reshape(blocks, _BLOCK)

    @staticmethod
    def _weights(index: Tensor, centers: Tensor, support: Tensor, count: int) -> Tensor:
        """Of the window's rows in every output row, shape (blocks, _BLOCK, window)."""
        distance = (index[:, None, :] + 0.5 - centers[..., None]) / support
        triangle = torch.clamp(1 - torch.abs(distance), min=0.0)
        is_inside = (index >= 0) & (index < count)
        triangle = triangle * is_inside.to(torch.float32)[:, None, :]
        # Rows that only pad the last block may see nothing.
        total = torch.clamp(triangle.sum(dim=-1, keepdim=True), min=1e-6)
        return triangle / total
