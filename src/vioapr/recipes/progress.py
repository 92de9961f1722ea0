"""How far a training has come, and how much there is to do, in images."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vioapr.recipes.plan import Training
from vioapr.regression.files import REGRESSOR_FILE, STATE_FILE, note_of
from vioapr.regression.params import batches_of_epoch
from vioapr.scene.scene import Scene

PREDICTED_FILE = "predicted.json"


class Work(NamedTuple):
    """What one training still needs, in images.

    Attributes:
        train: To be decoded and learned from.
        predict: To be predicted.
        scenes: Whose predictions are not there.
    """

    train: int
    predict: int
    scenes: tuple[str, ...]

    @property
    def images(self) -> int:
        """All."""
        return self.train + self.predict


def finished_epochs(training: Training) -> int:
    """How many epochs are on disk."""
    content = _read(note_of(training.folder / STATE_FILE))
    return len(content.get("epochs", ()))


def is_trained(training: Training) -> bool:
    """Whether nothing is left to learn."""
    has_regressor = (training.folder / REGRESSOR_FILE).exists()
    return has_regressor and finished_epochs(training) >= training.recipe.all_epochs


def predicted_note(training: Training, scene: str) -> dict[str, Any] | None:
    """What was noted of a scene's predictions, if they are whole and of this regressor."""
    note = _read(training.walks_folder(scene) / PREDICTED_FILE)
    is_current = bool(note) and note.get("regressor") == regressor_digest(training)
    return note if is_current else None


def regressor_digest(training: Training) -> str:
    """Changes with the regressor; "" if there is none."""
    path = training.folder / REGRESSOR_FILE
    if not path.exists():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def work_of(training: Training, scenes: Mapping[str, Scene]) -> Work:
    """What is left of a training and its predictions."""
    members = [scenes[name] for name in training.scenes]
    learned = 0
    done = is_trained(training)
    if not done:
        images = sum(count_images(scene, "train") for scene in members)
        batch, steps = batches_of_epoch(images, training.recipe.batch_size)
        left = max(training.recipe.all_epochs - finished_epochs(training), 0)
        learned = images + left * batch * steps
    open_ = tuple(
        name for name in training.scenes if not done or predicted_note(training, name) is None
    )
    return Work(learned, sum(count_images(scenes[name], "test") for name in open_), open_)


def count_images(scene: Scene, split: str) -> int:
    """Images of a split."""
    return sum(int(scene.recording(id_).frames.has_image.sum()) for id_ in scene.splits[split])


def _read(path: Path) -> dict[str, Any]:
    """What a note says; nothing if it is missing or was cut off: then the work is done again."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
