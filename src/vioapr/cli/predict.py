"""`vioapr predict`: poses of a scene's images by a trained regressor, or in the scene's map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tyro

from vioapr.cli.console import progress, say
from vioapr.cli.torch_extra import require_torch
from vioapr.errors import ParameterError
from vioapr.files.digests import digest_of
from vioapr.mapping.localization.params import PointMapParams
from vioapr.plurals import count_of
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE

MAP_MODEL = "map"
"""The model that is no file: the scene's map."""


def predict(
    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    model: Path,
    split: Literal["train", "test", "all"] = "test",
    out: Path | None = None,
    name: str | None = None,
    batch_size: int = 32,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    point_map: tyro.conf.OmitArgPrefixes[PointMapParams] = PointMapParams(),  # noqa: B008
) -> None:
    """Predict the poses of recordings and put them where `vioapr evaluate` finds them.

    Writes OUT/RECORDING/apr_NAME.tum with apr_NAME.sigma.csv, and beside them the recording's
    ground truth and VIO. Predictions that are there by the same model of the same images are kept,
    so a run that was stopped goes on.

    Args:
        scene: The scene's folder.
        model: A regressor's file, or the folder that `vioapr train` left it in. Or the word map: no
            regressor, but the points of the scene's map, matched and solved for each image (needs
            the extra mapping; slow, exact to centimetres). It is kept in SCENE/models/map.
        split: Which recordings.
        out: Folder to write to; by default SCENE/walks/SPLIT.
        name: Of the predictions' file; by default the model's.
        batch_size: Images at once, for a regressor.
        overwrite: Replace predictions of the same name by another model, and files that vioapr did
            not write.
        point_map: With --model map, what images are localized in.

    Example:
        vioapr predict courtyard --model courtyard/models/efficientnet-lite0
        vioapr predict courtyard --model map
    """
    done = predict_split(
        scene, model, split, out, name,
        batch_size=batch_size, overwrite=overwrite, point_map=point_map,
    )  # fmt: skip
    say(f"predictions: {done.folder}")
    if done.can_be_evaluated:
        say(f"evaluate them: vioapr evaluate {done.folder}")


def is_map_word(model: Path) -> bool:
    """Whether a model is the word that stands for the scene's map, and no regressor's folder."""
    return model == Path(MAP_MODEL) and not (model / REGRESSOR_FILE).exists()


class PredictedSplit(NamedTuple):
    """Predictions of a split's recordings.

    Attributes:
        folder: Of their walks.
        name: Of the predictions in it.
        can_be_evaluated: Whether every walk has ground truth and VIO too.
    """

    folder: Path
    name: str
    can_be_evaluated: bool


def predict_split(
    scene: Path,
    model: Path,
    split: str,
    out: Path | None = None,
    name: str | None = None,
    *,
    batch_size: int = 32,
    overwrite: bool = False,
    point_map: PointMapParams | None = None,
) -> PredictedSplit:
    """Predict recordings of a split; see `predict`."""
    if is_map_word(model):
        return localize_split(scene, split, out, name, point_map, overwrite=overwrite)
    if point_map not in (None, PointMapParams()):
        raise ParameterError("`map`, `map_images` and `max_rate_hz` go with model map")
    require_torch("vioapr predict")
    from vioapr.regression.prediction import load_predictor, predict_walks

    opened = Scene.open(scene)
    ids = ids_of_split(opened, split)
    regressor = load_predictor(model)
    known = regressor.spec.scenes
    label = name or regressor.spec.model.replace(":", "-")
    folder = out or scene / "walks" / split
    images = sum(int(opened.recording(id_).frames.has_image.sum()) for id_ in ids)
    has_all = True
    with progress("predicting", images) as tick:
        for walk in predict_walks(
            regressor, opened, ids, folder, label,
            digest=digest_of(model / REGRESSOR_FILE if model.is_dir() else model),
            overwrite=overwrite, batch_size=batch_size, tick=tick,
        ):  # fmt: skip
            has_all &= walk.can_be_evaluated
            if walk.is_kept:
                say(f"{walk.id}: predicted before by this model, kept")
                continue
            if len(known) > 1 and opened.name in known:
                share = 100 * float((walk.scene == known.index(opened.name)).mean())
                say(f"{walk.id}: {share:.1f} % of images taken for {opened.name!r}")
    if opened.name not in known:
        say(
            f"note: {opened.name!r} is none of the scenes that this regressor knows: "
            f"{', '.join(map(repr, known))}"
        )
    return PredictedSplit(folder, label, has_all)


def localize_split(
    scene: Path,
    split: str,
    out: Path | None,
    name: str | None,
    point_map: PointMapParams | None,
    *,
    overwrite: bool,
) -> PredictedSplit:
    """Localize recordings of a split in the points of a map; see `predict`."""
    from vioapr.mapping.localization.prediction import localize_walks
    from vioapr.mapping.localization.scene_map import open_point_map

    opened = Scene.open(scene)
    ids = ids_of_split(opened, split)
    place = open_point_map(opened, point_map, progress)
    header = place.header
    say(
        f"localizing in {header.source}: {count_of(len(header.names), 'image')}, "
        f"{count_of(len(place.points_m), 'point')}"
    )
    label, folder = name or MAP_MODEL, out or scene / "walks" / split
    images = sum(int(opened.recording(id_).frames.has_image.sum()) for id_ in ids)
    has_all = True
    with progress("localizing", images) as tick:
        for walk in localize_walks(
            place, opened, ids, folder, label, overwrite=overwrite, tick=tick
        ):
            has_all &= walk.can_be_evaluated
            if walk.is_kept:
                say(f"{walk.id}: localized before in this map, kept")
                continue
            tilted = f"; {walk.tilted} refused, as up is elsewhere by VIO" if walk.tilted else ""
            say(f"{walk.id}: {walk.localized} of {walk.images} images localized{tilted}")
    return PredictedSplit(folder, label, has_all)


def ids_of_split(scene: Scene, split: str) -> list[str]:
    """Recordings of a split, or all; at least one.

    Raises:
        ParameterError: There is none.
    """
    ids = scene.recording_ids if split == "all" else scene.splits.get(split, ())
    if not ids:
        where = f"{scene.folder}: expected recordings in the split {split!r}"
        raise ParameterError(f"{where}, found none")
    return list(ids)
