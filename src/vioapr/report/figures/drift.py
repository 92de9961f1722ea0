"""The paper's Figure "drift": errors over time on one walk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.evaluate import Result
from vioapr.fusion.types import Status
from vioapr.report.figures.selection import (
    AXIS_LABELS,
    colors_of,
    raw_label,
    staged_method,
    without_raw,
)
from vioapr.report.style import (
    MAX_POINTS,
    RAW,
    Array1,
    house_style,
    label_log_axis,
    log_limits,
    new_figure,
    thin,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STAGES: dict[Status, dict[str, Any]] = {
    Status.KEYFRAME: {"marker": "o", "ms": 3.6, "mew": 0.0},
    Status.OPTIMIZED: {"marker": "s", "ms": 3.8, "mfc": "white", "mew": 1.0},
    Status.TRACKED: {"marker": "v", "ms": 3.8, "mfc": "#9ccbe8", "mew": 0.6},
}


def drift_figure(results: Sequence[Result]) -> Figure:
    """Errors over time on one walk (paper, Figure "drift").

    Args:
        results: Of one case, one a method. `vio-apr` is drawn with its stages, or the first
            method other than `apr` and `vio` where it is missing.
    """
    first, colors, staged = results[0], colors_of(results), staged_method(results)
    times = first.timestamp_s - first.timestamp_s[0]
    with house_style():
        figure, axes = new_figure(9.0, 5.8, rows=2, sharex=True)
        for field, axis in enumerate(axes):
            raw = first.raw_errors[field]
            is_known = np.isfinite(raw)
            # Images may be much rarer than frames: the line joins predictions, not frames.
            at, shown, color = times[is_known], raw[is_known], colors[RAW]
            _plot_thinned(axis, at, shown, color=color, lw=0.5, alpha=0.4)
            dots = {"ls": "", "marker": ".", "ms": 4, "label": raw_label(results)}
            _plot_thinned(axis, at, shown, color=color, **dots)
            for result in without_raw(results):
                options = {"color": colors[result.method], "label": result.method, "lw": 1.3}
                _plot_thinned(axis, times, result.errors[field], **options)
                if result is staged:
                    _draw_stages(axis, times, result, field, colors[result.method])
            errors = [raw, *(result.errors[field] for result in without_raw(results))]
            label = f"{AXIS_LABELS[field]}, log scale"
            axis.set(yscale="log", ylim=log_limits(errors), ylabel=label)
            label_log_axis(axis.yaxis)
            axis.margins(x=0.01)
        axes[-1].set_xlabel("time since the walk's first frame (s)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, markerscale=1.5)
    return figure


def _draw_stages(axis: Axes, times: Array1, result: Result, field: int, color: str) -> None:
    """Markers at the frames of each stage, and a grey band where there is no pose."""
    for status, marker in _STAGES.items():
        is_stage = result.has_status(status)
        if is_stage.any():
            options = {"color": color, "ls": "", "label": f"{result.method}: {status.label}"}
            _plot_thinned(
                axis,
                times[is_stage],
                result.errors[field][is_stage],
                limit=MAX_POINTS // 2,
                zorder=3,
                **options | marker,
            )
    for index, (start, end) in enumerate(find_gaps(times, result.has_status(Status.UNLOCALIZED))):
        label = f"{result.method}: no pose" if index == 0 else None
        axis.axvspan(start, end, color="#dddddd", lw=0, zorder=0, label=label)


def _plot_thinned(
    axis: Axes, times: Array1, values: Array1, *, limit: int = MAX_POINTS, **options: Any
) -> None:
    rows = thin(values, limit)
    axis.plot(times[rows], values[rows], **options)


def find_gaps(times: Array1, is_gap: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Find spans of time of runs of frames, each up to the next frame, that are long enough to see.

    Args:
        times: Shape (n,), s.
        is_gap: Shape (n,), the frames to look for.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_gap, [False]])))
    ends = np.append(times, times[-1])
    spans = [(float(ends[start]), float(ends[end])) for start, end in edges.reshape(-1, 2)]
    return [(start, end) for start, end in spans if end - start > (times[-1] - times[0]) / 2000]
