"""What a map looks like from above, and how well the recordings agree on scale and up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vioapr.report.style import house_style, new_figure, spread
from vioapr.schemas.map_summary import WorldSummary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#882255", "#999933")
MAX_POINTS_DRAWN = 20_000


def map_figure(
    points_m: NDArray[np.float64],
    position_m: Mapping[str, NDArray[np.float64]],
    splits: Mapping[str, str],
) -> Figure:
    """Points and cameras from above.

    Args:
        points_m: The map's points in the world, shape (n, 3).
        position_m: Camera positions of every recording, by id, shapes (m, 3).
        splits: "train" or "test", by id.
    """
    with house_style():
        figure, (axis,) = new_figure(8.5, 6.5)
        # Around all cameras and most points: a few far ones would make the rest a dot.
        cameras = np.concatenate([np.zeros((0, 3)), *position_m.values()])
        edges = [cameras.min(axis=0), cameras.max(axis=0)]
        if len(points_m):
            edges += list(np.percentile(points_m, [3, 97], axis=0))
        low, high = np.min(edges, axis=0)[:2], np.max(edges, axis=0)[:2]
        margin = 0.04 * float((high - low).max()) + 0.1
        low, high = low - margin, high + margin
        shown = points_m[spread(len(points_m), MAX_POINTS_DRAWN)]
        axis.scatter(shown[:, 0], shown[:, 1], s=0.8, c="#9a9a9a", lw=0, rasterized=True)
        for number, (id_, positions) in enumerate(position_m.items()):
            marker = "o" if splits[id_] == "train" else "x"
            axis.plot(
                positions[:, 0], positions[:, 1], color=_COLORS[number % len(_COLORS)], lw=0.6,
                marker=marker, ms=3.2, mew=0.8, label=f"{id_} ({splits[id_]})",
            )  # fmt: skip
        axis.set_aspect("equal")
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x (m)", ylabel="y (m)")
        columns = min(max(len(position_m), 1), 5)
        figure.legend(loc="outside upper center", ncols=columns, markerscale=1.3)
    return figure


def agreement_figure(world: WorldSummary) -> Figure:
    """How much the tracking worlds differ in scale and in the direction up.

    Args:
        world: As the map's summary has it.
    """
    scales, tilts = world.scales, world.gravity_offset_deg
    rows = max(len(scales), len(tilts), 1)
    with house_style():
        figure, (left, right) = new_figure(9.0, 1.6 + 0.28 * rows, cols=2)
        for row, scale in enumerate(scales):
            off = 100 * (scale.relative - 1)
            color = "#0072b2" if scale.is_used else "#d55e00"
            left.errorbar(off, row, xerr=200 * scale.sigma, fmt="o", color=color, ms=4, lw=1.2)
        left.axvline(0, color="#777777", lw=0.8, ls=":")
        names = [s.recording + ("" if s.is_used else " (left out)") for s in scales]
        left.set_yticks(range(len(scales)), names)
        left.set_ylim(len(scales) - 0.5, -0.5)
        left.margins(x=0.15)
        left.set_xlabel("scale by VIO, off the map's (%), ± 2 sigma")
        offsets_deg = [tilt.offset_deg for tilt in tilts]
        right.barh(range(len(tilts)), offsets_deg, color="#0072b2", height=0.5)
        right.axvline(world.gravity_spread_deg, color="#777777", lw=0.8, ls=":")
        right.set_yticks(range(len(tilts)), [tilt.recording for tilt in tilts])
        right.set_ylim(len(tilts) - 0.5, -0.5)
        right.set_xlabel("up by VIO, off the map's (deg); dotted: single images")
    return figure
