"""The paper's Figure "errdis", and how odometry drifts along walks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from vioapr.evaluation.metrics import cumulative_distribution
from vioapr.evaluation.vio_quality import VioQuality
from vioapr.evaluation.vio_tables import group_tracks, pooled_errors, steady
from vioapr.plurals import count_of
from vioapr.report.formatting import format_error
from vioapr.report.style import (
    house_style,
    label_log_axis,
    log_limits,
    mark_limit,
    new_figure,
    spread,
    thin,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#999933")
MAX_GROUPS = len(_COLORS)
"""Groups that are drawn, the first ones: more could not be told apart."""

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
            low, high = log_limits([values[key] for values in pooled.values()], 99)
            low = max(low, high / 300)
            for color, (name, values) in zip(_COLORS, pooled.items(), strict=False):
                if not len(values[key]):
                    axis.plot([], [], color=color, label=f"{name}: none that does not diverge")
                    continue
                ordered, share = cumulative_distribution(values[key])
                rows = spread(len(ordered), 250)
                x, y = np.maximum(ordered[rows], low), 100 * share[rows]
                text = f"{name}: median {format_error(float(np.median(ordered)))}"
                axis.plot(x, y, color=color, drawstyle="steps-post", label=text)
            axis.set(xscale="log", xlim=(low, high), ylim=(0, 103))
            if key in limits:
                axis.set_xlim(min(low, limits[key] / 2), max(high, limits[key] * 2))
                mark_limit(axis, limits[key], f"{limits[key]:g}")
            label_log_axis(axis.xaxis)
            axis.set_xlabel(f"{label}, log scale")
            axis.legend(loc="upper left", handlelength=1.2, fontsize=8)
        for axis in axes[::2]:
            axis.set_ylabel("share (%)")
    return figure


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
                # A line over a change of the tracker's world would join two worlds.
                shown = quality.errors[field].copy()
                shown[1:][np.diff(quality.track.tracking_world) != 0] = np.nan
                rows = thin(shown)
                axis.plot(
                    quality.elapsed_s[rows], shown[rows], color=color, lw=1.1, alpha=0.85,
                    ls=":" if quality.diverges_at_s is not None else "-", label=label,
                )  # fmt: skip
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
        diverging = len(members) - len(steady(members))
        label = f"{name}, {count_of(len(members), 'walk')}"
        label += f", {diverging} diverging (dotted)" if diverging else ""
        for number, quality in enumerate(members):
            yield color, label if number == 0 else None, quality


VIO_FIGURES: dict[str, Callable[[list[VioQuality]], Figure]] = {
    "vio_errdis": vio_distribution_figure,
    "vio_drift": vio_drift_figure,
}
"""The figures of a tracker's quality, by the names of their files."""
