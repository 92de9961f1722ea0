"""The inputs and outputs of every pose network."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from vioapr.regression.networks.rotation import RotationCode

_LOG_SIGMA_LIMIT = 7.0
"""Of the logarithm of sigma, so that an odd image cannot make it infinite."""


class Raw(NamedTuple):
    """The outputs that a network learns with, of B images.

    Attributes:
        position: (B, 3), in the scene's own unit: (world_m - centre_m) / size_m.
        rotation: (B, code.size), see `rotation.py`.
        log_sigma: (B, 2), of position in the scene's unit and of orientation in rad.
        scene_logits: (B, S), which scene the image shows; None where there is one.
    """

    position: Tensor
    rotation: Tensor
    log_sigma: Tensor
    scene_logits: Tensor | None = None


class Prediction(NamedTuple):
    """World_from_cam of B images, in OpenCV camera axes.

    Attributes:
        position_m: (B, 3), m.
        quat_xyzw: (B, 4), unit.
        sigma_position_m: (B,), standard deviation of the position per axis, m.
        sigma_orientation_rad: (B,), the same of the orientation, rad.
    """

    position_m: Tensor
    quat_xyzw: Tensor
    sigma_position_m: Tensor
    sigma_orientation_rad: Tensor


class PoseNetwork(nn.Module):
    """Base of all networks: turns what they learn into metres.

    Attributes:
        code: How it says rotations.
    """

    centre_m: Tensor
    size_m: Tensor
    sigma_scale: Tensor

    def __init__(self, code: RotationCode, scenes: int = 1) -> None:
        """With a unit for each of S scenes, which `set_unit` sets."""
        super().__init__()
        self.code = code
        self.register_buffer("centre_m", torch.zeros(scenes, 3))
        self.register_buffer("size_m", torch.ones(scenes))
        # From the mean absolute error that networks learn to the standard deviation (Laplace).
        self.register_buffer("sigma_scale", torch.full((2,), 2**0.5))

    def set_unit(self, scene: int, centre_m: Tensor, size_m: float) -> None:
        """The unit of a scene: networks learn best from numbers around one.

        Args:
            scene: Its number.
            centre_m: Shape (3,), mean position of the training cameras, m.
            size_m: Standard deviation of their positions, m.
        """
        self.centre_m[scene] = centre_m
        self.size_m[scene] = size_m

    def position_modules(self) -> tuple[nn.Module, ...]:
        """The last layers of the position, and those of the uncertainty."""
        raise NotImplementedError

    def to_unit(self, position_m: Tensor, scene: Tensor) -> Tensor:
        """Positions in metres (B, 3) of scenes (B,) in their units."""
        return (position_m - self.centre_m[scene]) / self.size_m[scene][:, None]

    def forward_raw(self, images: Tensor, scene: Tensor | None = None) -> Raw:
        """Images (B, 3, H, W), and in training the numbers (B,) of their scenes."""
        raise NotImplementedError

    def forward(self, images: Tensor) -> Prediction:
        """Normalized images (B, 3, H, W) to poses."""
        return self.to_prediction(self.forward_raw(images))

    def to_prediction(self, raw: Raw) -> Prediction:
        """In metres, of the likeliest scene."""
        if raw.scene_logits is None:
            centre_m, size_m = self.centre_m[:1], self.size_m[:1]
        else:
            chosen = one_hot_of_largest(raw.scene_logits)
            centre_m, size_m = chosen @ self.centre_m, chosen @ self.size_m
        sigma = raw.log_sigma.clamp(-_LOG_SIGMA_LIMIT, _LOG_SIGMA_LIMIT).exp() * self.sigma_scale
        return Prediction(
            raw.position * size_m[:, None] + centre_m,
            self.code.to_quat(raw.rotation),
            sigma[:, 0] * size_m,
            sigma[:, 1],
        )


class Heads(nn.Module):
    """Position, rotation and their uncertainty from features (B, F).

    The uncertainty learns from features that it cannot change: the poses are those of a network
    without it.
    """

    def __init__(self, features: int, code: RotationCode) -> None:
        """From a number of features."""
        super().__init__()
        self.position = nn.Linear(features, 3)
        self.rotation = nn.Linear(features, code.size)
        self.log_sigma = nn.Linear(features, 2)
        for layer in (self.position, self.rotation):
            nn.init.normal_(layer.weight, std=features**-0.5)
        nn.init.zeros_(self.log_sigma.weight)
        with torch.no_grad():
            self.position.bias.zero_()
            self.rotation.bias.copy_(torch.tensor(code.start))
            self.log_sigma.bias.fill_(-1.0)

    def forward(self, features: Tensor, dropped: Tensor | None = None) -> Raw:
        """Poses from features after dropout, if given; uncertainty from those before."""
        kept = features if dropped is None else dropped
        return Raw(self.position(kept), self.rotation(kept), self.log_sigma(features.detach()))


def one_hot_of_largest(logits: Tensor) -> Tensor:
    """(B, S) to (B, S): 1 at the largest, else 0; exports without integers."""
    return (logits >= logits.amax(dim=-1, keepdim=True)).to(logits.dtype)
