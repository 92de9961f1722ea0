"""What training makes small."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from vioapr.geometry import quaternion
from vioapr.regression.networks.base import PoseNetwork, Raw
from vioapr.regression.params import LossParams


class PoseLoss(nn.Module):
    """The loss of a batch, with the weights that it learns.

    Attributes:
        is_of_positions: Whether the error of positions is all that counts.
    """

    def __init__(self, params: LossParams) -> None:
        """With the weights at their start."""
        super().__init__()
        self.params, self.is_of_positions = params, False
        start = torch.tensor([params.position_weight, params.rotation_weight])
        self.weights = nn.Parameter(start, requires_grad=params.loss != "geometric")

    def forward(
        self, network: PoseNetwork, raw: Raw, position: Tensor, quat_xyzw: Tensor, scene: Tensor
    ) -> Tensor:
        """Mean over B images.

        Args:
            network: Whose code says what the rotation's numbers mean.
            raw: What it said.
            position: (B, 3), true, in the scene's unit.
            quat_xyzw: (B, 4), true.
            scene: (B,), true.
        """
        off = raw.position - position
        if self.is_of_positions:
            return self._size(off) + _uncertainty(network, raw, off, quat_xyzw)
        if self.params.loss == "geometric":
            pose = self._geometric(network, raw, off, quat_xyzw)
        else:
            pose = self._weighted(off, network.code.residual(raw.rotation, quat_xyzw))
        loss = pose + _uncertainty(network, raw, off, quat_xyzw)
        if raw.scene_logits is not None:
            loss = loss + functional.cross_entropy(raw.scene_logits, scene)
        return loss

    def _weighted(self, off: Tensor, turned: Tensor) -> Tensor:
        sizes = torch.stack([self._size(off), self._size(turned)])
        return (sizes * torch.exp(-self.weights) + self.weights).sum()

    def _size(self, differences: Tensor) -> Tensor:
        """Mean over B differences (B, k)."""
        if self.params.loss == "learnable-l2":
            return torch.linalg.vector_norm(differences, dim=-1).mean()
        return differences.abs().mean()

    def _geometric(self, network: PoseNetwork, raw: Raw, off: Tensor, quat_xyzw: Tensor) -> Tensor:
        """Mean L1 displacement of points straight ahead and to all sides of the view."""
        places = [(x, y, 1.0) for x in (-0.6, 0.0, 0.6) for y in (-0.6, 0.0, 0.6)]
        points = self.params.depth * torch.tensor(places, device=off.device)
        said = network.code.to_quat(raw.rotation)
        between = quaternion.to_matrix(said) - quaternion.to_matrix(quat_xyzw)
        moved = torch.einsum("bij,nj->bni", between, points) + off[:, None]
        return moved.abs().mean()


def _uncertainty(network: PoseNetwork, raw: Raw, off: Tensor, quat_xyzw: Tensor) -> Tensor:
    """Negative log-likelihood of the errors under Laplace's distribution, per axis.

    The errors are taken as they are: this term teaches the uncertainty, not the pose.
    """
    with torch.no_grad():
        said = network.code.to_quat(raw.rotation)
        angle_rad = torch.deg2rad(quaternion.angle_between_deg(said, quat_xyzw))
        sizes = torch.stack([off.abs().mean(dim=-1), angle_rad / 3**0.5], dim=-1)
    return (sizes * torch.exp(-raw.log_sigma) + raw.log_sigma).mean()
