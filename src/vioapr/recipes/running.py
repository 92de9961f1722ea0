"""Doing the work of a training: learning, and predicting the test recordings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

from vioapr.files.text import write_text
from vioapr.recipes.plan import Training
from vioapr.recipes.progress import (
    PREDICTED_FILE,
    finished_epochs,
    is_trained,
    regressor_digest,
    work_of,
)
from vioapr.recipes.recipes import Recipe
from vioapr.regression.checkpoint import LoadedRegressor
from vioapr.regression.files import STATE_FILE
from vioapr.regression.params import (
    AugmentationParams,
    LossParams,
    PositionStageParams,
    TrainingParams,
    batches_of_epoch,
)
from vioapr.regression.prediction import load_predictor, predict_walks
from vioapr.regression.preparing import choose_frames, prepare_run
from vioapr.regression.spec import RegressorSpec
from vioapr.regression.training import train
from vioapr.scene.scene import Scene
from vioapr.work.progress import Advance


def run_training(training: Training, scenes: Mapping[str, Scene], tick: Advance) -> None:
    """Train and predict what is not there yet.

    Args:
        training: Which.
        scenes: All scenes by name.
        tick: Called with a number of images, `work_of(...).images` in all.

    Raises:
        VioAprError: A scene, checkpoint or weights are broken, or training went wrong.
    """
    if not is_trained(training):
        _learn(training, [scenes[name] for name in training.scenes], tick)
    open_scenes = work_of(training, scenes).scenes
    if not open_scenes:
        return
    regressor = load_predictor(training.folder)
    for name in open_scenes:
        _predict(training, regressor, name, scenes[name], tick)


def _learn(training: Training, scenes: list[Scene], tick: Advance) -> None:
    recipe = training.recipe
    run = prepare_run(
        scenes, choose_frames(scenes), _spec(training), _params(recipe), training.folder,
        training.weights, lambda: tick(1),
    )  # fmt: skip
    batch, steps = batches_of_epoch(len(run.samples), recipe.batch_size)
    # The steps of a resumed training's finished epochs tick too, and are no work that is left.
    skipped = finished_epochs(training) * steps
    run = run._replace(tick=_after(skipped, lambda: tick(batch)))
    train(run, resume=(training.folder / STATE_FILE).exists())


def _after(count: int, call: Callable[[], object]) -> Callable[[], None]:
    """Calls through, but for the first so many times."""
    left = count

    def counted() -> None:
        nonlocal left
        if left:
            left -= 1
        else:
            call()

    return counted


def _spec(training: Training) -> RegressorSpec:
    recipe = training.recipe
    return RegressorSpec(
        training.model, training.scenes, recipe.rotation, recipe.resize, recipe.crop,
        orientation_layers=recipe.orientation_layers,
    )  # fmt: skip


def _params(recipe: Recipe) -> TrainingParams:
    return TrainingParams(
        epochs=recipe.epochs,
        batch_size=recipe.batch_size,
        lr=recipe.lr,
        weight_decay=recipe.weight_decay,
        schedule=recipe.schedule,
        seed=recipe.seed,
        augmentation=AugmentationParams(jitter=recipe.jitter, hue=recipe.hue),
        loss=LossParams(recipe.loss, recipe.position_weight, recipe.rotation_weight),
        eps=recipe.eps,
        position_stage=PositionStageParams(
            recipe.position_epochs, recipe.position_jitter, recipe.position_hue
        ),
    )


def _predict(
    training: Training, regressor: LoadedRegressor, name: str, scene: Scene, tick: Advance
) -> None:
    """Predict a scene's test recordings; the note that they are whole comes last."""
    folder = training.walks_folder(name)
    own = training.scenes.index(name)
    images = right = 0
    for walk in predict_walks(
        regressor, scene, scene.splits["test"], folder, training.model, tick=lambda: tick(1)
    ):
        images += len(walk.scene)
        right += int((walk.scene == own).sum())
    note = {"regressor": regressor_digest(training), "images": images, "right_scene": right}
    write_text(folder / PREDICTED_FILE, json.dumps(note) + "\n")
