"""The trainings of a reproduction: which network learns which scenes, where, and how."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vioapr.errors import FormatError, ParameterError
from vioapr.files.text import read_text, write_text
from vioapr.importers.base import Place
from vioapr.recipes.datasets import DataSet
from vioapr.recipes.recipes import Overrides, Recipe, differences, paper_recipe

SCENES_FOLDER, TRAININGS_FOLDER, WALKS_FOLDER = "scenes", "trainings", "walks"
SETTINGS_FILE = "settings.json"


@dataclass(frozen=True)
class Training:
    """One network to be trained.

    Attributes:
        model: A key of `MODELS`.
        scenes: Names of the scenes that it learns, in order.
        folder: Where its checkpoints, and in `walks/` its predictions, go.
        recipe: How.
        weights: File of the backbone's first weights, or None.
        differences: In what this is not as published.
    """

    model: str
    scenes: tuple[str, ...]
    folder: Path
    recipe: Recipe
    weights: Path | None
    differences: tuple[str, ...]

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.model} {self.folder.name}"

    def walks_folder(self, scene: str) -> Path:
        """Where its predictions of a scene go, as `vioapr evaluate` takes them."""
        return self.folder / WALKS_FOLDER / scene

    def settings(self) -> dict[str, Any]:
        """All that decides what comes out, besides the images."""
        weights = None if self.weights is None else self.weights.name
        return {"scenes": list(self.scenes), "weights": weights, **self.recipe.to_json()}


def plan_trainings(
    data_set: DataSet,
    scenes: Sequence[str],
    models: Sequence[str],
    out: Path,
    overrides: Overrides,
    weights: Mapping[str, Path | None],
) -> list[Training]:
    """PoseNet for every scene, MS-Transformer for every group of scenes (section 5).

    Args:
        data_set: Whose.
        scenes: That are there, in its order.
        models: Keys of `MODELS`.
        out: The reproduction's folder.
        overrides: What the user wants otherwise.
        weights: Of each model's backbone.

    Raises:
        ParameterError: An override that cannot be.
        FormatError: A file of weights is missing.
    """
    trainings = []
    for model in models:
        given = weights.get(model)
        if given is not None and not given.is_file():
            raise FormatError(given, f"expected weights of {model}'s backbone, found no such file")
        for place, name, members in _units(data_set, scenes, model):
            published = paper_recipe(data_set, model, place)
            recipe = overrides.apply(published)
            folder = out / TRAININGS_FOLDER / model / name
            told = tuple(differences(model, recipe, published, given))
            trainings.append(Training(model, members, folder, recipe, given, told))
    return trainings


def _units(
    data_set: DataSet, scenes: Sequence[str], model: str
) -> list[tuple[Place, str, tuple[str, ...]]]:
    """Place, name and scenes of each training of a model."""
    if model == "posenet":
        return [(data_set.place_of(scene), scene, (scene,)) for scene in scenes]
    units = []
    for place, group in data_set.groups.items():
        members = tuple(scene for scene in group if scene in scenes)
        if members:
            # A part of a group is another network, which must not go on with the group's.
            units.append((place, place if members == group else "+".join(members), members))
    return units


def keep_settings(training: Training) -> None:
    """Note a training's settings in its folder, or check that they are those noted there.

    Raises:
        ParameterError: They differ.
        FormatError: They cannot be read or written.
    """
    path, own = training.folder / SETTINGS_FILE, training.settings()
    if not path.exists():
        training.folder.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(own, indent=1) + "\n")
        return
    try:
        # A setting that is newer than the note was what is a recipe's default now.
        noted = Recipe().to_json() | json.loads(read_text(path))
        changed = [name for name in own if noted.get(name) != own[name]]
    except (ValueError, TypeError) as error:
        raise FormatError(path, f"expected a training's settings: {error}") from None
    if changed:
        raise ParameterError(
            f"{training.folder}: expected the settings that it was begun with, "
            + "; ".join(f"{n.replace('_', ' ')} {noted.get(n)} then, {own[n]} now" for n in changed)
            + ": give the same, or another --out"
        )
