"""The paper's Figure "res_pn": trajectories coloured by error beside ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vioapr.evaluation.evaluate import Result
from vioapr.report.figures.selection import finite_median, raw_label, without_raw
from vioapr.report.formatting import format_error, format_number
from vioapr.report.style import Array1, house_style, new_figure, spread, spread_in_time

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_METHODS = 3
"""Most methods beside the raw predictions in the trajectory figure."""


def trajectory_figure(results: Sequence[Result]) -> Figure:
    """Positions coloured by their error, with ground truth (paper, Figure "res_pn").

    Args:
        results: Of one case, one a method. Raw predictions are left, the methods beside them;
            of more than `MAX_METHODS`, the best by median position error, where a frame
            without pose counts as the worst.
    """
    first, shown = results[0], best_methods(results)
    gt = first.gt_world_from_cam.translation_m
    axes_shown = view_axes(gt)
    limits = view_limits(gt[:, axes_shown], first.raw_errors.position_m)
    raw = first.case.frames.inputs.apr_world_from_cam.at(first.case.has_gt).translation_m
    panels = [(raw_label(results), raw, first.raw_errors.position_m)]
    panels += [(r.method, r.world_from_cam.translation_m, r.errors.position_m) for r in shown]
    gt_rows = spread_in_time(first.timestamp_s)
    shape = np.ptp(limits[1]) / np.ptp(limits[0])
    with house_style():
        figure, axes = new_figure(
            1.3 + 3.0 * len(panels),
            1.2 + 2.9 * shape,
            cols=len(panels),
            layout="compressed",
            sharex=True,
            sharey=True,
        )
        colors = _error_colors([panel[2] for panel in panels])
        for axis, (title, positions, errors) in zip(axes, panels, strict=True):
            axis.plot(*gt[gt_rows][:, axes_shown].T, color="#9a9a9a", lw=1.0, zorder=1)
            note = _draw_positions(axis, positions[:, axes_shown], errors, limits, colors)
            axis.set_title(title, loc="left", fontweight="bold", pad=18)
            axis.annotate(note, (0, 1), (0, 5), xycoords="axes fraction", fontsize=8.5,
                          textcoords="offset points", color="#555555")  # fmt: skip
            axis.set(xlim=limits[0], ylim=limits[1], xlabel=f"{'xyz'[axes_shown[0]]} (m)")
            axis.set_aspect("equal")
        axes[0].set_ylabel(f"{'xyz'[axes_shown[1]]} (m)")
        figure.colorbar(
            colors, ax=list(axes), label="position error (m)", extend="max", pad=0.01, aspect=25
        )
    return figure


def _draw_positions(
    axis: Axes, positions: Array1, errors: Array1, limits: Array1, colors: Any
) -> str:
    """Draw one panel's points; says what they are and how many lie beyond the limits."""
    is_known = np.isfinite(errors)
    positions, errors = positions[is_known], errors[is_known]
    is_outside = ((positions < limits[:, 0]) | (positions > limits[:, 1])).any(axis=-1)
    rows = spread(len(errors))
    rows = rows[np.argsort(errors[rows], kind="stable")]  # large errors on top
    axis.scatter(
        *positions[rows].T, c=errors[rows], s=11, lw=0, norm=colors.norm, cmap=colors.cmap,
        zorder=2,
    )  # fmt: skip
    if not len(errors):
        return "no pose"
    outside = f", {is_outside.sum()} outside" if is_outside.any() else ""
    share = format_number(100 * is_known.mean(), 0)
    return f"median {format_error(finite_median(errors))} m, {share} % of frames{outside}"


def view_axes(gt_positions_m: Array1) -> list[int]:
    """Choose two world axes to look at: x and y, as the world's z is up, unless z says otherwise.

    Where ground truth comes in a world of unknown gravity, z is as good an axis as any: it
    replaces the shorter of the others if the walk extends more than twice as far along it.
    """
    extent = np.ptp(gt_positions_m, axis=0)
    shorter = int(np.argmin(extent[:2]))
    return [0, 1] if extent[2] <= 2 * extent[shorter] else [1 - shorter, 2]


def view_limits(gt: Array1, raw_errors_m: Array1) -> Array1:
    """Limits of both axes, shape (2, 2): ground truth, and room for most of the raw predictions.

    Some regressors' outliers lie kilometres away, so the room is at most half the walk's
    extent; and no panel is wider or higher than it is readable.
    """
    low, high = gt.min(axis=0), gt.max(axis=0)
    extent = max(float((high - low).max()), 1e-3)
    known = raw_errors_m[np.isfinite(raw_errors_m)]
    errors_m = float(np.percentile(known, 90)) if len(known) else 0.0
    half = (high - low) / 2 + np.clip(errors_m, 0.06 * extent, 0.5 * extent)
    half = np.maximum(half, [half[1] / 1.4, half[0] / 2])
    middle = (low + high) / 2
    return np.stack([middle - half, middle + half], axis=-1)


def _error_colors(errors: Sequence[Array1]) -> Any:
    """Colours from 0 to the raw predictions' 95th percentile, or the first panel's that has any."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    known = next((e[np.isfinite(e)] for e in errors if np.isfinite(e).any()), np.ones(1))
    # Without the palest colours, which are hard to see on white.
    colors = ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.88, 256)))
    return ScalarMappable(Normalize(0.0, float(np.percentile(known, 95)) or 1.0), colors)


def best_methods(results: Sequence[Result]) -> list[Result]:
    """Choose at most `MAX_METHODS` methods, in the order of the results."""

    def badness(result: Result) -> float:
        errors = np.nan_to_num(result.errors.position_m, nan=np.inf)
        return float(np.sort(errors)[len(errors) // 2])

    best = sorted(without_raw(results), key=badness)[:MAX_METHODS]
    return [result for result in without_raw(results) if result in best]
