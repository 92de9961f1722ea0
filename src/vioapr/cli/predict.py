"""`vioapr predict`: poses of a scene's images by a trained regressor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import tyro

from vioapr.cli.console import progress, say
from vioapr.cli.torch_extra import require_torch
from vioapr.errors import ParameterError
from vioapr.scene.gt_origin import digest_of
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE


def predict(
    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    model: Path,
    split: Literal["train", "test", "all"] = "test",
    out: Path | None = None,
    name: str | None = None,
    batch_size: int = 32,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Predict the poses of recordings and put them where `vioapr evaluate` finds them.

    Writes OUT/RECORDING/apr_NAME.tum with apr_NAME.sigma.csv, and beside them the recording's
    ground truth and VIO. Predictions that are there by the same model of the same images are kept,
    so a run that was stopped goes on.

    Args:
        scene: The scene's folder.
        model: A regressor's file, or the folder that `vioapr train` left it in.
        split: Which recordings.
        out: Folder to write to; by default SCENE/walks/SPLIT.
        name: Of the predictions' file; by default the model's.
        batch_size: Images at once.
        overwrite: Replace predictions of the same name by another model, and files that vioapr did
            not write.

    Example:
        vioapr predict courtyard --model courtyard/models/efficientnet-lite0
    """
    done = predict_split(scene, model, split, out, name, batch_size=batch_size, overwrite=overwrite)
    say(f"predictions: {done.folder}")
    if done.can_be_evaluated:
        say(f"evaluate them: vioapr evaluate {done.folder}")


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
) -> PredictedSplit:
    """Predict recordings of a split; see `predict`."""
    require_torch("vioapr predict")
    from vioapr.regression.prediction import load_predictor, predict_walks

    opened = Scene.open(scene)
    ids = opened.recording_ids if split == "all" else list(opened.splits.get(split, ()))
    if not ids:
        raise ParameterError(f"{scene}: expected recordings in the split {split!r}, found none")
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
