"""The paper's Figure "errdis", and how odometry drifts along walks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from vioapr.evaluation.metrics import cumulative_distribution
from vioapr.evaluation.vio_quality import VioQuality
from vioapr.evaluation.vio_tables import group_tracks, pooled_errors, steady
from vioapr.report.formatting import format_error
from vioapr.report.style import (
    Array1,
    house_style,
    label_log_axis,
    log_limits,
    new_figure,
    spread,
    thin,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#999933")
MAX_GROUPS = len(_COLORS)
"""So many groups are drawn, the first ones: more could not be told apart."""

_PANELS = (
    ("rpe_m", "RPE between frames one period apart (m)"),
    ("roe_deg", "ROE between frames one period apart (deg)"),
    ("ape_m", "APE after alignment on the first seconds (m)"),
    ("aoe_deg", "AOE after alignment on the first seconds (deg)"),
)


def vio_distribution_figure(qualities: list[VioQuality]) -> Figure:
    """Cumulative distributions of relative and absolute errors (paper, Figure "errdis").

    A curve a group of set and tracker, over all its walks together; diverging tracks are left
    out, since they would decide the axes.

    Args:
        qualities: Of all walks, at least one.
    """
    groups = list(group_tracks(qualities).items())[:MAX_GROUPS]
    pooled = {name: pooled_errors(steady(members)) for name, members in groups}
    params = qualities[0].params
    limits = {"rpe_m": params.within_m, "roe_deg": params.within_deg}
    with house_style():
        figure, axes = new_figure(9.5, 7.0, rows=2, cols=2, sharey=True)
        for axis, (key, label) in zip(axes, _PANELS, strict=True):
            errors = {name: values[key] for name, values in pooled.items()}
            _draw_curves(axis, errors)
            if key in limits:
                _mark(axis, limits[key], f"{limits[key]:g}")
            label_log_axis(axis.xaxis)
            axis.set_xlabel(f"{label}, log scale")
            axis.legend(loc="upper left", handlelength=1.2, fontsize=8)
        for axis in axes[::2]:
            axis.set_ylabel("share (%)")
    return figure


def _draw_curves(axis: Axes, errors_of: dict[str, Array1]) -> None:
    low, high = log_limits(list(errors_of.values()), 99)
    axis.set(xscale="log", xlim=(max(low, high / 300), high), ylim=(0, 103))
    for color, (name, errors) in zip(_COLORS, errors_of.items(), strict=False):
        if not len(errors):
            axis.plot([], [], color=color, label=f"{name}: none that does not diverge")
            continue
        ordered, share = cumulative_distribution(errors)
        rows = spread(len(ordered), 250)
        x = np.maximum(ordered[rows], axis.get_xlim()[0])
        label = f"{name}: median {format_error(float(np.median(ordered)))}"
        axis.plot(x, 100 * share[rows], color=color, drawstyle="steps-post", label=label)


def _mark(axis: Axes, limit: float, text: str) -> None:
    low, high = axis.get_xlim()
    axis.set_xlim(min(low, limit / 2), max(high, limit * 2))
    axis.axvline(limit, color="#777777", lw=0.8, ls=":", zorder=1)
    axis.text(
        limit, 1.01, text, transform=axis.get_xaxis_transform(), ha="center", fontsize=8,
        color="#555555", clip_on=False,
    )  # fmt: skip


def vio_drift_figure(qualities: list[VioQuality]) -> Figure:
    """APE and AOE over time after alignment on the first seconds, a line a walk.

    A colour a group of set and tracker; of one group alone, a colour a walk, as many as there
    are colours. A diverging track is dotted and leaves the axes, which the others set.

    Args:
        qualities: Of all walks, at least one.
    """
    with house_style():
        figure, axes = new_figure(9.0, 6.0, rows=2, sharex=True)
        for field, axis in enumerate(axes):
            for color, label, quality in _lines(qualities):
                _draw_walk(axis, quality, field, color, label)
            settled = steady(qualities) or qualities
            highest = max(float(np.max(q.errors[field])) for q in settled)
            axis.set_ylim(0, 1.05 * highest or 1.0)
            axis.set_ylabel(("APE (m)", "AOE (deg)")[field])
            axis.axvspan(0, qualities[0].params.align_s, color="#eeeeee", lw=0, zorder=0)
            axis.margins(x=0.01)
        axes[0].text(
            0.3, 0.97, " aligned here", transform=axes[0].get_xaxis_transform(), fontsize=8,
            va="top", color="#555555",
        )  # fmt: skip
        axes[-1].set_xlabel("time since the walk's first frame (s)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
    return figure


def _lines(qualities: list[VioQuality]) -> Iterator[tuple[str, str | None, VioQuality]]:
    """The walks to draw, each with its colour and, where it is to be in the legend, its label."""
    groups = list(group_tracks(qualities).items())
    if len(groups) == 1:
        for number, quality in enumerate(groups[0][1]):
            diverges = ", diverging" if quality.diverges_at_s is not None else ""
            if number < MAX_GROUPS:
                yield _COLORS[number], f"{quality.track.walk}{diverges}", quality
            else:
                label = "further walks" if number == MAX_GROUPS else None
                yield "#999999", label, quality
        return
    for color, (name, members) in zip(_COLORS, groups, strict=False):
        for number, quality in enumerate(members):
            yield color, _label(name, members) if number == 0 else None, quality


def _draw_walk(axis: Axes, quality: VioQuality, field: int, color: str, label: str | None) -> None:
    errors, elapsed = quality.errors[field], quality.elapsed_s
    # A line over a change of the tracker's world would join what has nothing in common.
    shown = errors.copy()
    shown[1:][np.diff(quality.track.tracking_world) != 0] = np.nan
    rows = thin(shown)
    style = ":" if quality.diverges_at_s is not None else "-"
    axis.plot(elapsed[rows], shown[rows], color=color, ls=style, lw=1.1, alpha=0.85, label=label)


def _label(name: str, members: list[VioQuality]) -> str:
    diverging = len(members) - len(steady(members))
    walks = f"{len(members)} walk{'s' if len(members) != 1 else ''}"
    return f"{name}, {walks}" + (f", {diverging} diverging (dotted)" if diverging else "")


VIO_FIGURES: dict[str, Callable[[list[VioQuality]], Figure]] = {
    "vio_errdis": vio_distribution_figure,
    "vio_drift": vio_drift_figure,
}
"""The figures of a tracker's quality, by the names of their files."""
