"""`vioapr train`: a pose regressor for one or more scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.console import is_watched, log, progress, say
from vioapr.cli.flags import split_names
from vioapr.cli.torch_extra import require_torch
from vioapr.cli.training_lines import TrainingLines
from vioapr.errors import ParameterError
from vioapr.plurals import count_of
from vioapr.regression.params import TrainingParams, batches_of_epoch
from vioapr.regression.pretrained import LITE0, has_pretrained
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
    resize: int = 256,
    crop: int = 224,
    dropout: float | None = None,
    orientation_layers: int = 6,
    resume: Flag = False,
    params: tyro.conf.OmitArgPrefixes[
        tyro.conf.FlagCreatePairsOff[TrainingParams]
    ] = TrainingParams(),  # noqa: B008
) -> None:
    """Train a pose regressor on the training recordings of scenes.

    Leaves regressor.safetensors (the best epoch by the validation recordings, or else the
    last), state.safetensors (to resume from) and TensorBoard logs in the folder --out. Images
    are decoded once, into SCENE/.cache. The other defaults are the paper's for PoseNet.

    Args:
        scenes: Folders of scenes with ground truth; several need --model ms-transformer.
        model: efficientnet-lite0 (pretrained on ImageNet), posenet (ResNet-34), ms-transformer
            (EfficientNet-B0), mobile (MobileNetV3-Large), or timm:NAME. By default
            efficientnet-lite0 where its weights are installed (extra `pretrained`), else posenet.
        out: Folder of the run; by default SCENE/models/MODEL of the first scene.
        weights: File with pretrained weights of the backbone, with torchvision's names;
            efficientnet-lite0 has its own.
        validation: Training recordings to choose the best epoch by, separated by commas; they
            are not learned from.
        rotation: How the network says a rotation: log-quat (the paper's), quat, or 6d, which
            has no jump at half turns and suits places that one sees in all directions.
        resize: Size to which images are resized, pixels.
        crop: Size of the part that the network sees, pixels.
        dropout: While training; by default the model's.
        orientation_layers: Of MS-Transformer's orientation branch: 6 outdoors, 4 indoors.
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
    names = tuple(scene.name for scene in opened)
    spec = RegressorSpec(model, names, rotation, resize, crop, dropout, orientation_layers)
    folder = out or scenes[0] / "models" / model.replace(":", "-")
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
