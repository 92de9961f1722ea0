"""How each network is trained, as the paper says, or else its authors' published code."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from vioapr.errors import ParameterError
from vioapr.importers.base import Place
from vioapr.recipes.datasets import DataSet

MODELS = {"posenet": "PN", "ms-transformer": "MS-T"}
"""Names of the networks, and the paper's."""


@dataclass(frozen=True)
class Recipe:
    """Settings of one training; the defaults are the paper's of PoseNet (section 5).

    Attributes:
        epochs: Times that every image is seen.
        batch_size: Images a step.
        resize: Images are resized to resize x resize pixels.
        crop: Size of the random crop, of the middle one at test.
        lr: Learning rate at the start.
        weight_decay: Pull of the weights to zero.
        schedule: Of the learning rate; step: a tenth after every third of the epochs.
        loss: Norm of the learnable loss.
        position_weight: Its s_x at the start.
        rotation_weight: Its s_q at the start.
        rotation: Code of rotations.
        orientation_layers: Of MS-Transformer's second transformer.
        jitter: Variation of brightness, contrast and saturation.
        hue: Variation of hue.
        seed: Of everything random.
        eps: Of Adam.
        position_epochs: After the others, epochs in which only the position is learned.
        position_jitter: As jitter, in these epochs.
        position_hue: As hue, in these epochs.
    """

    epochs: int = 400
    batch_size: int = 32
    resize: int = 256
    crop: int = 224
    lr: float = 1e-4
    weight_decay: float = 5e-4
    schedule: Literal["constant", "step"] = "constant"
    loss: Literal["learnable", "learnable-l2"] = "learnable"
    position_weight: float = 0.0
    rotation_weight: float = -3.0
    rotation: Literal["log-quat", "quat"] = "log-quat"
    orientation_layers: int = 6
    jitter: float = 0.5
    hue: float = 0.1
    seed: int = 0
    eps: float = 1e-8
    position_epochs: int = 0
    position_jitter: float = 0.5
    position_hue: float = 0.2

    @property
    def all_epochs(self) -> int:
        """Of both stages."""
        return self.epochs + self.position_epochs

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return dataclasses.asdict(self)


@dataclass(frozen=True)
class Overrides:
    """What the user wants otherwise; None leaves it to the recipe."""

    epochs: int | None = None
    batch_size: int | None = None
    resize: int | None = None
    crop: int | None = None
    lr: float | None = None
    seed: int | None = None

    def apply(self, recipe: Recipe) -> Recipe:
        """The recipe with what is given.

        Raises:
            ParameterError: A value that cannot be.
        """
        given = {name: value for name, value in vars(self).items() if value is not None}
        changed = replace(recipe, **given)
        # The second stage keeps its share.
        second = recipe.position_epochs * changed.epochs // recipe.epochs
        changed = replace(changed, position_epochs=max(second, 0))
        for name, least in (("epochs", 1), ("batch_size", 1), ("seed", 0)):
            if getattr(changed, name) < least:
                flag = "--" + name.replace("_", "-")
                raise ParameterError(
                    f"{flag}: expected at least {least}, got {getattr(changed, name)}"
                )
        if not 0 < changed.lr < math.inf:
            raise ParameterError(f"--lr: expected a number above 0, got {changed.lr}")
        if not 32 <= changed.crop <= changed.resize <= 4096:
            raise ParameterError(
                f"expected 32 <= crop <= resize <= 4096 pixels, got --crop {changed.crop} and "
                f"--resize {changed.resize}"
            )
        return changed


_MS_T = Recipe(
    epochs=600, weight_decay=1e-4, eps=1e-10, schedule="step", loss="learnable-l2",
    rotation="quat",
)  # fmt: skip
_MS_T_OF_PLACE = {
    # The official configurations: of both stages of Cambridge Landmarks, and of 7-Scenes.
    "outdoor": replace(
        _MS_T,
        position_weight=-3.0,
        rotation_weight=-6.5,
        orientation_layers=6,
        jitter=0.0,
        hue=0.0,
        position_epochs=60,
    ),
    "indoor": replace(_MS_T, orientation_layers=4, jitter=0.5, hue=0.2),
}


def paper_recipe(data_set: DataSet, model: str, place: Place) -> Recipe:
    """How a network of the tables is trained on scenes of a place."""
    if model == "posenet":
        return Recipe()
    recipe = _MS_T_OF_PLACE[place]
    if data_set.name == "marvin":
        return recipe
    # These data sets are those of the official code: its batches, and on 7-Scenes its epochs.
    return replace(recipe, batch_size=8, epochs=30 if place == "indoor" else recipe.epochs)


def choose_models(names: Sequence[str]) -> tuple[str, ...]:
    """Networks by name, in the tables' order.

    Raises:
        ParameterError: None, or one that the tables do not have.
    """
    for name in names or ("",):
        if name not in MODELS:
            got = repr(name) if name else "none"
            raise ParameterError(f"--models: expected some of {', '.join(MODELS)}, got {got}")
    return tuple(model for model in MODELS if model in names)


def differences(
    model: str, planned: Recipe, published: Recipe, weights: Path | None
) -> Iterator[str]:
    """In what a training is not as published, a line each."""
    title = MODELS[model]
    for name, value in planned.to_json().items():
        wanted = getattr(published, name)
        if value != wanted and name != "seed":
            yield f"{title}: {name.replace('_', ' ')} {value} instead of {wanted}"
    if weights is None:
        yield f"{title}: no pretrained weights; the published code starts from ImageNet's"
    if model == "ms-transformer" and published.position_epochs:
        yield (
            f"{title}: outdoors the official code shows images of smaller scenes more often; here "
            "every image is seen once an epoch"
        )
