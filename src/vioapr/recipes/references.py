"""Raw medians on 7-Scenes and Cambridge Landmarks beside published predictions'."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from vioapr.recipes.comparison import Figures, Pair, figures_of
from vioapr.recipes.pooling import PooledErrors

DFNET = "dfnet"


@dataclass(frozen=True)
class ReferenceLine:
    """A scene's raw medians, m and deg, over all its test frames.

    Attributes:
        scene: Its name.
        medians: By model.
        dfnet: DFNet's in the published predictions, for scale; it is not trained here.
    """

    scene: str
    medians: Mapping[str, Pair]
    dfnet: Figures | None


def load_references(data_set: str) -> dict[str, dict[str, list[float]]]:
    """Published medians by scene and model."""
    file = files("vioapr.recipes") / "data" / "reference_medians.json"
    return json.loads(file.read_text(encoding="utf-8"))[data_set]


def compare_references(
    data_set: str,
    scenes: Sequence[str],
    models: Sequence[str],
    pooled: Mapping[tuple[str, str], PooledErrors],
) -> list[ReferenceLine]:
    """A line for every scene, whether it is there, or published, or not."""
    published = load_references(data_set)
    lines = []
    for scene in scenes:
        known = published.get(scene, {})
        medians = {}
        for model in models:
            errors = pooled.get((model, scene))
            ours = None if errors is None else figures_of(errors.raw_summary(), "median")
            medians[model] = Pair(ours, _as_figures(known.get(model)))
        lines.append(ReferenceLine(scene, medians, _as_figures(known.get(DFNET))))
    return lines


def _as_figures(values: Sequence[float] | None) -> Figures | None:
    return None if values is None else tuple(values)
