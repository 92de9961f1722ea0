"""Doing the work of a training: learning, and predicting the test recordings."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count

from vioapr.files.text import write_text
from vioapr.recipes.trainings import (
    PREDICTED_FILE,
    Training,
    finished_epochs,
    is_trained,
    regressor_digest,
    work_of,
)
from vioapr.regression.params import batches_of_epoch
from vioapr.regression.prediction import load_predictor, predict_walks
from vioapr.regression.run import choose_frames, prepare_run
from vioapr.regression.training import train
from vioapr.scene.scene import Scene
from vioapr.schemas.base import encode
from vioapr.schemas.regressor import STATE_FILE
from vioapr.schemas.reproduction import PredictionNote
from vioapr.work.progress import Advance


def run_training(training: Training, scenes: Mapping[str, Scene], tick: Advance) -> None:
    """Train and predict all that is not there yet.

    Args:
        training: Which.
        scenes: All scenes by name.
        tick: Called with a number of images, `work_of(...).images` in all.

    Raises:
        VioAprError: A scene, checkpoint or weights are broken, or training went wrong.
    """
    if not is_trained(training):
        learn(training, [scenes[name] for name in training.scenes], tick)
    open_scenes = work_of(training, scenes).scenes
    regressor = load_predictor(training.folder) if open_scenes else None
    for name in open_scenes:
        assert regressor is not None
        folder, scene = training.walks_folder(name), scenes[name]
        images = right = 0
        for walk in predict_walks(
            regressor,
            scene,
            scene.splits["test"],
            folder,
            training.model,
            overwrite=True,
            tick=lambda: tick(1),
        ):
            images += len(walk.scene)
            right += int((walk.scene == training.scenes.index(name)).sum())
        # Last, as it says that the predictions are whole.
        note = PredictionNote(regressor_digest(training), images, right)
        write_text(folder / PREDICTED_FILE, encode(note, indent=None))


def learn(training: Training, scenes: list[Scene], tick: Advance) -> None:
    """Train a network, from its state if there is one.

    Args:
        training: Which.
        scenes: Those that it learns, in order.
        tick: Called with a number of images that were decoded or learned from.

    Raises:
        VioAprError: A scene, checkpoint or weights are broken, or training went wrong.
    """
    spec, params = training.configuration
    run = prepare_run(
        scenes, choose_frames(scenes), spec, params, training.folder, training.weights,
        lambda: tick(1),
    )  # fmt: skip
    batch, steps = batches_of_epoch(len(run.samples), params.batch_size)
    # The steps of a resumed training's finished epochs tick too, and are no work that is left.
    begun, step = finished_epochs(training) * steps, count()
    run = run._replace(tick=lambda: tick(batch) if next(step) >= begun else None)
    train(run, resume=(training.folder / STATE_FILE).exists())
