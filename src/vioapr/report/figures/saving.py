"""All figures of all groups as files, with captions."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.tables import Group
from vioapr.report.figures.distribution import distribution_figure
from vioapr.report.figures.drift import drift_figure
from vioapr.report.figures.risk import risk_figure, states_sigmas
from vioapr.report.figures.selection import finite_median, representative_case, results_of
from vioapr.report.figures.trajectories import MAX_METHODS, trajectory_figure
from vioapr.report.formatting import format_error, format_walks
from vioapr.report.style import save_figure


@dataclass(frozen=True)
class FigureFiles:
    """A figure on disk.

    Attributes:
        group: The group that it shows.
        kind: A key of `FIGURES`.
        png: Its path.
        svg: Its path.
        caption: What it shows and how it was drawn.
    """

    group: Group
    kind: str
    png: Path
    svg: Path
    caption: str


FIGURES: dict[str, Callable[[Sequence[Result]], Any]] = {
    "drift": drift_figure,
    "trajectories": trajectory_figure,
    "distribution": distribution_figure,
    "risk": risk_figure,
}
_OF_ALL_WALKS = ("distribution", "risk")
"""Figures of all walks of a group; the others show one of them."""


def kinds_of(group: Group) -> list[str]:
    """The figures that a group gets: without risk where no method states its uncertainty."""
    has_sigmas = any(map(states_sigmas, group.results))
    return [kind for kind in FIGURES if kind != "risk" or has_sigmas]


def count_figure_ticks(groups: Sequence[Group]) -> int:
    """How often `save_figures` calls its tick."""
    return sum(len(kinds_of(group)) for group in groups)


def save_figures(
    groups: Sequence[Group], folder: Path, tick: Callable[[], object] | None = None
) -> list[FigureFiles]:
    """Draw every group's figures into `folder/figures`, as PNG and SVG.

    Args:
        groups: From `group_results`.
        folder: Made if needed.
        tick: Called after every figure, for progress.

    Returns:
        The figures, group by group.

    Raises:
        UnwritableError: A file cannot be written.
    """
    saved = []
    for group, stem in zip(groups, file_stems(groups), strict=True):
        results = results_of(group, representative_case(group))
        for kind in kinds_of(group):
            figure = FIGURES[kind](group.results if kind in _OF_ALL_WALKS else results)
            png, svg = save_figure(figure, folder / "figures" / f"{stem}_{kind}")
            saved.append(FigureFiles(group, kind, png, svg, caption(group, kind)))
            if tick is not None:
                tick()
    return saved


def caption(group: Group, kind: str) -> str:
    """What a group's figure shows, on which walk and why on this one."""
    walks = format_walks(group)
    if kind == "distribution":
        return (
            f"Cumulative distribution of the errors over {walks} ({group.title}). Frames without "
            "pose count as if their error were infinite: a curve ends at the share of frames "
            "that the method answers. Medians are of the answered frames of all walks together; "
            "those of the tables are means over walks. Dotted: limits of the precision levels, "
            "each of which asks for position and orientation at once."
        )
    if kind == "risk":
        return (
            f"Mean error of the surest frames, by the stated sigma, over {walks} together "
            f"({group.title}); frames without pose are never kept. Dotted: ordered by the true "
            "error, the best that there can be. A flat line: sigmas that tell nothing."
        )
    case = representative_case(group)
    median = finite_median(results_of(group, case)[0].raw_errors.position_m)
    chosen = (
        f"Shown is {case.title}, because its raw median position error "
        f"({format_error(median)} m) is the middle one of {walks}."
    )
    if kind == "drift":
        what = (
            "Errors over time, raw predictions beside the methods. The line of vio is odometry "
            "placed once, by the method's own first reference. The lowest 2 % of the errors may "
            "lie below the axes."
        )
    else:
        what = (
            "Estimated positions coloured by position error, grey: ground truth, seen along the "
            "world axis that is not named. One colour scale for all; it ends at the raw "
            "predictions' 95th percentile. Points beyond the panel are counted above it. Of more "
            f"than {MAX_METHODS} methods, those with the lowest medians are shown."
        )
    return f"{what} {chosen}"


def file_stems(groups: Sequence[Group]) -> list[str]:
    """Name each group's files so that any file system takes it, no two alike."""
    stems: list[str] = []
    for group in groups:
        parts = (group.set_name, group.vio, group.apr)
        stem = "_".join(
            re.sub(r"[^A-Za-z0-9-]+", "-", part).strip("-")[:40] or "x" for part in parts
        )
        taken = {other.lower() for other in stems}
        number = 2
        unique = stem
        while unique.lower() in taken:
            unique, number = f"{stem}-{number}", number + 1
        stems.append(unique)
    return stems
