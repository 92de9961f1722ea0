"""Fitting a regressor to a scene, from where a killed run was."""

from __future__ import annotations

import shutil
from pathlib import Path

from vioapr.recipes.build.params import BuildParams
from vioapr.regression.params import TrainingParams, batches_of_epoch
from vioapr.regression.pretrained import FITTED
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE, RegressorSpec
from vioapr.work.progress import Progress


def fit(
    scene: Scene,
    params: BuildParams,
    model: str,
    folder: Path,
    progress: Progress,
    *,
    is_resumed: bool,
) -> None:
    """Fit a regressor to a scene's training recordings.

    Args:
        scene: With ground truth.
        params: How long, and at which size.
        model: The regressor, as `vioapr train` calls it.
        folder: Of the run.
        progress: See `vioapr.work.progress`.
        is_resumed: Whether what is in the folder is of the same scene and parameters.

    Raises:
        VioAprError: The scene or the parameters are not fit for training.
    """
    from vioapr.regression.networks import check_model
    from vioapr.regression.run import choose_frames, prepare_run
    from vioapr.regression.training import train

    if not is_resumed and folder.exists():
        shutil.rmtree(folder)
    check_model(model)
    if model in FITTED:
        _fit_at_once(scene, model, folder, progress)
        return
    spec = RegressorSpec(model, (scene.name,), resize=params.resize, crop=params.crop)
    training = TrainingParams(epochs=params.epochs, seed=params.seed)
    frames = choose_frames([scene])
    with progress("reading images", frames.images) as tick:
        run = prepare_run([scene], frames, spec, training, folder, None, tick)
    steps = params.epochs * batches_of_epoch(len(run.samples), training.batch_size).count
    with progress(f"training {model}", steps) as tick:
        train(run._replace(tick=tick), resume=(folder / STATE_FILE).exists())


def _fit_at_once(scene: Scene, model: str, folder: Path, progress: Progress) -> None:
    """Fit a model that is not trained; a killed one begins again, which takes minutes at most."""
    from vioapr.regression.checkpoint import save_regressor
    from vioapr.regression.fitting import prepare_fit
    from vioapr.regression.run import choose_frames

    fit = prepare_fit(model, scene.name, choose_frames([scene]))
    with progress(f"fitting {model}", fit.images) as tick:
        fitted = fit.run(tick)
    folder.mkdir(parents=True, exist_ok=True)
    save_regressor(folder / REGRESSOR_FILE, fitted.network, fitted.spec, fitted.trained)
