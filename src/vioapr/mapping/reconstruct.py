"""Structure from motion: camera poses and points, in a world of unknown scale and direction."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vioapr.errors import MappingError, UnwritableError
from vioapr.mapping.colmap import load_pycolmap, translated_errors
from vioapr.mapping.params import MappingParams
from vioapr.work.progress import Tick

MIN_MODEL_IMAGES = 3
MAX_MODELS = 10
INIT_TRIALS = 50
"""Of starting pairs; COLMAP's 200 cost minutes where left-over images fit nowhere."""


def reconstruct(
    database: Path,
    image_folder: Path,
    names: Sequence[str],
    folder: Path,
    params: MappingParams,
    *,
    refines_intrinsics: bool,
    tick: Tick,
) -> list[list[str]]:
    """Make a model of the given images and write it.

    Args:
        database: With features and verified matches; other images in it play no part.
        image_folder: What the names are relative to.
        names: The images.
        folder: Where the model is written; what is there is replaced.
        params: Which mapper, threads, seed.
        refines_intrinsics: Whether focal lengths and distortion are adjusted.
        tick: Called once for every image that the incremental mapper registers.

    Returns:
        Names of the registered images of every model found, the largest first; that one is
        written.

    Raises:
        MappingError: No model could be made.
    """
    scratch = folder.with_name(f"{folder.name}.scratch")
    for old in (scratch, folder):
        shutil.rmtree(old, ignore_errors=True)
    _make_folders(scratch, folder)
    run = _run_incremental if params.mapper == "incremental" else _run_global
    with translated_errors(folder):
        models = run(database, image_folder, names, scratch, params, refines_intrinsics, tick)
        models = sorted(models.values(), key=lambda model: -model.num_reg_images())
        if not models:
            raise MappingError(
                f"no map could be made of {len(names)} images: too few see the same things. "
                "Walk more slowly, so that images overlap, or take more of them"
            )
        models[0].write(folder)
    shutil.rmtree(scratch, ignore_errors=True)
    return [sorted(registered_images(model)) for model in models]


def registered_images(model: Any) -> dict[str, Any]:
    """The images of a model that have a pose, by name."""
    return {image.name: image for image in model.images.values() if image.has_pose}


def _run_incremental(
    database: Path,
    image_folder: Path,
    names: Sequence[str],
    scratch: Path,
    params: MappingParams,
    refines: bool,
    tick: Tick,
) -> dict[int, Any]:
    pycolmap = load_pycolmap()
    options = _with_common(pycolmap.IncrementalPipelineOptions(), names, params)
    options.max_num_models = MAX_MODELS
    options.init_num_trials = INIT_TRIALS
    # Placing images by two-view geometries alone, where too few points are known, is not exact
    # enough for ground truth (docs/mapping.md).
    options.structure_less_registration_fallback = False
    options.ba_refine_focal_length = options.ba_refine_extra_params = refines
    options.mapper.abs_pose_refine_focal_length = refines
    options.mapper.abs_pose_refine_extra_params = refines
    return pycolmap.incremental_mapping(
        database, image_folder, scratch, options, next_image_callback=tick
    )


def _run_global(
    database: Path,
    image_folder: Path,
    names: Sequence[str],
    scratch: Path,
    params: MappingParams,
    refines: bool,
    tick: Tick,
) -> dict[int, Any]:
    pycolmap = load_pycolmap()
    options = _with_common(pycolmap.GlobalPipelineOptions(), names, params)
    options.mapper.bundle_adjustment.refine_focal_length = refines
    options.mapper.bundle_adjustment.refine_extra_params = refines
    models = pycolmap.global_mapping(database, image_folder, scratch, options)
    for _ in names:
        tick()
    return models


def _with_common(options: Any, names: Sequence[str], params: MappingParams) -> Any:
    """What both mappers are told."""
    options.image_names = list(names)
    options.num_threads = params.threads
    options.random_seed = params.seed
    options.min_model_size = MIN_MODEL_IMAGES
    return options


def _make_folders(*folders: Path) -> None:
    for folder in folders:
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise UnwritableError.of(folder, error) from None
