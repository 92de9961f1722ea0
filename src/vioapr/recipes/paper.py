"""How the paper's networks are trained: functions that return configurations.

By the paper's section 5, or else by the networks' published code.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import msgspec

from vioapr.errors import ParameterError
from vioapr.recipes.datasets import DataSet
from vioapr.regression.params import (
    AugmentationParams,
    LossParams,
    PositionStageParams,
    TrainingParams,
)
from vioapr.schemas.base import to_plain
from vioapr.schemas.regressor import RegressorSpec
from vioapr.schemas.reproduction import Place, TrainingSettings

MODELS = {"posenet": "PN", "ms-transformer": "MS-T"}
"""Names of the networks, and the paper's."""


class Configuration(NamedTuple):
    """A network, and how it is trained.

    Attributes:
        spec: The network's.
        params: The training's.
    """

    spec: RegressorSpec
    params: TrainingParams

    @property
    def epochs(self) -> int:
        """The epochs of all stages."""
        return self.params.stages[-1].last

    def settings(self, weights: Path | None) -> TrainingSettings:
        """All that decides the result, as it is noted.

        Args:
            weights: File of the backbone's first weights, or None.
        """
        spec, params = self
        return TrainingSettings(
            scenes=spec.scenes,
            weights=None if weights is None else weights.name,
            epochs=params.epochs,
            batch_size=params.batch_size,
            resize=spec.resize,
            crop=spec.crop,
            lr=params.lr,
            weight_decay=params.weight_decay,
            schedule=params.schedule,
            loss=params.loss.loss,
            position_weight=params.loss.position_weight,
            rotation_weight=params.loss.rotation_weight,
            rotation=spec.rotation,
            orientation_layers=spec.orientation_layers,
            jitter=params.augmentation.jitter,
            hue=params.augmentation.hue,
            seed=params.seed,
            eps=params.eps,
            position_epochs=params.position_stage.position_epochs,
            position_jitter=params.position_stage.position_jitter,
            position_hue=params.position_stage.position_hue,
        )


def posenet(scenes: tuple[str, ...]) -> Configuration:
    """Configure PoseNet as in section 5, which all defaults are from."""
    return Configuration(RegressorSpec("posenet", scenes), TrainingParams())


def ms_transformer_outdoor(scenes: tuple[str, ...]) -> Configuration:
    """Configure MS-Transformer by its code's two stages for Cambridge Landmarks."""
    spec = RegressorSpec("ms-transformer", scenes, "quat", orientation_layers=6)
    params = TrainingParams(
        epochs=600, weight_decay=1e-4, eps=1e-10, schedule="step",
        augmentation=AugmentationParams(jitter=0.0, hue=0.0),
        loss=LossParams("learnable-l2", position_weight=-3.0, rotation_weight=-6.5),
        position_stage=PositionStageParams(60, position_jitter=0.5, position_hue=0.2),
    )  # fmt: skip
    return Configuration(spec, params)


def ms_transformer_indoor(scenes: tuple[str, ...]) -> Configuration:
    """Configure MS-Transformer by its code for 7-Scenes."""
    spec = RegressorSpec("ms-transformer", scenes, "quat", orientation_layers=4)
    params = TrainingParams(
        epochs=600, weight_decay=1e-4, eps=1e-10, schedule="step",
        augmentation=AugmentationParams(jitter=0.5, hue=0.2),
        loss=LossParams("learnable-l2", position_weight=0.0, rotation_weight=-3.0),
    )  # fmt: skip
    return Configuration(spec, params)


def as_published(
    data_set: DataSet, model: str, scenes: tuple[str, ...], place: Place
) -> Configuration:
    """Configure a network of the tables for scenes of a data set.

    Args:
        data_set: Whose scenes.
        model: A key of `MODELS`.
        scenes: Their names.
        place: Where they are.
    """
    if model == "posenet":
        return posenet(scenes)
    make = ms_transformer_indoor if place == "indoor" else ms_transformer_outdoor
    spec, params = make(scenes)
    if data_set.name != "marvin":
        # These data sets are those of the official code: its batches, and on 7-Scenes its epochs.
        epochs = 30 if place == "indoor" else params.epochs
        params = replace(params, batch_size=8, epochs=epochs)
    return Configuration(spec, params)


def changed(
    published: Configuration,
    *,
    epochs: int | None = None,
    batch_size: int | None = None,
    resize: int | None = None,
    crop: int | None = None,
    lr: float | None = None,
    seed: int | None = None,
) -> Configuration:
    """Change some settings of a configuration; None leaves one as it is.

    A second stage keeps its share of the epochs.

    Raises:
        ParameterError: A value that cannot be.
    """
    sizes = {"resize": resize, "crop": crop}
    values = {"epochs": epochs, "batch_size": batch_size, "lr": lr, "seed": seed}
    spec, params = published
    spec = msgspec.structs.replace(spec, **{k: v for k, v in sizes.items() if v is not None})
    params = replace(params, **{k: v for k, v in values.items() if v is not None})
    stage, before = params.position_stage, published.params.epochs
    second = replace(stage, position_epochs=stage.position_epochs * params.epochs // before)
    return Configuration(spec, replace(params, position_stage=second))


def choose_models(names: Sequence[str]) -> tuple[str, ...]:
    """Choose networks by name, in the tables' order.

    Raises:
        ParameterError: None, or one that the tables do not have.
    """
    for name in names or ("",):
        if name not in MODELS:
            got = repr(name) if name else "none"
            raise ParameterError(f"models: expected some of {', '.join(MODELS)}, got {got}")
    return tuple(model for model in MODELS if model in names)


def differences(
    planned: Configuration, published: Configuration, weights: Path | None
) -> Iterator[str]:
    """Say in what a training is not as published, a line each."""
    model = planned.spec.model
    title = MODELS[model]
    wanted = to_plain(published.settings(weights))
    for name, value in to_plain(planned.settings(weights)).items():
        if value != wanted[name] and name != "seed":
            yield f"{title}: {name.replace('_', ' ')} {value} instead of {wanted[name]}"
    if weights is None:
        yield f"{title}: no pretrained weights; the published code starts from ImageNet's"
    if model == "ms-transformer" and published.params.position_stage.position_epochs:
        yield (
            f"{title}: outdoors the official code shows images of smaller scenes more often; here "
            "every image is seen once an epoch"
        )
