"""The paper's Tables 2-5, and published medians, beside our figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files

import numpy as np

from vioapr.evaluation.metrics import Summary
from vioapr.recipes.pooling import PooledErrors
from vioapr.schemas.base import decode
from vioapr.schemas.reproduction import (
    Comparison,
    Figures,
    Kind,
    Levels,
    Line,
    Pair,
    PaperTables,
    Place,
    PrintedCell,
    PrintedTable,
    PublishedPair,
    ReferenceLine,
    ReferenceMedians,
)

PAPER_SUBSETS = ("only keyframes", "only optimized", "keyframes + optimized")
AVERAGE = "average"
ALL_FRAMES = "all frames"
DFNET = "dfnet"


def load_paper() -> PaperTables:
    """Read the paper's Tables 1 (images) and 2-5, as printed."""
    file = files("vioapr.recipes") / "data" / "paper_tables.json"
    return decode(file, file.read_bytes(), PaperTables)


def load_references(data_set: str) -> dict[str, dict[str, Figures]]:
    """Read published medians of a data set by scene and model."""
    file = files("vioapr.recipes") / "data" / "reference_medians.json"
    medians = decode(file, file.read_bytes(), ReferenceMedians)
    return {"7scenes": medians.sevenscenes, "cambridge": medians.cambridge}[data_set]


def compare(
    pooled: Mapping[tuple[str, str], PooledErrors],
    groups: Mapping[Place, Sequence[str]],
    models: Sequence[str],
) -> list[Comparison]:
    """Compare with all tables of which there is a scene.

    Args:
        pooled: By model and scene.
        groups: The data set's, by place.
        models: In the tables' order.
    """
    comparisons = []
    for table in load_paper().tables:
        scenes = groups[table.group]
        for model in models:
            if any((model, scene) in pooled for scene in scenes):
                of_scene = {s: pooled[model, s] for s in scenes if (model, s) in pooled}
                lines = tuple(compare_lines(table, model, scenes, of_scene))
                comparisons.append(Comparison(table.number, table.group, table.kind, model, lines))
    return comparisons


def compare_lines(
    table: PrintedTable,
    model: str,
    scenes: Sequence[str],
    of_scene: Mapping[str, PooledErrors],
) -> Iterator[Line]:
    """Compare with one table: its subsets, then all frames, which the paper does not have.

    Args:
        table: As printed.
        model: Whose columns.
        scenes: Of the table.
        of_scene: Our errors of those that there are.
    """
    sections = [(subset, "vio-apr") for subset in PAPER_SUBSETS]
    sections += [(ALL_FRAMES, "vio-apr"), (ALL_FRAMES, "chain")]
    for subset, method in sections:
        rows = table.rows.get(subset, {}) if method == "vio-apr" else {}
        printed = {scene: cells.get(model) for scene, cells in rows.items()}
        lines = [
            compare_scene(
                table.kind, subset, method, scene, of_scene.get(scene), printed.get(scene)
            )
            for scene in scenes
        ]
        if table.kind == "median":
            lines.append(average_of(lines, printed.get(AVERAGE)))
        yield from (line for line in lines if line.raw.ours or line.raw.paper or line.share.ours)


def compare_scene(
    kind: Kind,
    subset: str,
    method: str,
    scene: str,
    pooled: PooledErrors | None,
    printed: PrintedCell | None,
) -> Line:
    """Compare a scene's figures over a subset of its frames; see `Line`."""
    raw = fused = share = raw_same = None
    if pooled is not None:
        summary = pooled.fused_summary(method, subset)
        same = pooled.raw_summary(method, subset)
        is_same = subset == "only optimized"
        raw = figures_of(same if is_same else pooled.raw_summary(), kind)
        fused, raw_same = figures_of(summary, kind), figures_of(same, kind)
        share = (100.0 * float(summary.share),)
    paper_raw = paper_fused = paper_share = None
    if printed is not None:
        paper_raw, paper_fused = (
            cell.levels if isinstance(cell, Levels) else cell
            for cell in (printed.raw, printed.fused)
        )
        if isinstance(printed.fused, Levels) and printed.fused.share is not None:
            paper_share = (printed.fused.share,)
    return Line(
        subset, method, scene, Pair(raw, paper_raw), Pair(fused, paper_fused),
        Pair(share, paper_share), raw_same,
    )  # fmt: skip


def average_of(lines: Sequence[Line], printed: PrintedCell | None) -> Line:
    """Average medians over a group's scenes; None where one is missing.

    An average over the others would be of another set of scenes than the paper's.
    """
    columns = zip(
        *((line.raw.ours, line.fused.ours, line.share.ours, line.raw_same) for line in lines),
        strict=True,
    )
    means: list[Figures | None] = []
    for column in columns:
        known = [figures for figures in column if figures is not None]
        is_whole = len(known) == len(lines)
        means.append(tuple(float(x) for x in np.mean(known, axis=0)) if is_whole else None)
    raw, fused, share, raw_same = means
    first = compare_scene("median", lines[0].subset, lines[0].method, AVERAGE, None, printed)
    return Line(
        first.subset, first.method, AVERAGE, Pair(raw, first.raw.paper),
        Pair(fused, first.fused.paper), Pair(share, None), raw_same,
    )  # fmt: skip


def compare_references(
    data_set: str,
    scenes: Sequence[str],
    models: Sequence[str],
    pooled: Mapping[tuple[str, str], PooledErrors],
) -> list[ReferenceLine]:
    """Compare raw medians with published ones: every scene, whether it is there or not."""
    published = load_references(data_set)
    lines = []
    for scene in scenes:
        known = published.get(scene, {})
        medians = {}
        for model in models:
            errors = pooled.get((model, scene))
            ours = None if errors is None else figures_of(errors.raw_summary(), "median")
            medians[model] = PublishedPair(ours, known.get(model))
        lines.append(ReferenceLine(scene, medians, known.get(DFNET)))
    return lines


def figures_of(summary: Summary, kind: Kind) -> Figures | None:
    """Take the figures of a kind out of a summary; None over no frames."""
    if kind == "median":
        values = (float(summary.median_m), float(summary.median_deg))
    else:
        values = tuple(100 * float(x) for x in (summary.high, summary.medium, summary.low))
    return values if np.isfinite(values).all() else None
