"""Risk and coverage: how the error grows as less sure frames are kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.risk_coverage import RiskCoverage, risk_coverage
from vioapr.report.figures.selection import AXIS_LABELS, colors_of
from vioapr.report.formatting import format_error
from vioapr.report.style import house_style, new_figure, spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def states_sigmas(result: Result) -> bool:
    """Whether the method states its uncertainty."""
    return result.sigma_position_m is not None and result.sigma_orientation_deg is not None


def risk_figure(results: Sequence[Result]) -> Figure:
    """Mean error of the surest frames over their share, of the methods that state sigmas.

    A dotted line orders the frames by their true errors instead: no sigma can do better.

    Args:
        results: Of one group, all cases and methods.
    """
    colors = colors_of(results)
    with house_style():
        figure, axes = new_figure(9.5, 4.0 + 0.2 * len(colors), cols=2, sharex=True)
        for field, axis in enumerate(axes):
            for method, (error, sigma) in _pooled(results, field).items():
                curve, best = risk_coverage(error, sigma), risk_coverage(error, error)
                unit = (" m", "°")[field]
                label = f"{method}: area {format_error(curve.area)}{unit}"
                _draw(axis, curve, color=colors[method], label=label)
                _draw(axis, best, color=colors[method], ls=":", lw=1.0)
            axis.set(xlim=(0, 100), xlabel="surest frames, share of all frames (%)")
            axis.set_ylim(bottom=0)
            axis.set_ylabel(f"mean {AXIS_LABELS[field]}")
            if axis.get_lines():
                axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), handlelength=1.4)
    return figure


def _draw(axis: Axes, curve: RiskCoverage, **style: Any) -> None:
    rows = spread(len(curve.risk), 250)
    axis.plot(100 * curve.coverage[rows], curve.risk[rows], **style)


def _pooled(results: Sequence[Result], field: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Errors and sigmas of all cases together, by method."""
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for result in filter(states_sigmas, results):
        sigma = (result.sigma_position_m, result.sigma_orientation_deg)[field]
        parts.setdefault(result.method, []).append((result.errors[field], np.asarray(sigma)))
    return {
        method: (np.concatenate([e for e, _ in pairs]), np.concatenate([s for _, s in pairs]))
        for method, pairs in parts.items()
    }
