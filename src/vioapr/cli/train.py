"""`vioapr train`: a pose regressor for one or more scenes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.console import console, progress
from vioapr.cli.torch_extra import require_torch
from vioapr.errors import ParameterError
from vioapr.recording.scene import Scene

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


def train(
    scenes: tyro.conf.Positional[tuple[Path, ...]],
    model: str = "posenet",
    out: Path | None = None,
    weights: Path | None = None,
    validation: str = "",
    epochs: int = 400,
    batch_size: int = 32,
    lr: float = 1e-4,
    weight_decay: float = 5e-4,
    schedule: Literal["constant", "cosine", "step"] = "constant",
    loss: Literal["learnable", "learnable-l2", "geometric"] = "learnable",
    position_weight: float = 0.0,
    rotation_weight: float = -3.0,
    rotation: Literal["log-quat", "quat", "6d"] = "log-quat",
    resize: int = 256,
    crop: int = 224,
    dropout: float | None = None,
    orientation_layers: int = 6,
    jitter: float = 0.5,
    hue: float = 0.1,
    turn_deg: float = 0.0,
    seed: int = 0,
    precision: Literal["auto", "fp32", "bf16"] = "auto",
    patience: int = 0,
    devices: int = 1,
    nodes: int = 1,
    compile: Flag = False,
    resume: Flag = False,
    eps: float = 1e-8,
    position_epochs: int = 0,
    position_jitter: float = 0.5,
    position_hue: float = 0.2,
) -> None:
    """Train a pose regressor on the training recordings of scenes.

    Leaves regressor.safetensors (the best epoch by the validation recordings, or else the
    last), state.safetensors (to resume from) and TensorBoard logs in the folder --out. Images
    are decoded once, into SCENE/.cache. The defaults are the paper's for PoseNet.

    Args:
        scenes: Folders of scenes with ground truth; several need --model ms-transformer.
        model: posenet (ResNet-34), ms-transformer (EfficientNet-B0), mobile
            (MobileNetV3-Large), or timm:NAME.
        out: Folder of the run; by default SCENE/models/MODEL of the first scene.
        weights: File with pretrained weights of the backbone, with torchvision's names.
        validation: Training recordings to choose the best epoch by, separated by commas; they
            are not learned from.
        epochs: Times that every image is seen.
        batch_size: Images a step.
        lr: Learning rate, the highest one if the schedule changes it.
        weight_decay: Pull of the weights to zero.
        schedule: constant; cosine: rises shortly, falls to zero; step: a tenth after every
            third.
        loss: learnable: position and rotation weighted by learned weights, L1. learnable-l2:
            the same, L2. geometric: displacement of points before the camera.
        position_weight: The learnable weight s_x at the start.
        rotation_weight: The learnable weight s_q at the start.
        rotation: How the network says a rotation: log-quat (the paper's), quat, or 6d, which
            has no jump at half turns and suits places that one sees in all directions.
        resize: Size to which images are resized, pixels.
        crop: Size of the part that the network sees, pixels.
        dropout: While training; by default the model's.
        orientation_layers: Of MS-Transformer's orientation branch: 6 outdoors, 4 indoors.
        jitter: Variation of brightness, contrast and saturation, 0 to 1.
        hue: Variation of hue, 0 to 0.5.
        turn_deg: Turn the camera by up to this angle about each axis and its pose with it,
            instead of random crops; needs known intrinsics.
        seed: Of everything random.
        precision: auto: bf16 on GPUs that have it.
        patience: Stop after so many epochs without improvement on the validation recordings.
        devices: GPUs, or processes where there is no GPU.
        nodes: Machines.
        compile: Compile the network first (torch.compile).
        resume: Go on with the run in --out, as if it had not been stopped.
        eps: Of Adam, added to the root of the gradients' mean square; MS-Transformer's code has
            1e-10.
        position_epochs: After all others, epochs in which only the position is learned, as
            MS-Transformer's code does outdoors.
        position_jitter: As jitter, in these epochs.
        position_hue: As hue, in these epochs.
    """
    require_torch("vioapr train")
    from vioapr.regression.augmentation import AugmentationParams
    from vioapr.regression.losses import LossParams
    from vioapr.regression.networks import check_model
    from vioapr.regression.params import PositionStageParams, TrainingParams, batches_of_epoch
    from vioapr.regression.preparing import choose_frames, prepare_run
    from vioapr.regression.spec import RegressorSpec
    from vioapr.regression.training import train as run_training

    if not scenes:
        raise ParameterError("SCENES: expected at least one scene's folder, got none")
    check_model(model)
    opened = [Scene.open(folder) for folder in scenes]
    spec = RegressorSpec(
        model, tuple(scene.name for scene in opened), rotation, resize, crop, dropout,
        orientation_layers,
    )  # fmt: skip
    params = TrainingParams(
        epochs, batch_size, lr, weight_decay, schedule, seed, precision, compile, patience,
        devices, nodes, AugmentationParams(jitter, hue, turn_deg),
        LossParams(loss, position_weight, rotation_weight), eps,
        PositionStageParams(position_epochs, position_jitter, position_hue),
    )  # fmt: skip
    folder = out or scenes[0] / "models" / model.replace(":", "-")
    held_out = [id_ for id_ in validation.split(",") if id_]
    frames = choose_frames(opened, held_out)
    with progress("reading images", frames.images) as tick:
        run = prepare_run(opened, frames, spec, params, folder, weights, tick)
    total = params.stages[-1].last * batches_of_epoch(len(run.samples), batch_size).count
    with progress("training", total) as tick:
        journal = run_training(run._replace(tick=tick), resume=resume)
    best = journal.epochs[journal.best]
    text = f"{len(journal.epochs)} epochs, {best['images_per_s']:.0f} images/s"
    if "validation_position_m" in best:
        text += (
            f", best epoch {journal.best + 1}: {best['validation_position_m']:.3f} m, "
            f"{best['validation_orientation_deg']:.2f} deg on the validation recordings"
        )
    console.print(text)
    console.print(f"regressor: {folder}", soft_wrap=True)
