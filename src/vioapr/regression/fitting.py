"""The models that are fitted instead of trained, behind one door."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from vioapr.errors import ParameterError
from vioapr.regression import retrieval
from vioapr.regression.points import fit as points
from vioapr.regression.pretrained import POINTS
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


class PreparedFit(NamedTuple):
    """A fit that can begin.

    Attributes:
        images: How often an image will be looked at.
        run: Fits, and calls what it is given after every image.
    """

    images: int
    run: Callable[[Callable[[], object]], Fitted]


def prepare_fit(
    model: str,
    scene: str,
    frames: ChosenFrames,
    options: FitOptions = FitOptions(),  # noqa: B008
) -> PreparedFit:
    """Prepare to fit a model to a scene's images.

    Args:
        model: Retrieval or points.
        scene: The scene's name.
        frames: Of `choose_frames`.
        options: See there.

    Raises:
        VioAprError: See `fit_retrieval` and `plan_points`.
    """
    if model == POINTS:
        if options.weights is not None:
            raise ParameterError(f"weights: model {POINTS} has its own, pinned by their hash")
        map_mb = points.MAP_MB if options.size_mb is None else options.size_mb
        plan = points.plan_points(frames, map_mb)
        size = points.IMAGE_SIZE if options.resize is None else options.resize
        return PreparedFit(
            plan.images, lambda tick: points.fit_points(scene, plan, image_size=size, tick=tick)
        )
    index_mb = retrieval.INDEX_MB if options.size_mb is None else options.size_mb
    size = retrieval.IMAGE_SIZE if options.resize is None else options.resize
    thinned = retrieval.thin_frames(frames, index_mb)
    return PreparedFit(
        thinned.images,
        lambda tick: retrieval.fit_retrieval(
            scene, thinned, index_mb=index_mb, image_size=size, weights=options.weights, tick=tick
        ),
    )
