"""How figures look and how they are saved: colours, limits, what is drawn of long lines.

Matplotlib is imported where a figure is made, not with this module: it takes a second, which
commands that draw nothing should not wait for.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vioapr.files.text import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array1 = NDArray[np.float64]

MAX_POINTS = 600
"""About as many points are drawn of a line; a figure is hardly wider in pixels."""

RAW = "apr"
"""The method whose poses are the raw predictions; its colour is theirs."""

_METHOD_COLORS = {
    RAW: "#d55e00",
    "vio": "#009e73",
    "vio-apr": "#0072b2",
    "pose-filter": "#56b4e9",
    "mapnet-pgo": "#e69f00",
    "pose-graph": "#cc79a7",
    "chain": "#222222",
}
_DPI = 110
_OTHER_COLORS = ("#882255", "#999933", "#661100", "#44aa99")

RC_PARAMS = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.5,
    # Without a salt of ours, element ids are random and no two files of a figure are equal.
    "svg.hashsalt": "vioapr",
    # Names of files are not formulas, whatever dollar signs they have.
    "text.parse_math": False,
}
"""Matplotlib's settings for every figure, whatever the user's own file of settings says."""


def method_colors(methods: Iterable[str]) -> dict[str, str]:
    """Colours of methods (Okabe and Ito's colour-blind-safe palette and Tol's for unknown ones).

    Args:
        methods: All methods of a run, in its order; equal lists get equal colours.
    """
    others = cycle(_OTHER_COLORS)
    return {name: _METHOD_COLORS.get(name) or next(others) for name in dict.fromkeys(methods)}


def house_style() -> AbstractContextManager[None]:
    """Matplotlib's defaults with our settings, as long as the context lasts."""
    from matplotlib import style

    return style.context(["default", RC_PARAMS])


def new_figure(
    width_in: float,
    height_in: float,
    *,
    rows: int = 1,
    cols: int = 1,
    layout: Any = "constrained",
    **options: Any,
) -> tuple[Figure, NDArray]:
    """A figure that no global state knows of, and its axes, shape (rows * cols,)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout=layout)
    return figure, figure.subplots(rows, cols, squeeze=False, **options).ravel()


def mark_limit(axes: Axes, value: float, text: str) -> None:
    """Draw a dotted vertical line, named above the axes."""
    axes.axvline(value, color="#777777", lw=0.8, ls=":", zorder=1)
    axes.text(
        value, 1.01, text, transform=axes.get_xaxis_transform(), ha="center", fontsize=8,
        color="#555555", clip_on=False,
    )  # fmt: skip


def label_log_axis(axis: Axis) -> None:
    """Label a log axis, whose limits are set, with plain numbers: as many as there is room for."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    subs = (1.0, 2.0, 5.0) if decades < 2.3 else (1.0, 3.0) if decades < 3 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def render(figure: Figure) -> tuple[bytes, bytes]:
    """A figure as PNG and SVG; equal figures give equal bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    png, svg = io.BytesIO(), io.BytesIO()
    with house_style(), warnings.catch_warnings():
        # A regressor's name in letters that the font lacks is drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.set_dpi(_DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        # A third of the size in a palette, which serves figures of few colours as well.
        pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        palette = pixels.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        palette.save(png, format="png")
        # The layout has been found; finding it again would take as long as drawing.
        figure.set_layout_engine("none")
        figure.savefig(svg, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    return png.getvalue(), svg.getvalue()


def save_figure(figure: Figure, path: Path) -> tuple[Path, Path]:
    """Write a figure as PNG and SVG.

    Args:
        figure: See `new_figure`.
        path: Without an ending; its folder is made if needed.

    Returns:
        The paths of the two files.

    Raises:
        UnwritableError: A file cannot be written.
    """
    png, svg = (path.with_name(f"{path.name}.{ending}") for ending in ("png", "svg"))
    for file, content in zip((png, svg), render(figure), strict=True):
        write_bytes(file, content)
    return png, svg


def thin(values: Array1, limit: int = MAX_POINTS) -> NDArray[np.intp]:
    """Rows that show a long line's course: the lowest and the highest value of each stretch.

    Means would hide the outliers that figures are there to show. Where a stretch has a row
    without value, it is kept, so that gaps stay gaps.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    kept: list[int] = []
    for rows in np.array_split(np.arange(len(values)), limit // 3):
        known = rows[np.isfinite(values[rows])]
        if len(known):
            kept += [known[np.argmin(values[known])], known[np.argmax(values[known])]]
        kept += list(rows[~np.isfinite(values[rows])][:1])
    return np.unique(kept)


def spread(count: int, limit: int = MAX_POINTS) -> NDArray[np.intp]:
    """At most `limit` of `count` rows, evenly spread, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, limit)).astype(np.intp))


def spread_in_time(times: Array1) -> NDArray[np.intp]:
    """As `spread`, but evenly in time: the rate of frames may differ along a walk."""
    wanted = np.linspace(times[0], times[-1], min(len(times), MAX_POINTS))
    return np.unique(np.searchsorted(times, wanted).clip(max=len(times) - 1))


def log_limits(errors: Sequence[Array1], upper_percentile: float = 100) -> tuple[float, float]:
    """Limits of a log axis, which a few errors close to 0 must not stretch."""
    values = np.concatenate(list(errors))
    values = values[np.isfinite(values) & (values > 0)]
    if not len(values):
        return 0.01, 1.0
    low, high = np.percentile(values, [2, upper_percentile])
    if upper_percentile == 100:
        high *= 1.3  # markers stay clear of the edge
    return float(np.clip(low / 1.3, high / 1e4, high / 10)), float(high)
