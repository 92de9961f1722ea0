"""How a regressor is trained; the defaults are the paper's (section Implementation).

Without PyTorch, so that the command line can offer them without it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from vioapr.errors import ParameterError
from vioapr.schemas.regressor import Settings

Precision = Literal["auto", "fp32", "bf16"]
Schedule = Literal["constant", "cosine", "step"]
LossName = Literal["learnable", "learnable-l2", "geometric"]

_WARM_UP = 0.05
"""Share of the steps in which a cosine schedule rises."""


def _check_within(params: object, **limits: float) -> None:
    """Refuse fields that are not within 0 and their limits."""
    for name, most in limits.items():
        if not 0 <= getattr(params, name) <= most:
            raise ParameterError(f"{name}: expected 0 to {most:g}, got {getattr(params, name)}")


@dataclass(frozen=True)
class AugmentationParams:
    """How training images are varied."""

    jitter: float = 0.5
    """Brightness, contrast and saturation vary by up to this factor either way; 0: none."""
    hue: float = 0.1
    """Hue varies by up to this part of the colour circle either way."""
    turn_deg: float = 0.0
    """The camera is turned by up to this angle about each axis, and its pose with it: exact,
    as a turn moves pixels whatever their depth. Needs known intrinsics, and replaces random
    crops, which move the picture under a pose that stays."""

    def __post_init__(self) -> None:
        _check_within(self, jitter=1.0, hue=0.5, turn_deg=60.0)


@dataclass(frozen=True)
class LossParams:
    """Which loss, and where its weights start."""

    loss: LossName = "learnable"
    """learnable: L_x exp(-s_x) + s_x + L_q exp(-s_q) + s_q with learned s, L1 norms (Kendall and
    Cipolla, CVPR 2017; geomapnet). learnable-l2: the same with L2 norms (MS-Transformer).
    geometric: how far a turned and moved camera displaces points before it; no weights."""
    position_weight: float = 0.0
    """s_x at the start."""
    rotation_weight: float = -3.0
    """s_q at the start."""
    depth: float = 1.0
    """Distance of the points that the geometric loss displaces, in standard deviations of the
    cameras' positions."""

    def __post_init__(self) -> None:
        if self.loss not in ("learnable", "learnable-l2", "geometric"):
            raise ParameterError(
                f"loss: expected learnable, learnable-l2 or geometric, got {self.loss!r}"
            )
        if not 0 < self.depth < 1000:
            raise ParameterError(f"depth: expected above 0 and below 1000, got {self.depth}")


@dataclass(frozen=True)
class PositionStageParams:
    """A second stage, which teaches positions alone; the rest stays as it is.

    As MS-Transformer's published code does on Cambridge Landmarks: the last layers of the
    position learn, on what the network says with neither dropout nor changing normalization.
    """

    position_epochs: int = 0
    """After all others, epochs in which only the position is learned."""
    position_jitter: float = 0.5
    """Variation of brightness, contrast and saturation in these epochs, 0 to 1."""
    position_hue: float = 0.2
    """Variation of hue in these epochs, 0 to 0.5."""

    def __post_init__(self) -> None:
        if self.position_epochs < 0:
            raise ParameterError(
                f"position_epochs: expected at least 0, got {self.position_epochs}"
            )
        _check_within(self, position_jitter=1.0, position_hue=0.5)


class Batches(NamedTuple):
    """Of one epoch.

    Attributes:
        size: Images in each.
        count: How many there are.
    """

    size: int
    count: int


def batches_of_epoch(images: int, batch_size: int) -> Batches:
    """Divide images into batches; a rest that fills none waits for another epoch."""
    size = max(min(batch_size, images), 1)
    return Batches(size, images // size)


class Stage(NamedTuple):
    """Epochs that are alike; in each stage the learning rate begins again.

    Attributes:
        first: Number of the first epoch.
        last: Number of the epoch after the last one.
        augmentation: How images are varied.
        is_of_positions: Whether positions alone are learned.
    """

    first: int
    last: int
    augmentation: AugmentationParams
    is_of_positions: bool = False

    @property
    def epochs(self) -> int:
        """The number of epochs."""
        return self.last - self.first


@dataclass(frozen=True)
class TrainingParams:
    """The loop's parameters."""

    epochs: int = 400
    """Times that every image is seen."""
    batch_size: int = 32
    """Images a step, of all devices together."""
    lr: float = 1e-4
    """Learning rate of Adam; the highest one, if the schedule changes it."""
    weight_decay: float = 5e-4
    """Pull of the weights to zero, added to their gradients."""
    schedule: Schedule = "constant"
    """constant; cosine: rises for a twentieth of the steps, then falls to zero; step: a tenth
    after every third of the epochs."""
    seed: int = 0
    """Decides weights, order and variation of images, and dropout."""
    precision: Precision = "auto"
    """auto: bf16 on GPUs that have it, else fp32."""
    compile: bool = False
    """Compile the network first (torch.compile): slow to start, faster after."""
    patience: int = 0
    """Stop when the validation recordings have not improved for this many epochs; 0: never."""
    devices: int = 1
    """Processes, each with a GPU, or each with its share of the processor."""
    nodes: int = 1
    """Machines, each with `devices` devices."""
    checkpoint_minutes: float = 5.0
    """Minutes between checkpoints within an epoch; the first comes within one. They do not change
    the result."""
    augmentation: AugmentationParams = field(default_factory=AugmentationParams)
    loss: LossParams = field(default_factory=LossParams)
    eps: float = 1e-8
    """Of Adam, added to the root of the gradients' mean square; MS-Transformer's code has 1e-10."""
    position_stage: PositionStageParams = field(default_factory=PositionStageParams)

    def __post_init__(self) -> None:
        for name in ("epochs", "batch_size", "devices", "nodes"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if not 0 < self.lr < math.inf:
            raise ParameterError(f"lr: expected a number above 0, got {self.lr}")
        if not 0 <= self.weight_decay < math.inf:
            raise ParameterError(f"weight_decay: expected at least 0, got {self.weight_decay}")
        if not 0 <= self.checkpoint_minutes < math.inf:
            raise ParameterError(
                f"checkpoint_minutes: expected at least 0, got {self.checkpoint_minutes}"
            )
        if not 0 < self.eps < 1:
            raise ParameterError(f"eps: expected above 0 and below 1, got {self.eps}")
        if self.patience and self.position_stage.position_epochs:
            raise ParameterError("patience: expected 0 where there are position_epochs")
        if self.seed < 0 or self.patience < 0:
            raise ParameterError("seed and patience: expected at least 0")
        if self.batch_size % (self.devices * self.nodes):
            raise ParameterError(
                f"batch_size: expected a multiple of the {self.devices * self.nodes} devices, "
                f"got {self.batch_size}"
            )

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The epochs, and the second stage if there is one."""
        own = self.position_stage
        varied = dataclasses.replace(
            self.augmentation, jitter=own.position_jitter, hue=own.position_hue
        )
        last = self.epochs + own.position_epochs
        stages = Stage(0, self.epochs, self.augmentation), Stage(self.epochs, last, varied, True)
        return tuple(stage for stage in stages if stage.last > stage.first)

    def lr_at(self, step: int, steps: int) -> float:
        """The learning rate of a step, of all `steps` of its stage."""
        part = step / steps
        if self.schedule == "constant":
            return self.lr
        if self.schedule == "step":
            return self.lr * 0.1 ** math.floor(3 * part)
        if part < _WARM_UP:
            return self.lr * (0.1 + 0.9 * part / _WARM_UP)
        return self.lr * 0.5 * (1 + math.cos(math.pi * (part - _WARM_UP) / (1 - _WARM_UP)))

    def to_json(self) -> Settings:
        """The parameters as plain values."""
        return dataclasses.asdict(self)
