import numpy as np
import pytest
from tests.helpers import random_rigid, to_numpy

from vioapr.evaluation.metrics import (
    PoseErrors,
    cumulative_distribution,
    pose_errors,
    relative_errors,
    summarize,
)
from vioapr.geometry.rigid import Rigid3


def errors(position, orientation):
    return PoseErrors(np.array(position, dtype=float), np.array(orientation, dtype=float))


def test_errors_by_hand():
    here = Rigid3(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))
    there = Rigid3(np.array([[1.0, 2, 2]]), np.array([[np.sqrt(0.5), 0, 0, -np.sqrt(0.5)]]))
    found = pose_errors(here, there)
    assert found.position_m[0] == 3.0
    assert found.orientation_deg[0] == pytest.approx(90)


def test_relative_errors_compare_lengths_not_directions():
    quats = np.tile([0.0, 0, 0, 1], (3, 1))
    along_x = Rigid3(np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]]), quats)
    along_y = Rigid3(np.array([[5.0, 0, 0], [5, 1, 0], [5, 3.5, 0]]), quats)
    gaps = relative_errors(along_x, along_y)
    np.testing.assert_allclose(gaps.distance_m, [0.0, 0.5])
    np.testing.assert_allclose(relative_errors(along_x, along_y, 2).distance_m, [0.5])


@pytest.mark.parametrize("batch", [(), (1,), (3, 4)])
def test_errors_over_batches_and_backends(xp, rng, batch):
    left, right = random_rigid(rng, (*batch, 5), xp), random_rigid(rng, (*batch, 5), xp)
    found = pose_errors(left, right)
    assert tuple(found.position_m.shape) == (*batch, 5)
    expected = np.linalg.norm(to_numpy(left[0]) - to_numpy(right[0]), axis=-1)
    np.testing.assert_allclose(to_numpy(found.position_m), expected)


def test_summary_by_hand():
    summary = summarize(errors([0.1, 0.3, 0.4, 6.0, np.nan], [1.0, 3.0, 1.0, 1.0, np.nan]))
    assert summary.median_m == pytest.approx(0.35)
    assert summary.median_deg == pytest.approx(1.0)
    assert (summary.high, summary.medium, summary.low) == (0.25, 0.75, 0.75)
    assert summary.share == pytest.approx(0.8)


def test_a_level_needs_position_and_orientation():
    assert summarize(errors([0.1], [3.0])).high == 0
    assert summarize(errors([0.25], [2.0])).high == 1


def test_summary_of_a_subset_and_of_nothing():
    found = errors([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert summarize(found, np.array([False, True, True])).median_m == 2.5
    nothing = summarize(found, np.zeros(3, dtype=bool))
    assert nothing.share == 0
    assert np.isnan(nothing.median_m)
    assert np.isnan(nothing.high)


def test_summary_agrees_with_numpy_over_batches(rng):
    values = rng.exponential(size=(3, 4, 50))
    values[rng.random(values.shape) < 0.2] = np.nan
    found = PoseErrors(values, values * 2)
    summary = summarize(found)
    np.testing.assert_allclose(summary.median_m, np.nanmedian(values, axis=-1))
    np.testing.assert_allclose(summary.p95_deg, np.nanpercentile(values * 2, 95, axis=-1))


def test_cumulative_distribution():
    ordered, share = cumulative_distribution(np.array([3.0, np.nan, 1.0]))
    assert ordered.tolist() == [1.0, 3.0]
    assert share.tolist() == [0.5, 1.0]
