"""`vioapr predict`: poses of a scene's images by a trained regressor."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import tyro

from vioapr.cli.console import console, progress
from vioapr.cli.torch_extra import require_torch
from vioapr.errors import ParameterError
from vioapr.recording.scene import Scene


def predict(
    scene: tyro.conf.Positional[Path],
    model: Path,
    split: Literal["train", "test", "all"] = "test",
    out: Path | None = None,
    name: str | None = None,
    batch_size: int = 32,
) -> None:
    """Predict the poses of recordings and put them where `vioapr evaluate` finds them.

    Writes OUT/RECORDING/apr_NAME.tum with apr_NAME.sigma.csv, and beside them the recording's
    ground truth and VIO.

    Args:
        scene: The scene's folder.
        model: A regressor's file, or the folder that `vioapr train` left it in.
        split: Which recordings.
        out: Folder to write to; by default SCENE/walks/SPLIT.
        name: Of the predictions' file; by default the model's.
        batch_size: Images at once.
    """
    require_torch("vioapr predict")
    import torch

    from vioapr.regression.checkpoint import load
    from vioapr.regression.prediction import predict_recording, write_prediction, write_walk

    opened = Scene.open(scene)
    ids = opened.recording_ids if split == "all" else list(opened.splits.get(split, ()))
    if not ids:
        raise ParameterError(f"{scene}: expected recordings in the split {split!r}, found none")
    regressor = load(model)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    regressor.network.to(device)
    label = name or regressor.spec.model.replace(":", "-")
    folder = out or scene / "walks" / split
    counts = {id_: int(opened.recording(id_).frames.has_image.sum()) for id_ in ids}
    has_all = True
    with progress("predicting", sum(counts.values())) as tick:
        for id_ in ids:
            poses, predicted = predict_recording(
                regressor, opened, id_, batch_size=batch_size, device=device, tick=tick
            )
            write_prediction(folder / id_, label, poses, predicted)
            has_all &= write_walk(folder / id_, opened, id_)
            if len(regressor.spec.scenes) > 1:
                _print_scenes(regressor.spec.scenes, opened.name, id_, predicted.scene)
    if opened.name not in regressor.spec.scenes:
        known = ", ".join(map(repr, regressor.spec.scenes))
        console.print(
            f"note: {opened.name!r} is none of the scenes that this regressor knows: {known}",
            soft_wrap=True,
        )
    console.print(f"predictions: {folder}", soft_wrap=True)
    if has_all:
        console.print(f"evaluate them: vioapr evaluate {folder}", soft_wrap=True)


def _print_scenes(scenes: tuple[str, ...], own: str, id_: str, seen) -> None:
    """Which scene the network saw, if it knows this one."""
    if own in scenes:
        share = 100 * float((seen == scenes.index(own)).mean())
        console.print(f"{id_}: {share:.1f} % of images taken for {own!r}")
