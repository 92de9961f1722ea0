"""`vioapr train --model retrieval|points`: what is fitted to training images, not trained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from vioapr.cli.console import progress, say
from vioapr.errors import AlreadyExistsError, ParameterError
from vioapr.regression.model_card import describe_fitted
from vioapr.regression.pretrained import POINTS
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE
from vioapr.work.locks import locked_folder

if TYPE_CHECKING:
    from vioapr.regression.retrieval import Fitted
    from vioapr.regression.run import ChosenFrames


class FitOptions(NamedTuple):
    """What may be asked of a fit; None for the model's own.

    Attributes:
        size_mb: The largest index or map, MB.
        resize: Size to which images are squeezed, pixels.
        weights: File of the backbone's weights.
    """

    size_mb: float | None = None
    resize: int | None = None
    weights: Path | None = None


def fit_model(
    model: str,
    scenes: Sequence[Scene],
    folder: Path,
    validation: Sequence[str],
    options: FitOptions,
) -> None:
    """Fit a model to a scene's training images, and say how far off it is.

    Args:
        model: Retrieval or points.
        scenes: One.
        folder: Of the regressor; none may be in it.
        validation: Ids of training recordings that are left out of it.
        options: See there.

    Raises:
        AlreadyExistsError: There is a regressor or a training in the folder.
        ParameterError: Several scenes.
        VioAprError: See `fit_retrieval` and `fit_points`.
    """
    from vioapr.regression.checkpoint import save_regressor
    from vioapr.regression.run import choose_frames

    if len(scenes) != 1:
        raise ParameterError(
            f"scenes: expected one, which is all that model {model} can know, got {len(scenes)}"
        )
    frames = choose_frames(scenes, validation)
    images, fit = _prepare(model, scenes[0].name, frames, options)
    with locked_folder(folder):
        for name in (REGRESSOR_FILE, STATE_FILE):
            if (folder / name).exists():
                raise AlreadyExistsError(folder / name, "exists: name another folder by `out`")
        with progress("looking at images", images) as tick:
            fitted = fit(tick)
        save_regressor(folder / REGRESSOR_FILE, fitted.network, fitted.spec, fitted.trained)
    for line in describe_fitted(fitted.spec, fitted.trained):
        say(line)
    say(f"regressor: {folder}")


def _prepare(
    model: str, scene: str, frames: ChosenFrames, options: FitOptions
) -> tuple[int, Callable[[Callable[[], object]], Fitted]]:
    """How many images will be looked at, and what looks at them, ticking after each."""
    if model == POINTS:
        from vioapr.regression.points import fit

        if options.weights is not None:
            raise ParameterError(f"weights: model {POINTS} has its own, pinned by their hash")
        plan = fit.plan_points(frames, fit.MAP_MB if options.size_mb is None else options.size_mb)
        size = fit.IMAGE_SIZE if options.resize is None else options.resize
        return plan.images, lambda tick: fit.fit_points(scene, plan, image_size=size, tick=tick)
    from vioapr.regression import retrieval

    index_mb = retrieval.INDEX_MB if options.size_mb is None else options.size_mb
    size = retrieval.IMAGE_SIZE if options.resize is None else options.resize
    thinned = retrieval.thin_frames(frames, index_mb)
    return thinned.images, lambda tick: retrieval.fit_retrieval(
        scene, thinned, index_mb=index_mb, image_size=size, weights=options.weights, tick=tick
    )
