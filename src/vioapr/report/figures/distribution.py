"""Cumulative distributions of the errors of all walks of a group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.metrics import PRECISION_LEVELS, cumulative_distribution
from vioapr.report.figures.selection import (
    AXIS_LABELS,
    colors_of,
    errors_by_method,
    finite_median,
    raw_label,
)
from vioapr.report.formatting import format_error
from vioapr.report.style import (
    RAW,
    house_style,
    label_log_axis,
    log_limits,
    mark_limit,
    new_figure,
    spread,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def distribution_figure(results: Sequence[Result]) -> Figure:
    """Cumulative distributions of the errors over all walks (paper, Figure "errdis").

    Every curve counts all frames, those without pose as if their error were infinite, so it
    ends at the share of frames that the method answers.

    Args:
        results: Of one group, all cases and methods.
    """
    colors = colors_of(results)
    with house_style():
        figure, axes = new_figure(9.5, 4.0 + 0.2 * len(colors), cols=2, sharey=True)
        for field, axis in enumerate(axes):
            errors = errors_by_method(results, field)
            limits = log_limits(list(errors.values()), upper_percentile=99)
            for method, values in errors.items():
                ordered, share = cumulative_distribution(values)
                answered = len(ordered) / max(len(values), 1)
                rows = spread(len(ordered), 250)
                # From the left edge to the right one: a curve that ends early looks unfinished.
                edges = np.array([*limits, *ordered])
                x = np.concatenate([[edges.min()], ordered[rows], [edges.max()]])
                y = np.concatenate([[0.0], 100 * answered * share[rows], [100 * answered]])
                name = raw_label(results) if method == RAW else method
                median = format_error(finite_median(values)) + (" m", "°")[field]
                label = f"{name}: median {median}, {100 * answered:.0f} % of frames"
                axis.plot(x, y, color=colors[method], drawstyle="steps-post", label=label)
            axis.set(xscale="log", xlim=limits, ylim=(0, 103))
            for level, level_limits in PRECISION_LEVELS.items():
                if limits[0] <= level_limits[field] <= limits[1]:
                    mark_limit(axis, level_limits[field], level)
            label_log_axis(axis.xaxis)
            axis.set_xlabel(f"{AXIS_LABELS[field]}, log scale, up to the 99th percentile")
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), handlelength=1.4)
        axes[0].set_ylabel("share of all frames, with or without pose (%)")
    return figure
