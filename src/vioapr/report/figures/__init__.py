"""The paper's figures for any walks (drift, trajectories, distributions of errors), and risk."""

from vioapr.report.figures.distribution import distribution_figure
from vioapr.report.figures.drift import drift_figure
from vioapr.report.figures.risk import risk_figure
from vioapr.report.figures.saving import (
    FIGURES,
    FigureFiles,
    caption,
    count_figure_ticks,
    save_figures,
)
from vioapr.report.figures.selection import representative_case, results_of
from vioapr.report.figures.trajectories import trajectory_figure

__all__ = [
    "FIGURES",
    "FigureFiles",
    "caption",
    "count_figure_ticks",
    "distribution_figure",
    "drift_figure",
    "representative_case",
    "results_of",
    "risk_figure",
    "save_figures",
    "trajectory_figure",
]
