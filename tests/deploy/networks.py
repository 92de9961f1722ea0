"""A regressor that is small enough for tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn


class TinyPrediction(NamedTuple):
    position_m: Tensor
    quat_xyzw: Tensor
    sigma_position_m: Tensor
    sigma_orientation_rad: Tensor


@dataclass(frozen=True)
class TinySpec:
    model: str = "tiny"
    resize: int = 64
    crop: int = 56
    scenes: tuple[str, ...] = ("courtyard",)


class TinyNetwork(nn.Module):
    """Predicts within some metres of the origin, depending on the image's brightness."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        torch.manual_seed(seed)
        self.features = nn.Conv2d(3, 8, 8, stride=8)
        self.norm = nn.BatchNorm2d(8)
        self.head = nn.Linear(8, 9)

    def forward(self, images: Tensor) -> TinyPrediction:
        features = torch.relu(self.norm(self.features(images))).mean(dim=(2, 3))
        values = self.head(features)
        quat = values[:, 3:7] * 0.2 + torch.tensor([-0.5, 0.5, -0.5, 0.5])
        return TinyPrediction(
            values[:, :3] * 3,
            quat / torch.linalg.vector_norm(quat, dim=-1, keepdim=True),
            torch.exp(values[:, 7]),
            torch.exp(values[:, 8] - 3),
        )


class WideNetwork(TinyNetwork):
    """With so many weights that their precision shows in the file's size."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed)
        self.features = nn.Conv2d(3, 256, 8, stride=8)
        self.norm = nn.BatchNorm2d(256)
        self.head = nn.Linear(256, 9)
