import numpy as np
import pytest

from vioapr.geometry import rigid
from vioapr.simulation.regressors import (
    NO_REGRESSOR_ERRORS,
    RegressorErrors,
    regress,
    view_bias,
)
from vioapr.simulation.walks import walk_round


@pytest.fixture(scope="module")
def gt():
    return walk_round(np.random.default_rng(2), np.arange(0, 600, 0.5), 40.0, 1.1)


def test_without_errors_predictions_are_exact(rng, gt):
    predicted = regress(rng, gt, NO_REGRESSOR_ERRORS, 40.0)
    assert rigid.distance_m(gt, predicted).max() == 0
    assert rigid.angle_deg(gt, predicted).max() < 1e-9


def test_biases_are_of_their_stated_sizes(gt):
    """Over many draws: at one place the bias is random, with the stated deviation."""
    bias = RegressorErrors(bias_m=2.0, bias_deg=5.0, noise_m=0, noise_deg=0, lookalike_share=0)
    ends = gt.at(np.array([0]))
    offsets, turns = [], []
    for seed in range(800):
        predicted = regress(np.random.default_rng(seed), ends, bias, 40.0)
        offsets.append(predicted.translation_m[0] - ends.translation_m[0])
        turns.append(rigid.angle_deg(ends, predicted)[0])
    np.testing.assert_allclose(np.std(offsets, axis=0), 2.0, rtol=0.1)
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(5.0 * np.sqrt(3), rel=0.1)


def test_the_bias_is_a_function_of_the_view(gt):
    twice = rigid.Rigid3(*(np.concatenate([part, part]) for part in gt))
    bias = view_bias(np.random.default_rng(0), twice, 3.0)
    np.testing.assert_array_equal(bias[: len(bias) // 2], bias[len(bias) // 2 :])


def test_lookalikes_are_as_many_as_stated(rng, gt):
    only = RegressorErrors(0, 0, 0, 0, lookalike_share=0.3)
    wrong = rigid.distance_m(gt, regress(rng, gt, only, 40.0)) > 0
    assert wrong.mean() == pytest.approx(0.3, abs=0.05)
