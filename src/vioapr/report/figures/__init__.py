"""The paper's figures for any walks: drift, trajectories, and distributions of errors."""

from vioapr.report.figures.distribution import distribution_figure
from vioapr.report.figures.drift import drift_figure
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
    "save_figures",
    "trajectory_figure",
]
