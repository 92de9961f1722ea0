"""Where a place was recorded, and what is missing: a plan from above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vioapr.evaluation.view_coverage import SECTORS, Coverage, Views
from vioapr.report.style import house_style, new_figure
from vioapr.schemas.build import GapRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NONE_TO_ALL = ("#fbe0cf", "#b9d3de", "#5b9ab5", "#1d5674")
"""Colours of cells seen in no direction and in all."""
_GAP, _PATH, _TEST = "#c2410c", "#16181d", "#7c3aed"


def coverage_figure(
    coverage: Coverage,
    gaps: Sequence[GapRecord],
    train: Mapping[str, Views],
    test: Mapping[str, Views],
    *,
    has_compass: bool,
) -> Figure:
    """Draw cells by how many directions were seen from them, ways, and areas that lack views.

    Args:
        coverage: Of the place.
        gaps: Areas to number, with arrows to where nobody looked.
        train: Of the training recordings.
        test: Of the test recordings.
        has_compass: Whether x is east.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.patches import Rectangle

    colors = LinearSegmentedColormap.from_list("views", _NONE_TO_ALL, SECTORS + 1)
    seen = coverage.is_seen.sum(axis=1)
    with house_style():
        width_m, height_m = np.ptp(coverage.cell, axis=0) + 1
        figure, (axis,) = new_figure(8.5 if width_m > 0.7 * height_m else 6.0, 6.5)
        for cell, count in zip(coverage.cell, seen, strict=True):
            color = colors(int(count))
            side = coverage.cell_m
            axis.add_patch(Rectangle(cell * side, side, side, fc=color, ec="white", lw=0.8))
        for label, walks, style in (
            ("training walks", train, {"color": _PATH, "lw": 0.8, "alpha": 0.7}),
            ("test walks", test, {"color": _TEST, "lw": 1.2, "ls": (0, (2, 1.5))}),
        ):
            for number, views in enumerate(walks.values()):
                axis.plot(*views.position_m.T, label=None if number else label, **style)
        for number, gap in enumerate(gaps, 1):
            _draw_gap(axis, number, gap)
        axis.autoscale_view()
        axis.margins(0.08)
        axis.set_aspect("equal")
        axis.grid(visible=False)
        names = ("east (m)", "north (m)") if has_compass else ("x (m)", "y (m)")
        axis.set(xlabel=names[0], ylabel=names[1])
        steps = ScalarMappable(Normalize(-0.5, SECTORS + 0.5), colors)
        scale = figure.colorbar(steps, ax=axis, shrink=0.6, label=f"directions seen, of {SECTORS}")
        scale.set_ticks([0, SECTORS // 2, SECTORS])
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _draw_gap(axis: Axes, number: int, gap: GapRecord) -> None:
    """Draw an area's number, and arrows to where few looked from it."""
    x, y = gap.position_m
    reach_m = max(gap.radius_m, 1.0)
    for heading_deg in gap.headings_deg:
        dx, dy = (
            reach_m * np.cos(np.radians(heading_deg)),
            reach_m * np.sin(np.radians(heading_deg)),
        )
        axis.annotate(
            "", (x + dx, y + dy), (x + 0.3 * dx, y + 0.3 * dy),
            arrowprops={"arrowstyle": "-|>", "color": _GAP, "lw": 1.4}, zorder=4,
        )  # fmt: skip
    circle = {"boxstyle": "circle,pad=0.25", "fc": _GAP, "ec": "white"}
    axis.text(
        x, y, str(number), ha="center", va="center", color="white", fontsize=9,
        fontweight="bold", zorder=5, bbox=circle,
    )  # fmt: skip
