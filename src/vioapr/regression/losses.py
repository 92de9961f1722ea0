"""The losses of pose regression, and a network together with its loss."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from vioapr.geometry import quaternion
from vioapr.regression.batches import Batch
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
        """Return the mean over B images.

        Args:
            network: Whose code of rotations it is.
            raw: The network's outputs.
            position: (B, 3), true, in the scene's unit.
            quat_xyzw: (B, 4), true.
            scene: (B,), true.
        """
        offset = raw.position - position
        if self.is_of_positions:
            pose = self.size(offset)
        elif self.params.loss == "geometric":
            pose = self.displacement(network, raw, offset, quat_xyzw)
        else:
            residual = network.code.residual(raw.rotation, quat_xyzw)
            sizes = torch.stack([self.size(offset), self.size(residual)])
            pose = (sizes * torch.exp(-self.weights) + self.weights).sum()
        loss = pose + laplace_likelihood(network, raw, offset, quat_xyzw)
        if raw.scene_logits is not None and not self.is_of_positions:
            loss = loss + functional.cross_entropy(raw.scene_logits, scene)
        return loss

    def size(self, differences: Tensor) -> Tensor:
        """Return the mean norm of B differences (B, k): L2, or the mean of absolute values."""
        if self.params.loss == "learnable-l2":
            return torch.linalg.vector_norm(differences, dim=-1).mean()
        return differences.abs().mean()

    def displacement(
        self, network: PoseNetwork, raw: Raw, offset: Tensor, quat_xyzw: Tensor
    ) -> Tensor:
        """Return the mean L1 displacement of points ahead and to all sides of the view."""
        places = [(x, y, 1.0) for x in (-0.6, 0.0, 0.6) for y in (-0.6, 0.0, 0.6)]
        points = self.params.depth * torch.tensor(places, device=offset.device)
        predicted = network.code.to_quat(raw.rotation)
        between = quaternion.to_matrix(predicted) - quaternion.to_matrix(quat_xyzw)
        moved = torch.einsum("bij,nj->bni", between, points) + offset[:, None]
        return moved.abs().mean()


def laplace_likelihood(network: PoseNetwork, raw: Raw, offset: Tensor, quat_xyzw: Tensor) -> Tensor:
    """Return the negative log-likelihood of the errors under Laplace's distribution, per axis.

    The errors are constants here: this term teaches the uncertainty, not the pose.
    """
    with torch.no_grad():
        predicted = network.code.to_quat(raw.rotation)
        angle_rad = torch.deg2rad(quaternion.angle_between_deg(predicted, quat_xyzw))
        sizes = torch.stack([offset.abs().mean(dim=-1), angle_rad / 3**0.5], dim=-1)
    return (sizes * torch.exp(-raw.log_sigma) + raw.log_sigma).mean()


class Learner(nn.Module):
    """A network with its loss: one module that a step runs forwards."""

    def __init__(self, network: PoseNetwork, loss: LossParams) -> None:
        """Of a network."""
        super().__init__()
        self.network, self.loss = network, PoseLoss(loss)
        self._is_of_positions = False

    def learn_positions_alone(self) -> None:
        """Freeze all but the last layers of the position, and drop nothing out any more."""
        self._is_of_positions = self.loss.is_of_positions = True
        self.requires_grad_(False)
        for module in self.network.position_modules():
            module.requires_grad_(True)

    def train(self, mode: bool = True) -> Learner:
        """Set the mode as `nn.Module.train`; in evaluation mode where positions alone learn."""
        return super().train(mode and not self._is_of_positions)

    def forward(self, batch: Batch) -> Tensor:
        """Return the mean loss of a batch."""
        raw = self.network.forward_raw(batch.images, batch.scene)
        with torch.autocast(batch.images.device.type, enabled=False):
            raw = raw._replace(**{
                name: value.float() for name, value in raw._asdict().items() if value is not None
            })  # fmt: skip
            position = self.network.to_unit(batch.position_m, batch.scene)
            return self.loss(self.network, raw, position, batch.quat_xyzw, batch.scene)
