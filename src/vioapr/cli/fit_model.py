"""`vioapr train --model retrieval|points`: what is fitted to training images, not trained."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vioapr.cli.console import progress, say
from vioapr.errors import AlreadyExistsError, ParameterError
from vioapr.regression.model_card import describe_fitted
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE
from vioapr.work.locks import locked_folder


def fit_model(
    model: str,
    scenes: Sequence[Scene],
    folder: Path,
    validation: Sequence[str],
    *,
    size_mb: float | None = None,
    resize: int | None = None,
    weights: Path | None = None,
) -> None:
    """Fit a model to a scene's training images, and say how far off it is.

    Args:
        model: Retrieval or points.
        scenes: One.
        folder: Of the regressor; none may be in it.
        validation: Ids of training recordings that are left out of it.
        size_mb: The largest index or map, MB; None for the model's own, as the following.
        resize: Size to which images are squeezed, pixels.
        weights: File of the backbone's weights.

    Raises:
        AlreadyExistsError: There is a regressor or a training in the folder.
        ParameterError: Several scenes.
        VioAprError: See `fit_retrieval` and `fit_points`.
    """
    from vioapr.regression.checkpoint import save_regressor
    from vioapr.regression.fitting import FitOptions, prepare_fit
    from vioapr.regression.run import choose_frames

    if len(scenes) != 1:
        raise ParameterError(
            f"scenes: expected one, which is all that model {model} can know, got {len(scenes)}"
        )
    frames = choose_frames(scenes, validation)
    fit = prepare_fit(model, scenes[0].name, frames, FitOptions(size_mb, resize, weights))
    with locked_folder(folder):
        for name in (REGRESSOR_FILE, STATE_FILE):
            if (folder / name).exists():
                raise AlreadyExistsError(folder / name, "exists: name another folder by `out`")
        with progress("looking at images", fit.images) as tick:
            fitted = fit.run(tick)
        save_regressor(folder / REGRESSOR_FILE, fitted.network, fitted.spec, fitted.trained)
    for line in describe_fitted(fitted.spec, fitted.trained):
        say(line)
    say(f"regressor: {folder}")
