"""Speed histograms: what is drawn is what was measured."""

import numpy as np

from vioapr.report.figures.speed import speed_bins, speed_figure
from vioapr.report.style import render


def test_bins_reach_the_fastest_and_no_further_than_3_m_s():
    np.testing.assert_allclose(speed_bins(np.array([0.0, 1.05])), np.arange(12) / 10)
    assert speed_bins(np.array([40.0]))[-1] == 3
    assert speed_bins(np.zeros(0))[-1] == 0.5


def heights(axis):
    return np.array([[bar.get_height() for bar in bars] for bars in axis.containers])


def test_bars_are_shares_of_the_time():
    speeds = {"train": np.array([0.25, 0.75, 0.75]), "test": np.array([0.25])}
    figure = speed_figure({"Outdoor": speeds})
    train, test = heights(figure.axes[0])
    assert train[[2, 7]].tolist() == [25, 50]
    assert test[2] == 25
    assert (train.sum(), test.sum()) == (75, 25)


def test_faster_than_the_axis_is_counted_in_the_last_bar_and_said():
    figure = speed_figure(
        {"Indoor": {"train": np.array([0.5, 0.5, 0.5, 9.0]), "test": np.zeros(0)}}
    )
    (axis,) = figure.axes
    assert heights(axis)[0][-1] == 25
    assert [text.get_text() for text in axis.texts] == ["last bar: 25.0% faster"]


def test_no_speed_is_an_empty_panel():
    png, _ = render(speed_figure({"Outdoor": {"train": np.zeros(0), "test": np.zeros(0)}}))
    assert png.startswith(b"\x89PNG")
