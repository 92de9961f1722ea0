import numpy as np
import pytest

from vioapr.evaluation.content_jumps import ContentSteps
from vioapr.evaluation.metrics import PoseErrors
from vioapr.evaluation.reliability import Reliability, mean_reliability, measure_reliability

NAN = float("nan")
ERRORS = PoseErrors(np.array([1.0, 4.0, NAN, 2.0]), np.array([30.0, 10.0, NAN, 20.0]))


def test_figures_of_a_walk_by_hand():
    content = ContentSteps(np.array([NAN, 0.01, 0.2, 0.0]), 30.0)
    # By position the order is 1, 2, 4 m; by orientation 30, 10, 20 deg.
    sigma_m, sigma_deg = np.array([0.1, 0.9, NAN, 0.5]), np.array([1.0, 2.0, NAN, 4.0])
    found = measure_reliability(ERRORS, sigma_m, sigma_deg, content)
    assert found.jumps_per_min == 2
    assert found.largest_jump_m == 0.2
    assert found.wrong_and_sure == pytest.approx(1 / 3)  # the first: 10 sigmas, and 30
    assert (found.mean_m, found.mean_deg) == (pytest.approx(7 / 3), 20)
    assert found.risk_area_m == pytest.approx((1 + 1.5 + 7 / 3) / 3)
    assert found.risk_area_deg == pytest.approx((30 + 20 + 20) / 3)
    # Of all four frames: 50 % are two, 80 % would be all of them.
    assert (found.risk_50_m, found.risk_50_deg) == (1.5, 20)
    assert np.isnan([found.risk_80_m, found.risk_80_deg, found.risk_95_m]).all()


def test_without_sigmas_the_mean_is_known():
    found = measure_reliability(ERRORS, None, None, None)
    assert (found.mean_m, found.mean_deg) == (pytest.approx(7 / 3), 20)
    unknown = found._replace(mean_m=NAN, mean_deg=NAN)
    assert np.isnan(unknown).all()


def test_over_walks_means_and_the_largest_jump():
    one, two = (Reliability(*np.full(13, value)) for value in (1.0, 3.0))
    assert mean_reliability([one, two]) == Reliability(*np.full(13, 2.0))._replace(largest_jump_m=3)
    without = two._replace(risk_95_m=NAN, largest_jump_m=NAN)
    found = mean_reliability([one, without])
    assert (found.risk_95_m, found.largest_jump_m, found.mean_m) == (1, 1, 2)
    assert np.isnan(mean_reliability([without, without]).risk_95_m)
