"""The simulated box as regression sees it: a small network learns it in seconds."""

from __future__ import annotations

from pathlib import Path

from vioapr.regression.params import TrainingParams
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import RegressorSpec
from vioapr.simulation.rooms import make_box_scene


def make_scene(folder: Path, *, name: str = "Box", **recordings: int) -> Scene:
    """A scene with recordings train-1, ... and test-1, ...; all but the usual box are darker."""
    brightness = 1.0 if name == "Box" else 0.5
    return make_box_scene(folder, name=name, brightness=brightness, **recordings)


def spec(model: str = "mobile", **values) -> RegressorSpec:
    """Of a network that sees 32 pixels."""
    defaults: dict = {"scenes": ("Box",), "resize": 36, "crop": 32, "rotation": "6d"}
    return RegressorSpec(model, **{**defaults, **values})


def params(**values) -> TrainingParams:
    """Of a short run."""
    return TrainingParams(**{"epochs": 2, "batch_size": 16, "lr": 1e-3, **values})
