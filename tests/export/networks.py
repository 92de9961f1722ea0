"""Regressors that are small enough for tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD


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


RANGE_M = 64.0
"""Coordinates that a picture can hold: from minus to plus this."""

_GRID, _LEVELS = 4, 256


def picture_of(pose: np.ndarray, height: int, width: int) -> np.ndarray:
    """A picture that shows a pose, for `DecodingNetwork`: two grey patches a number.

    Args:
        pose: x y z qx qy qz qw.
        height: A multiple of 4, at least 48.
        width: Likewise.
    """
    scaled = np.concatenate([pose[:3] / RANGE_M, pose[3:]])
    counts = np.rint((scaled + 1) / 2 * (_LEVELS**2 - 1)).astype(int)
    digits = np.stack([counts // _LEVELS, counts % _LEVELS], axis=-1).reshape(-1)
    patches = np.zeros(_GRID**2, dtype=np.uint8)
    patches[: len(digits)] = digits
    cell = np.ones((height // _GRID, width // _GRID, 3), dtype=np.uint8)
    return np.kron(patches.reshape(_GRID, _GRID, 1), cell)


class DecodingNetwork(nn.Module):
    """Predicts the pose that a picture shows, so that walks can be told to any localizer."""

    def __init__(self, spec: TinySpec) -> None:
        super().__init__()
        margin, cell = (spec.resize - spec.crop) // 2, spec.resize // _GRID
        masks = torch.zeros(_GRID**2, spec.resize, spec.resize)
        for index in range(_GRID**2):
            top, left = (cell * k + cell // 2 - 2 for k in divmod(index, _GRID))
            masks[index, top : top + 4, left : left + 4] = 1 / 16
        inner = slice(margin, margin + spec.crop)
        self.register_buffer("masks", masks[:14, inner, inner].reshape(14, -1).T.contiguous())
        digits = torch.zeros(14, 7)
        for number in range(7):
            digits[2 * number : 2 * number + 2, number] = torch.tensor([_LEVELS, 1.0])
        self.register_buffer("digits", digits * 2 / (_LEVELS**2 - 1))

    def forward(self, images: Tensor) -> TinyPrediction:
        grey = (images[:, 0] * IMAGE_STD[0] + IMAGE_MEAN[0]) * 255
        scaled = grey.reshape(1, -1) @ self.masks @ self.digits - 1
        quat = scaled[:, 3:]
        spread = torch.exp(scaled[:, 0] * 10 - 1)  # differs by place
        return TinyPrediction(
            scaled[:, :3] * RANGE_M,
            quat / torch.linalg.vector_norm(quat, dim=-1, keepdim=True),
            spread,
            spread * 0.1,
        )
