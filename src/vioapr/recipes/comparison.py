"""The paper's Tables 2-5, ours beside the printed figures."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal, NamedTuple

import numpy as np

from vioapr.evaluation.metrics import Summary
from vioapr.recipes.pooling import PooledErrors

Kind = Literal["median", "levels"]
Figures = tuple[float, ...]
"""Of kind median: m, deg. Of kind levels: % within the high, medium and low level."""

PAPER_SUBSETS = ("only keyframes", "only optimized", "keyframes + optimized")
AVERAGE = "average"
ALL_FRAMES = "all frames"


class Pair(NamedTuple):
    """A figure of ours and the paper's; None where there is none."""

    ours: Figures | None
    paper: Figures | None

    @property
    def difference(self) -> Figures | None:
        """Ours minus the paper's."""
        if self.ours is None or self.paper is None:
            return None
        return tuple(a - b for a, b in zip(self.ours, self.paper, strict=True))


@dataclass(frozen=True)
class Line:
    """A scene over a subset of its test frames.

    Attributes:
        subset: A key of `SUBSETS`.
        method: Whose subset, and whose poses are `fused`.
        scene: Its name, or `AVERAGE`, the mean over the group's scenes.
        raw: The regressor alone: on all test frames, but for "only optimized", where the paper
            counts these frames.
        fused: The method's.
        share: Of the test frames, %, that `fused` counts.
        raw_same: The regressor alone on the very frames that `fused` counts, ours.
    """

    subset: str
    method: str
    scene: str
    raw: Pair
    fused: Pair
    share: Pair
    raw_same: Figures | None


@dataclass(frozen=True)
class Comparison:
    """One of the paper's tables for one regressor.

    Attributes:
        number: The table's.
        place: "outdoor" or "indoor".
        kind: Of its figures.
        model: The regressor's name.
        lines: The paper's, then those over all frames, which the paper does not have.
    """

    number: int
    place: str
    kind: Kind
    model: str
    lines: tuple[Line, ...]


def load_paper() -> dict[str, Any]:
    """The paper's Tables 1 (images) and 2-5, as printed."""
    file = files("vioapr.recipes") / "data" / "paper_tables.json"
    return json.loads(file.read_text(encoding="utf-8"))


def compare(
    pooled: Mapping[tuple[str, str], PooledErrors],
    groups: Mapping[Any, Sequence[str]],
    models: Sequence[str],
) -> list[Comparison]:
    """All tables of which there is a scene.

    Args:
        pooled: By model and scene.
        groups: The data set's, by place.
        models: In the tables' order.
    """
    comparisons = []
    for table in load_paper()["tables"]:
        scenes = groups[table["group"]]
        for model in models:
            if any((model, scene) in pooled for scene in scenes):
                of_scene = {s: pooled[model, s] for s in scenes if (model, s) in pooled}
                lines = tuple(_lines(table, model, scenes, of_scene))
                key = (table["number"], table["group"], table["kind"])
                comparisons.append(Comparison(*key, model, lines))
    return comparisons


def _lines(
    table: Mapping[str, Any],
    model: str,
    scenes: Sequence[str],
    of_scene: Mapping[str, PooledErrors],
) -> Iterator[Line]:
    sections = [(subset, "vio-apr") for subset in PAPER_SUBSETS]
    sections += [(ALL_FRAMES, "vio-apr"), (ALL_FRAMES, "consensus")]
    for subset, method in sections:
        printed = table["rows"].get(subset, {}) if method == "vio-apr" else {}
        lines = [
            _line(table["kind"], subset, method, scene, of_scene.get(scene),
                  printed.get(scene, {}).get(model))
            for scene in scenes
        ]  # fmt: skip
        if table["kind"] == "median":
            lines.append(_average(lines, printed.get(AVERAGE, {}).get(model)))
        yield from (line for line in lines if line.raw.ours or line.raw.paper or line.share.ours)


def _line(
    kind: Kind,
    subset: str,
    method: str,
    scene: str,
    pooled: PooledErrors | None,
    printed: Mapping[str, Any] | None,
) -> Line:
    raw = fused = share = raw_same = None
    if pooled is not None:
        summary = pooled.fused_summary(method, subset)
        same = pooled.raw_summary(method, subset)
        is_same = subset == "only optimized"
        raw = figures_of(same if is_same else pooled.raw_summary(), kind)
        fused, raw_same = figures_of(summary, kind), figures_of(same, kind)
        share = (100.0 * float(summary.share),)
    paper_raw, paper_fused, paper_share = _printed(printed, kind)
    return Line(
        subset, method, scene, Pair(raw, paper_raw), Pair(fused, paper_fused),
        Pair(share, paper_share), raw_same,
    )  # fmt: skip


def _printed(
    printed: Mapping[str, Any] | None, kind: Kind
) -> tuple[Figures | None, Figures | None, Figures | None]:
    """Raw, fused and share of a scene in the paper."""
    if printed is None:
        return None, None, None
    if kind == "median":
        return tuple(printed["raw"]), tuple(printed["vio-apr"]), None
    fused = printed["vio-apr"]
    return tuple(printed["raw"]["levels"]), tuple(fused["levels"]), (fused["share"],)


def figures_of(summary: Summary, kind: Kind) -> Figures | None:
    """None over no frames."""
    if kind == "median":
        values = (float(summary.median_m), float(summary.median_deg))
    else:
        values = tuple(100 * float(x) for x in (summary.high, summary.medium, summary.low))
    return values if np.isfinite(values).all() else None


def _average(lines: Sequence[Line], printed: Mapping[str, Any] | None) -> Line:
    """Means over the group's scenes; none where one is missing, as they would be of others."""
    paper_raw, paper_fused, _ = _printed(printed, "median")
    raw, fused, share, raw_same = (
        _mean(column)
        for column in zip(
            *((ln.raw.ours, ln.fused.ours, ln.share.ours, ln.raw_same) for ln in lines),
            strict=True,
        )
    )
    first = lines[0]
    return Line(
        first.subset, first.method, AVERAGE, Pair(raw, paper_raw), Pair(fused, paper_fused),
        Pair(share, None), raw_same,
    )  # fmt: skip


def _mean(values: Sequence[Figures | None]) -> Figures | None:
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    return tuple(float(x) for x in np.mean(known, axis=0))
