"""How fast people walked while recording (paper, Figure "outhis")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vioapr.report.style import Array1, house_style, new_figure
from vioapr.scene.scene import SPLITS
from vioapr.scene.summary import SceneSummary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BIN_M_S = 0.1
_COLORS = {"train": "#0072b2", "test": "#e69f00"}
_MAX_M_S = 3.0
_MAX_NAMED = 3


def speed_bins(speeds: Array1) -> Array1:
    """Edges of bins from 0 to the fastest, at most 3 m/s; what is faster is in the last bin."""
    fastest = float(speeds.max(initial=0.0))
    count = int(np.clip(np.floor(fastest / BIN_M_S) + 1, 5, round(_MAX_M_S / BIN_M_S)))
    return np.linspace(0.0, count * BIN_M_S, count + 1)


def speed_panels(summaries: Sequence[SceneSummary]) -> dict[str, dict[str, Array1]]:
    """Pool the speeds of outdoor and of indoor scenes by split, for `speed_figure`."""
    panels = {}
    for title, is_outdoor in (("Outdoor", True), ("Indoor", False)):
        chosen = [summary for summary in summaries if summary.is_outdoor == is_outdoor]
        if chosen:
            names = ", ".join(summary.name for summary in chosen[:_MAX_NAMED])
            names = names if len(chosen) <= _MAX_NAMED else f"{len(chosen)} scenes"
            recordings = [recording for summary in chosen for recording in summary.recordings]
            panels[f"{title}: {names}"] = {
                split: np.concatenate(
                    [np.zeros(0), *(r.speeds_m_s for r in recordings if r.split == split)]
                )
                for split in SPLITS
            }
    return panels


def speed_figure(panels: Mapping[str, Mapping[str, Array1]]) -> Figure:
    """Speed histograms, a panel each, stacked by split.

    Args:
        panels: For each panel's title, the speeds of "train" and "test", m/s.
    """
    with house_style():
        figure, axes = new_figure(4.8 * len(panels) + 0.4, 3.5, cols=len(panels))
        for axis, (title, by_split) in zip(axes, panels.items(), strict=True):
            speeds = np.concatenate([np.zeros(0), *by_split.values()])
            edges = speed_bins(speeds)
            shown = {
                split: np.minimum(values, edges[-1] - 1e-9) for split, values in by_split.items()
            }
            shown = {split: values for split, values in shown.items() if len(values)}
            if shown:
                axis.hist(
                    list(shown.values()),
                    bins=list(edges),
                    stacked=True,
                    weights=[np.full(len(values), 100 / len(speeds)) for values in shown.values()],
                    label=[f"{split}, n = {len(values)}" for split, values in shown.items()],
                    color=[_COLORS[split] for split in shown],
                    edgecolor="white",
                    linewidth=0.5,
                )
                median = float(np.median(speeds))
                axis.axvline(
                    median, color="#222222", lw=1.0, ls="--", label=f"median {median:.2f} m/s"
                )
                axis.legend(
                    loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, handlelength=1.4
                )
            axis.grid(axis="x", visible=False)
            axis.set(title=title, xlim=(0, edges[-1]), xlabel="walking speed over 1 s (m/s)")
            axis.set_ylabel("share of the time (%)")
            if (speeds > edges[-1]).any():
                text = f"last bar: {(speeds > edges[-1]).mean():.1%} faster"
                axis.text(0.99, 0.97, text, transform=axis.transAxes, ha="right", fontsize=8)
    return figure
