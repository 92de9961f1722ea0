import numpy as np
import pytest

from vioapr.evaluation.metrics import PoseErrors
from vioapr.evaluation.risk_coverage import risk_coverage, wrong_and_sure

NAN = float("nan")


def curve(error, sigma):
    return risk_coverage(np.array(error, dtype=float), np.array(sigma, dtype=float))


class TestCurve:
    def test_by_hand(self):
        # In the order of their sigmas the errors are 1, 2, 6, 3.
        found = curve([6, 1, 3, 2], [0.3, 0.1, 0.4, 0.2])
        np.testing.assert_allclose(found.coverage, [0.25, 0.5, 0.75, 1])
        np.testing.assert_allclose(found.risk, [1, 1.5, 3, 3])
        assert found.area == pytest.approx(8.5 / 4)

    def test_risk_at_a_coverage_is_of_at_least_that_share(self):
        found = curve([6, 1, 3, 2], [0.3, 0.1, 0.4, 0.2])
        assert found.risk_at(0.5) == 1.5
        assert found.risk_at(0.51) == 3
        assert found.risk_at(0.95) == 3
        twenty = curve(np.arange(1, 21), np.arange(1, 21))
        assert twenty.risk_at(0.95) == pytest.approx(10)  # 1 to 19: 19 of 20 are 95 %
        assert twenty.risk_at(0.8) == pytest.approx(8.5)  # 1 to 16

    def test_equal_sigmas_say_nothing_whatever_the_order(self):
        for errors in ([1, 2, 9], [9, 2, 1]):
            found = curve(errors, [0.5, 0.5, 0.5])
            np.testing.assert_allclose(found.risk, [4, 4, 4])
            assert found.area == pytest.approx(4)
        mixed = curve([5, 1, 3], [0.2, 0.1, 0.2])
        np.testing.assert_allclose(mixed.risk, [1, 2.5, 3])

    def test_frames_without_answer_are_never_covered(self):
        found = curve([2, NAN, 4, 1], [0.2, 0.1, NAN, 0.3])
        np.testing.assert_allclose(found.coverage, [0.25, 0.5])
        np.testing.assert_allclose(found.risk, [2, 1.5])
        assert found.area == pytest.approx(1.75)
        assert found.risk_at(0.5) == 1.5
        assert np.isnan(found.risk_at(0.8))

    @pytest.mark.parametrize("values", [[], [NAN, NAN]])
    def test_no_answers_at_all(self, values):
        found = curve(values, values)
        assert len(found.risk) == 0
        assert np.isnan(found.area)
        assert np.isnan(found.risk_at(0.5))

    def test_the_order_by_error_is_the_best_and_its_reverse_the_worst(self):
        error = np.random.default_rng(0).exponential(size=200)
        best, worst = curve(error, error), curve(error, -error)
        none = curve(error, np.zeros(200))
        some = curve(error, error + np.random.default_rng(1).exponential(size=200))
        assert best.area < some.area < none.area < worst.area
        assert none.area == pytest.approx(error.mean())


class TestWrongAndSure:
    def test_by_hand(self):
        errors = PoseErrors(np.array([0.4, 0.6, 0.1, 0.1, 2.0]), np.array([1.0, 1, 1, 11, 30]))
        sigma_m, sigma_deg = np.full(5, 0.1), np.full(5, 2.0)
        # Above 0.5 m: two; above 10 deg: two; one of them is both.
        assert wrong_and_sure(errors, sigma_m, sigma_deg) == pytest.approx(3 / 5)

    def test_five_sigmas_are_not_more_than_five(self):
        errors = PoseErrors(np.array([5.0]), np.array([0.0]))
        assert wrong_and_sure(errors, np.array([1.0]), np.array([1.0])) == 0

    def test_only_frames_with_a_pose_and_sigmas_count(self):
        errors = PoseErrors(np.array([9, NAN, 9, 0.0]), np.array([0, NAN, 0, 0.0]))
        sigma = np.array([1.0, 1, NAN, 1])
        assert wrong_and_sure(errors, sigma, sigma) == 0.5

    def test_without_sigmas_it_is_unknown(self):
        errors = PoseErrors(np.array([1.0]), np.array([1.0]))
        assert np.isnan(wrong_and_sure(errors, np.array([NAN]), np.array([NAN])))

    def test_gaussian_errors_of_the_stated_sigmas_are_hardly_ever(self):
        rng = np.random.default_rng(0)
        errors = PoseErrors(*np.linalg.norm(rng.standard_normal((2, 100_000, 3)), axis=-1))
        share = wrong_and_sure(errors, np.ones(100_000), np.ones(100_000))
        assert 0 < share < 1e-4  # 1.5e-5 each
