"""What a step of training runs forwards, and what a whole run is about."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from vioapr.regression.batches import Batch
from vioapr.regression.data import Samples
from vioapr.regression.losses import PoseLoss
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.params import LossParams, TrainingParams
from vioapr.regression.spec import RegressorSpec


class Learner(nn.Module):
    """A network with its loss: what a step runs forwards."""

    def __init__(self, network: PoseNetwork, loss: LossParams) -> None:
        """Of a network."""
        super().__init__()
        self.network, self.loss = network, PoseLoss(loss)
        self._is_of_positions = False

    def learn_positions_alone(self) -> None:
        """From now on nothing else changes, and nothing is dropped out."""
        self._is_of_positions = self.loss.is_of_positions = True
        self.requires_grad_(False)
        for module in self.network.position_modules():
            module.requires_grad_(True)

    def train(self, mode: bool = True) -> Learner:
        """As `nn.Module.train`, of what learns."""
        return super().train(mode and not self._is_of_positions)

    def forward(self, batch: Batch) -> Tensor:
        """The mean loss of a batch."""
        raw = self.network.forward_raw(batch.images, batch.scene)
        with torch.autocast(batch.images.device.type, enabled=False):
            raw = raw._replace(**{
                name: value.float() for name, value in raw._asdict().items() if value is not None
            })  # fmt: skip
            position = self.network.to_unit(batch.position_m, batch.scene)
            return self.loss(self.network, raw, position, batch.quat_xyzw, batch.scene)


class Run(NamedTuple):
    """What a training run is about.

    Attributes:
        spec: The regressor's.
        network: With its first weights and its scenes' units.
        samples: To learn from.
        validation: To choose the best epoch by, or None: then the last one is.
        folder: Where checkpoints go.
        params: The loop's.
        tick: Called after every step.
    """

    spec: RegressorSpec
    network: PoseNetwork
    samples: Samples
    validation: Samples | None
    folder: Path
    params: TrainingParams
    tick: Callable[[], object] = lambda: None


def set_units(network: PoseNetwork, samples: Samples) -> None:
    """The units of all scenes, from their training cameras."""
    for scene in range(len(network.size_m)):
        position_m = samples.position_m[samples.scene == scene]
        size_m = float(position_m.std(axis=0).max())
        centre_m = torch.as_tensor(position_m.mean(axis=0), dtype=torch.float32)
        network.set_unit(scene, centre_m, max(size_m, 1e-3))
