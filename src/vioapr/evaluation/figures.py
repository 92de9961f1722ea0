"""The paper's figures for any walks: drift, trajectories, and distributions of errors."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.formatting import format_error, format_number, format_walks
from vioapr.evaluation.metrics import PRECISION_LEVELS, cumulative_distribution
from vioapr.evaluation.style import (
    MAX_POINTS,
    RAW,
    Array1,
    house_style,
    label_log_axis,
    log_limits,
    method_colors,
    new_figure,
    render,
    spread,
    spread_in_time,
    thin,
)
from vioapr.evaluation.tables import Group
from vioapr.evaluation.walks import Case
from vioapr.formats.base import write_bytes
from vioapr.fusion.types import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_METHODS = 3
"""Most methods beside the raw predictions in the trajectory figure."""

_NAME_LENGTH = 24
_AXIS_LABELS = ("position error (m)", "orientation error (deg)")
"""Of the fields of `PoseErrors`."""

_STAGES: dict[Status, dict[str, Any]] = {
    Status.KEYFRAME: {"marker": "o", "ms": 3.6, "mew": 0.0},
    Status.OPTIMIZED: {"marker": "s", "ms": 3.8, "mfc": "white", "mew": 1.0},
    Status.TRACKED: {"marker": "v", "ms": 3.8, "mfc": "#9ccbe8", "mew": 0.6},
}


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


def representative_case(group: Group) -> Case:
    """The case whose raw median position error is the median of the group's.

    Chosen by the raw regressor alone, so that no method is flattered. Of an even number, the
    lower of the two in the middle; a case without predictions only where no other has any.
    """
    first = [result for result in group.results if result.method == group.results[0].method]
    medians = [_median(result.raw_errors.position_m) for result in first]
    order = np.argsort(medians, kind="stable")  # unknown ones last
    known = int(np.isfinite(medians).sum())
    return first[order[max(known - 1, 0) // 2]].case


def results_of(group: Group, case: Case) -> list[Result]:
    """What each method made of a case."""
    return [result for result in group.results if result.case is case]


def drift_figure(results: Sequence[Result]) -> Figure:
    """Errors over time on one walk (paper, Figure "drift").

    Args:
        results: Of one case, one a method. `vio-apr` is drawn with its stages, or the first
            method other than `apr` and `vio` where it is missing.
    """
    with house_style():
        figure, axes = new_figure(9.0, 5.8, rows=2, sharex=True)
        for field, axis in enumerate(axes):
            _draw_drift(axis, results, field)
        axes[-1].set_xlabel("time since the walk's first frame (s)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, markerscale=1.5)
    return figure


def _draw_drift(axis: Axes, results: Sequence[Result], field: int) -> None:
    first, colors = results[0], _colors(results)
    raw = first.raw_errors[field]
    times = first.timestamps_s - first.timestamps_s[0]
    is_known = np.isfinite(raw)
    label = _raw_label(results)
    # Images may be much rarer than frames: the line joins predictions, not frames.
    _plot_thinned(axis, times[is_known], raw[is_known], color=colors[RAW], lw=0.5, alpha=0.4)
    _plot_thinned(
        axis,
        times[is_known],
        raw[is_known],
        color=colors[RAW],
        ls="",
        marker=".",
        ms=4,
        label=label,
    )
    staged = _staged_method(results)
    for result in _methods(results):
        options = {"color": colors[result.method], "label": result.method, "lw": 1.3}
        _plot_thinned(axis, times, result.errors[field], **options)
        if result is staged:
            _draw_stages(axis, times, result, field, colors[result.method])
    low, high = log_limits([raw, *(result.errors[field] for result in _methods(results))])
    axis.set(yscale="log", ylim=(low, high), ylabel=f"{_AXIS_LABELS[field]}, log scale")
    label_log_axis(axis.yaxis)
    axis.margins(x=0.01)


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
    for index, (start, end) in enumerate(_gaps(times, result.has_status(Status.UNLOCALIZED))):
        label = f"{result.method}: no pose" if index == 0 else None
        axis.axvspan(start, end, color="#dddddd", lw=0, zorder=0, label=label)


def _plot_thinned(
    axis: Axes, times: Array1, values: Array1, *, limit: int = MAX_POINTS, **options: Any
) -> None:
    rows = thin(values, limit)
    axis.plot(times[rows], values[rows], **options)


def _gaps(times: Array1, is_gap: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Spans of time of runs of such frames, each up to the next frame; too short ones left out."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_gap, [False]])))
    ends = np.append(times, times[-1])
    spans = [(float(ends[start]), float(ends[end])) for start, end in edges.reshape(-1, 2)]
    return [(start, end) for start, end in spans if end - start > (times[-1] - times[0]) / 2000]


def trajectory_figure(results: Sequence[Result]) -> Figure:
    """Positions coloured by their error, with ground truth (paper, Figure "res_pn").

    Args:
        results: Of one case, one a method. Raw predictions are left, the methods beside them;
            of more than `MAX_METHODS`, the best by median position error, where a frame
            without pose counts as the worst.
    """
    first, shown = results[0], _best_methods(results)
    gt = first.gt_world_from_cam.translation_m
    axes_shown = _view_axes(gt)
    limits = _view_limits(gt[:, axes_shown], first.raw_errors.position_m)
    raw = first.case.frames.inputs.apr_world_from_cam.at(first.case.has_gt).translation_m
    panels = [(_raw_label(results), raw, first.raw_errors.position_m)]
    panels += [(r.method, r.world_from_cam.translation_m, r.errors.position_m) for r in shown]
    gt_rows = spread_in_time(first.timestamps_s)
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
    return f"median {format_error(_median(errors))} m, {share} % of frames{outside}"


def _view_axes(gt_positions_m: Array1) -> list[int]:
    """The two world axes to look at: x and y, as the world's z is up, unless z says otherwise.

    Where ground truth comes in a world of unknown gravity, z is as good an axis as any: it
    replaces the shorter of the others if the walk extends more than twice as far along it.
    """
    extent = np.ptp(gt_positions_m, axis=0)
    shorter = int(np.argmin(extent[:2]))
    return [0, 1] if extent[2] <= 2 * extent[shorter] else [1 - shorter, 2]


def _view_limits(gt: Array1, raw_errors_m: Array1) -> Array1:
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


def _best_methods(results: Sequence[Result]) -> list[Result]:
    """At most `MAX_METHODS` methods, in the order of the results."""

    def badness(result: Result) -> float:
        errors = np.nan_to_num(result.errors.position_m, nan=np.inf)
        return float(np.sort(errors)[len(errors) // 2])

    best = sorted(_methods(results), key=badness)[:MAX_METHODS]
    return [result for result in _methods(results) if result in best]


def distribution_figure(results: Sequence[Result]) -> Figure:
    """Cumulative distributions of the errors over all walks (paper, Figure "errdis").

    Every curve counts all frames, those without pose as if their error were infinite, so it
    ends at the share of frames that the method answers.

    Args:
        results: Of one group, all cases and methods.
    """
    colors = _colors(results)
    with house_style():
        figure, axes = new_figure(9.5, 4.0 + 0.2 * len(colors), cols=2, sharey=True)
        for field, axis in enumerate(axes):
            errors = _errors_by_method(results, field)
            limits = log_limits(list(errors.values()), upper_percentile=99)
            for method, values in errors.items():
                label = _raw_label(results) if method == RAW else method
                _draw_distribution(axis, values, limits, label, colors[method], (" m", "°")[field])
            axis.set(xscale="log", xlim=limits, ylim=(0, 103))
            _draw_levels(axis, field)
            label_log_axis(axis.xaxis)
            axis.set_xlabel(f"{_AXIS_LABELS[field]}, log scale, up to the 99th percentile")
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), handlelength=1.4)
        axes[0].set_ylabel("share of all frames, with or without pose (%)")
    return figure


def _draw_distribution(
    axis: Axes, errors: Array1, limits: tuple[float, float], label: str, color: str, unit: str
) -> None:
    ordered, share = cumulative_distribution(errors)
    answered = len(ordered) / max(len(errors), 1)
    rows = spread(len(ordered), 250)
    # From the left edge to the right one: a curve that ends early would look unfinished.
    edges = np.array([*limits, *ordered])
    x = np.concatenate([[edges.min()], ordered[rows], [edges.max()]])
    y = np.concatenate([[0.0], 100 * answered * share[rows], [100 * answered]])
    figures = f"median {format_error(_median(errors))}{unit}, {100 * answered:.0f} % of frames"
    axis.plot(x, y, color=color, drawstyle="steps-post", label=f"{label}: {figures}")


def _draw_levels(axis: Axes, field: int) -> None:
    """The limits of the precision levels, named at the top, as far as they are in view."""
    low, high = axis.get_xlim()
    for level, limits in PRECISION_LEVELS.items():
        if not low <= limits[field] <= high:
            continue
        axis.axvline(limits[field], color="#777777", lw=0.8, ls=":", zorder=1)
        axis.text(
            limits[field], 1.01, level, transform=axis.get_xaxis_transform(), ha="center",
            fontsize=8, color="#555555", clip_on=False,
        )  # fmt: skip


FIGURES: dict[str, Callable[[Sequence[Result]], Any]] = {
    "drift": drift_figure,
    "trajectories": trajectory_figure,
    "distribution": distribution_figure,
}


def count_figure_ticks(groups: Sequence[Group]) -> int:
    """How often `save_figures` calls its tick."""
    return len(FIGURES) * len(groups)


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
        FormatError: A file cannot be written.
    """
    saved = []
    for group, stem in zip(groups, _file_stems(groups), strict=True):
        results = results_of(group, representative_case(group))
        for kind, draw in FIGURES.items():
            png, svg = (folder / "figures" / f"{stem}_{kind}.{end}" for end in ("png", "svg"))
            contents = render(draw(group.results if kind == "distribution" else results))
            for path, content in zip((png, svg), contents, strict=True):
                write_bytes(path, content)
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
    case = representative_case(group)
    median = _median(results_of(group, case)[0].raw_errors.position_m)
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


def _file_stems(groups: Sequence[Group]) -> list[str]:
    """A name for each group's files that any file system takes, none twice."""
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


def _methods(results: Sequence[Result]) -> list[Result]:
    """Results of methods that are not the raw predictions, which are drawn anyway."""
    return [result for result in results if result.method != RAW]


def _staged_method(results: Sequence[Result]) -> Result | None:
    others = [result for result in _methods(results) if result.method != "vio"]
    named = [result for result in others if result.method == "vio-apr"]
    return next(iter(named + others), None)


def _colors(results: Sequence[Result]) -> dict[str, str]:
    return method_colors([RAW, *(result.method for result in results)])


def _raw_label(results: Sequence[Result]) -> str:
    """Begins with a word of ours: Matplotlib's legends leave out what begins with "_"."""
    name = results[0].case.apr
    return f"raw {name if len(name) <= _NAME_LENGTH else name[: _NAME_LENGTH - 1] + '…'}"


def _errors_by_method(results: Sequence[Result], field: int) -> dict[str, Array1]:
    """All cases' errors together: the raw predictions' first, then each method's."""
    errors = {RAW: [r.raw_errors[field] for r in results if r.method == results[0].method]}
    for result in _methods(results):
        errors.setdefault(result.method, []).append(result.errors[field])
    return {method: np.concatenate(values) for method, values in errors.items()}


def _median(values: Array1) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")
