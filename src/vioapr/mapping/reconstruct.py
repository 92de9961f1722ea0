"""Structure from motion: camera poses and points, in a world of unknown scale and direction."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from vioapr.errors import MappingError, UnwritableError
from vioapr.mapping.colmap import load_pycolmap, registered_images, translated_errors
from vioapr.mapping.params import MappingParams
from vioapr.plurals import count_of
from vioapr.schemas.base import Record
from vioapr.work.progress import Tick

MIN_MODEL_IMAGES = 3
MAX_MODELS = 10
INIT_TRIALS = 50
"""Of starting pairs; COLMAP's 200 cost minutes where left-over images fit nowhere."""


class Models(Record, frozen=True):
    """What structure from motion made.

    Attributes:
        names: Names of the images of every model, the largest first; that one is kept.
        mapper: Which mapper made it.
        vio_fault: What spoke against the model from VIO, "" if none was made or it was taken.
    """

    names: list[list[str]]
    mapper: str
    vio_fault: str = ""


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
        UnwritableError: The folder cannot be made.
    """
    pycolmap = load_pycolmap()
    is_incremental = params.mapper != "global"
    if is_incremental:
        options = pycolmap.IncrementalPipelineOptions()
        options.max_num_models = MAX_MODELS
        options.init_num_trials = INIT_TRIALS
        # Placing images by two-view geometries alone, where too few points are known, is not
        # exact enough for ground truth (docs/design/mapping.md).
        options.structure_less_registration_fallback = False
        options.ba_refine_focal_length = options.ba_refine_extra_params = refines_intrinsics
        options.mapper.abs_pose_refine_focal_length = refines_intrinsics
        options.mapper.abs_pose_refine_extra_params = refines_intrinsics
    else:
        options = pycolmap.GlobalPipelineOptions()
        options.mapper.bundle_adjustment.refine_focal_length = refines_intrinsics
        options.mapper.bundle_adjustment.refine_extra_params = refines_intrinsics
    options.image_names = list(names)
    options.num_threads = params.threads
    options.random_seed = params.seed
    options.min_model_size = MIN_MODEL_IMAGES

    scratch = folder.with_name(f"{folder.name}.scratch")
    for each in (scratch, folder):
        shutil.rmtree(each, ignore_errors=True)
        try:
            each.mkdir(parents=True)
        except OSError as error:
            raise UnwritableError.of(each, error) from None
    with translated_errors(folder):
        if is_incremental:
            found = pycolmap.incremental_mapping(
                database, image_folder, scratch, options, next_image_callback=tick
            )
        else:
            found = pycolmap.global_mapping(database, image_folder, scratch, options)
            for _ in names:
                tick()
        models = sorted(found.values(), key=lambda model: -model.num_reg_images())
        if not models:
            raise MappingError(
                f"no map could be made of {count_of(len(names), 'image')}: too few see the same "
                "things. Walk more slowly, so that images overlap, or take more of them"
            )
        models[0].write(folder)
    shutil.rmtree(scratch, ignore_errors=True)
    return [sorted(registered_images(model)) for model in models]
