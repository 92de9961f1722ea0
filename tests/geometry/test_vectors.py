import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.geometry.vectors import (
    STANDARD_GRAVITY_M_S2,
    angle_between_deg,
    distance_along_m,
    path_length_m,
    step_lengths_m,
)

BATCHES = [(), (1,), (3, 1, 2)]
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("left", "right", "expected_deg"),
    [
        (X, X, 0.0),
        (X, -X, 180.0),
        (X, Y, 90.0),
        (X, X + Y, 45.0),
        (X, [-1.0, np.sqrt(3.0), 0.0], 120.0),
        ([0.0, 0.0, 5.0], [0.0, 1e-3, 0.0], 90.0),
    ],
)
def test_angles_by_hand(left, right, expected_deg):
    assert angle_between_deg(left, right) == pytest.approx(expected_deg, abs=1e-13)


@pytest.mark.parametrize("batch", BATCHES)
def test_angles_obey_their_laws(rng, batch):
    left, right = rng.normal(size=(*batch, 3)), rng.normal(size=(*batch, 3))
    angle = angle_between_deg(left, right)
    assert np.shape(angle) == batch
    lengths = np.linalg.norm(left, axis=-1) * np.linalg.norm(right, axis=-1)
    cosine = (left * right).sum(axis=-1) / lengths
    np.testing.assert_allclose(np.cos(np.radians(angle)), cosine, atol=1e-14)
    np.testing.assert_allclose(angle_between_deg(right, left), angle, atol=1e-13)
    np.testing.assert_allclose(angle_between_deg(left, -right), 180 - angle, atol=1e-12)
    np.testing.assert_allclose(angle_between_deg(7 * left, right / 3), angle, atol=1e-12)
    turn = quaternion.from_rotvec(rng.normal(size=(*batch, 3)))
    turned = angle_between_deg(quaternion.rotate(turn, left), quaternion.rotate(turn, right))
    np.testing.assert_allclose(turned, angle, atol=1e-12)


@pytest.mark.parametrize("angle_rad", [1e-12, 1e-9, 1e-6, 1e-3])
def test_angles_keep_their_precision_near_0_and_180_degrees(angle_rad):
    turned = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    near_0, near_180 = angle_between_deg(X, turned), angle_between_deg(-X, turned)
    assert near_0 == pytest.approx(np.degrees(angle_rad), rel=1e-7)
    assert 180 - near_180 == pytest.approx(np.degrees(angle_rad), rel=1e-7, abs=5e-14)


def test_batches_are_broadcast(rng):
    left = rng.normal(size=(4, 3))
    both = angle_between_deg(left[:, None], left)
    assert both.shape == (4, 4)
    np.testing.assert_allclose(np.diag(both), 0, atol=1e-12)
    np.testing.assert_array_equal(both[:, 1], angle_between_deg(left, left[1]))


def test_lengths_by_hand():
    position_m = np.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, 12]])
    np.testing.assert_array_equal(step_lengths_m(position_m), [5, 0, 12])
    assert path_length_m(position_m) == 17.0
    np.testing.assert_array_equal(distance_along_m(position_m), [0, 5, 5, 17])


def test_a_single_point_has_no_length():
    position_m = np.ones((1, 3))
    assert step_lengths_m(position_m).shape == (0,)
    assert path_length_m(position_m) == 0.0
    np.testing.assert_array_equal(distance_along_m(position_m), [0.0])


def test_standard_gravity():
    assert STANDARD_GRAVITY_M_S2 == 9.80665
