"""The trainings of a reproduction: their settings, their folders, and how far each has come.

Nothing is done twice. A training's state says how many epochs are done, and a note beside its
predictions which regressor made them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from vioapr.errors import FileMissingError, ParameterError, VioAprError
from vioapr.files.digests import digest_of
from vioapr.files.text import read_text, write_text
from vioapr.recipes.datasets import DataSet
from vioapr.recipes.paper import Configuration, as_published, differences
from vioapr.regression.params import batches_of_epoch
from vioapr.scene.scene import Scene
from vioapr.schemas.base import RecordType, decode, encode, to_plain
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE, StateHeader, note_of
from vioapr.schemas.reproduction import Place, PredictionNote, TrainingSettings
from vioapr.work.steps import describe_changes

SCENES_FOLDER, TRAININGS_FOLDER, WALKS_FOLDER = "scenes", "trainings", "walks"
SETTINGS_FILE, PREDICTED_FILE = "settings.json", "predicted.json"


@dataclass(frozen=True)
class Training:
    """One network to be trained.

    Attributes:
        folder: Where its checkpoints, and in `walks/` its predictions, go.
        configuration: The network, and how it is trained.
        weights: File of the backbone's first weights, or None.
        differences: In what this is not as published.
    """

    folder: Path
    configuration: Configuration
    weights: Path | None
    differences: tuple[str, ...]

    @property
    def model(self) -> str:
        """The network's name, a key of `MODELS`."""
        return self.configuration.spec.model

    @property
    def scenes(self) -> tuple[str, ...]:
        """Names of the scenes that it learns, in order."""
        return self.configuration.spec.scenes

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.model} {self.folder.name}"

    @property
    def settings(self) -> TrainingSettings:
        """All that decides the result, besides the images."""
        return self.configuration.settings(self.weights)

    def walks_folder(self, scene: str) -> Path:
        """Where its predictions of a scene go, as `vioapr evaluate` takes them."""
        return self.folder / WALKS_FOLDER / scene


def plan_trainings(
    data_set: DataSet,
    scenes: Sequence[str],
    models: Sequence[str],
    out: Path,
    change: Callable[[Configuration], Configuration] = lambda published: published,
    weights: Mapping[str, Path | None] = {},
) -> list[Training]:
    """Plan PoseNet for every scene, and MS-Transformer for every group of scenes (section 5).

    Args:
        data_set: Whose.
        scenes: That are there, in its order.
        models: Keys of `MODELS`.
        out: The reproduction's folder.
        change: From a published configuration to the one that is wanted.
        weights: Of each model's backbone.

    Raises:
        ParameterError: A change that cannot be.
        FileMissingError: A file of weights is missing.
    """
    trainings = []
    for model in models:
        given = weights.get(model)
        if given is not None and not given.is_file():
            problem = f"expected weights of {model}'s backbone, found no such file"
            raise FileMissingError(given, problem)
        units: list[tuple[Place, str, tuple[str, ...]]] = []
        if model == "posenet":
            units = [(data_set.place_of(scene), scene, (scene,)) for scene in scenes]
        else:
            for place, group in data_set.groups.items():
                members = tuple(scene for scene in group if scene in scenes)
                # A part of a group is another network, which must not go on with the group's.
                if members:
                    units.append((place, place if members == group else "+".join(members), members))
        for place, name, members in units:
            published = as_published(data_set, model, members, place)
            planned = change(published)
            folder = out / TRAININGS_FOLDER / model / name
            told = tuple(differences(planned, published, given))
            trainings.append(Training(folder, planned, given, told))
    return trainings


def keep_settings(training: Training) -> None:
    """Note a training's settings in its folder, or check that they are those noted there.

    Raises:
        ParameterError: They differ.
        FormatError: The note is broken.
        UnwritableError: It cannot be written.
    """
    path, own = training.folder / SETTINGS_FILE, training.settings
    if not path.exists():
        write_text(path, encode(own, indent=1))
        return
    noted = decode(path, read_text(path), TrainingSettings)
    if changes := describe_changes(to_plain(noted), to_plain(own)):
        raise ParameterError(
            f"{training.folder}: expected the settings that it was begun with, {changes}: "
            "give the same, or another `out`"
        )


class Work(NamedTuple):
    """The work that one training still needs, in images.

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


def work_of(training: Training, scenes: Mapping[str, Scene]) -> Work:
    """Count the work that is left of a training and its predictions."""
    learned = 0
    done = is_trained(training)
    if not done:
        images = sum(count_images(scenes[name], "train") for name in training.scenes)
        batch, steps = batches_of_epoch(images, training.configuration.params.batch_size)
        left = max(training.configuration.epochs - finished_epochs(training), 0)
        learned = images + left * batch * steps
    open_ = tuple(
        name for name in training.scenes if not done or predicted_note(training, name) is None
    )
    return Work(learned, sum(count_images(scenes[name], "test") for name in open_), open_)


def is_trained(training: Training) -> bool:
    """Whether nothing is left to learn."""
    has_regressor = (training.folder / REGRESSOR_FILE).exists()
    return has_regressor and finished_epochs(training) >= training.configuration.epochs


def finished_epochs(training: Training) -> int:
    """Count the epochs that are on disk."""
    header = read_note(note_of(training.folder / STATE_FILE), StateHeader)
    return 0 if header is None else len(header.epochs)


def predicted_note(training: Training, scene: str) -> PredictionNote | None:
    """Read the note of a scene's predictions, if they are whole and of this regressor."""
    note = read_note(training.walks_folder(scene) / PREDICTED_FILE, PredictionNote)
    return note if note is not None and note.regressor == regressor_digest(training) else None


def regressor_digest(training: Training) -> str:
    """Compute the SHA-256 of the regressor's file; "" if there is none."""
    path = training.folder / REGRESSOR_FILE
    return digest_of(path) if path.exists() else ""


def read_note(path: Path, kind: type[RecordType]) -> RecordType | None:
    """Read a note, or None if it is missing or was cut off: then the work is done again."""
    try:
        return decode(path, read_text(path), kind)
    except VioAprError:
        return None


def count_images(scene: Scene, split: str) -> int:
    """Count the images of a split."""
    return sum(int(scene.recording(id_).frames.has_image.sum()) for id_ in scene.splits[split])
