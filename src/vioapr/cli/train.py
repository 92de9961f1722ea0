"""`vioapr train`: a pose regressor for one or more scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.console import is_watched, log, progress, say
from vioapr.cli.fit_model import fit_model
from vioapr.cli.flags import split_names
from vioapr.cli.torch_extra import require_torch
from vioapr.cli.training_lines import TrainingLines
from vioapr.errors import ParameterError
from vioapr.plurals import count_of
from vioapr.regression.params import TrainingParams, batches_of_epoch
from vioapr.regression.pretrained import FITTED, LITE0, POINTS, RETRIEVAL, has_pretrained
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import RegressorSpec

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


def train(
    scenes: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[SCENE ...]")],
    model: str | None = None,
    out: Path | None = None,
    weights: Path | None = None,
    validation: str = "",
    rotation: Literal["log-quat", "quat", "6d"] = "log-quat",
    resize: int | None = None,
    crop: int | None = None,
    dropout: float | None = None,
    orientation_layers: int = 6,
    index_mb: float | None = None,
    map_mb: float | None = None,
    resume: Flag = False,
    params: tyro.conf.OmitArgPrefixes[
        tyro.conf.FlagCreatePairsOff[TrainingParams]
    ] = TrainingParams(),  # noqa: B008
) -> None:
    """Train a pose regressor on the training recordings of scenes.

    Leaves regressor.safetensors (the best epoch by the validation recordings, or else the
    last) with a model card, state.safetensors (to resume from) and TensorBoard logs in the folder
    --out. Images are decoded once, into SCENE/.cache. The other defaults are the paper's for
    PoseNet.

    Args:
        scenes: Folders of scenes with ground truth; several need --model ms-transformer.
        model: efficientnet-lite0 (pretrained on ImageNet), posenet (ResNet-34), ms-transformer
            (EfficientNet-B0), mobile (MobileNetV3-Large), or timm:NAME. By default
            efficientnet-lite0 where its weights are installed (extra `pretrained`), else posenet.
            Two are not trained but fitted: retrieval, in seconds, looks up the most similar
            images; points, in a minute or more, solves for the pose by points of the map, to
            centimetres where it sees them, and else answers as retrieval does (extra `points`).
        out: Folder of the run; by default SCENE/models/MODEL of the first scene.
        weights: File with pretrained weights of the backbone, with torchvision's names;
            efficientnet-lite0 has its own.
        validation: Training recordings to choose the best epoch by, separated by commas; they
            are not learned from. They calibrate the uncertainties, too.
        rotation: How the network says a rotation: log-quat (the paper's), quat, or 6d, which
            has no jump at half turns and suits places that one sees in all directions.
        resize: Size to which images are resized, pixels: by default 256, for retrieval 128, for
            points 288.
        crop: Size of the part that the network sees, pixels: by default 224, or all.
        dropout: While training; by default the model's.
        orientation_layers: Of MS-Transformer's orientation branch: 6 outdoors, 4 indoors.
        index_mb: Of retrieval: the largest index, MB; by default 4, which holds some 7,000 images.
            Where there are more, those that are least like each other are kept.
        map_mb: Of points: the largest map, MB; by default 8, which holds some 400 images.
        resume: Go on with the run in --out, as if it had not been stopped.
        params: How it is trained.

    Example:
        vioapr train courtyard --epochs 100 --out run
    """
    require_torch("vioapr train")
    from vioapr.regression.networks import check_model
    from vioapr.regression.run import choose_frames, prepare_run
    from vioapr.regression.training import train as run_training

    if not scenes:
        raise ParameterError("scenes: expected at least one scene's folder, got none")
    if model is None:
        model = LITE0 if has_pretrained() else "posenet"
        say(f"model: {model}")
    check_model(model)
    opened = [Scene.open(folder) for folder in scenes]
    folder = out or scenes[0] / "models" / model.replace(":", "-")
    for size_mb, name, owner in ((index_mb, "index_mb", RETRIEVAL), (map_mb, "map_mb", POINTS)):
        if size_mb is not None and model != owner:
            raise ParameterError(f"{name}: expected with `model` {owner} only, got {model}")
    if model in FITTED:
        others = (rotation, crop, dropout, orientation_layers, resume, params)
        if others != ("log-quat", None, None, 6, False, TrainingParams()):
            raise ParameterError(
                f"model {model} is not trained: expected no other parameters than `out`, "
                "`weights`, `validation`, `resize`, `index_mb` and `map_mb`"
            )
        size_mb = index_mb if map_mb is None else map_mb
        held_out = split_names(validation)
        fit_model(model, opened, folder, held_out, size_mb=size_mb, resize=resize, weights=weights)
        return
    names = tuple(scene.name for scene in opened)
    size, part = 256 if resize is None else resize, 224 if crop is None else crop
    spec = RegressorSpec(model, names, rotation, size, part, dropout, orientation_layers)
    frames = choose_frames(opened, split_names(validation))
    with progress("reading images", frames.images) as tick:
        run = prepare_run(opened, frames, spec, params, folder, weights, tick)
    epochs = params.stages[-1].last
    if is_watched():
        steps = epochs * batches_of_epoch(len(run.samples), params.batch_size).count
        with progress("training", steps) as tick:
            journal = run_training(run._replace(tick=tick), resume=resume)
    else:
        journal = run_training(run._replace(watch=TrainingLines(epochs, log)), resume=resume)
    best = journal.epochs[journal.best]
    text = f"{count_of(len(journal.epochs), 'epoch')}, {best.images_per_s:.0f} images/s"
    if best.validation_position_m is not None:
        text += (
            f", best epoch {journal.best + 1}: {best.validation_position_m:.3f} m, "
            f"{best.validation_orientation_deg:.2f} deg on the validation recordings"
        )
    say(text)
    say(f"regressor: {folder}")
