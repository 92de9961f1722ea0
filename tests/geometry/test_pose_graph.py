"""Residuals by finite differences, both solvers against each other, and a graph done by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.helpers import random_rigid

from vioapr.geometry.pose_graph import (
    Factors,
    gauss_newton,
    geman_mcclure,
    motion_residual,
    perturb,
    prior_residual,
    solve_dense,
    solve_sparse,
    to_dense,
    turn_between,
)
from vioapr.geometry.rigid import Rigid3, angle_deg, between, distance_m

SIGMA_M, SIGMA_RAD = 0.3, 0.05


def derivative(function, poses):
    """By the tangent vectors of poses, central differences, shape (..., 6, 6)."""
    columns = []
    for axis in np.eye(6):
        step = np.broadcast_to(1e-6 * axis, (*poses.batch_shape, 6))
        columns.append((function(perturb(poses, step)) - function(perturb(poses, -step))) / 2e-6)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("shape", [(), (1,), (3, 1, 2)])
def test_derivatives_of_residuals(rng, shape):
    first, second, other = (random_rigid(rng, shape) for _ in range(3))

    def prior(pose):
        return prior_residual(pose, other, SIGMA_M, SIGMA_RAD)

    def motion(a, b):
        return motion_residual(a, b, other, SIGMA_M, SIGMA_RAD)

    residual, by_pose = prior(first)
    assert residual.shape == (*shape, 6)
    tolerance = {"atol": 1e-5, "rtol": 1e-5}
    numeric = derivative(lambda pose: prior(pose)[0], first)
    np.testing.assert_allclose(by_pose, numeric, **tolerance)
    residual, by_first, by_second = motion(first, second)
    assert residual.shape == (*shape, 6)
    numeric = derivative(lambda pose: motion(pose, second)[0], first)
    np.testing.assert_allclose(by_first, numeric, **tolerance)
    numeric = derivative(lambda pose: motion(first, pose)[0], second)
    np.testing.assert_allclose(by_second, numeric, **tolerance)


def test_residuals_are_0_where_all_agree(rng):
    first, second = (random_rigid(rng, (4,)) for _ in range(2))
    assert np.abs(prior_residual(first, first, 1, 1)[0]).max() < 1e-12
    measured = between(first, second)
    assert np.abs(motion_residual(first, second, measured, 1, 1)[0]).max() < 1e-12


def test_the_turn_between_is_a_rotation_vector(rng):
    a, b = (random_rigid(rng, (5,)).quat_xyzw for _ in range(2))
    expected = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).as_rotvec()
    np.testing.assert_allclose(turn_between(a, b), expected, atol=1e-9)


def on_a_line(positions_m):
    """Constraints on the x of two poses of one degree of freedom: two priors and a distance."""
    x = positions_m
    one, two = np.array([0]), np.array([1])
    jacobian = np.ones((1, 1, 1))
    return [
        Factors(np.array([[x[0] - 0.0]]), (one,), (jacobian,)),
        Factors(np.array([[x[1] - 4.0]]), (two,), (jacobian,)),
        Factors(np.array([[x[1] - x[0] - 1.0]]), (one, two), (-jacobian, jacobian)),
    ]


@pytest.mark.parametrize("solve", [solve_dense, solve_sparse])
def test_a_graph_by_hand(solve):
    """Priors at 0 and 4, a distance of 1 between: each gives way by 1."""
    step = solve(on_a_line(np.zeros(2)), 2)
    np.testing.assert_allclose(step[:, 0], [1.0, 3.0], atol=1e-5)


def test_weights_count():
    """With the distance weighted 1/2, the sum of squares is least where each prior gives 3/4."""
    *priors, distance = on_a_line(np.zeros(2))
    step = solve_sparse([*priors, distance._replace(weight=np.array([0.5]))], 2)
    np.testing.assert_allclose(step[:, 0], [0.75, 3.25], atol=1e-5)


def test_dense_and_sparse_agree_on_a_loop(rng):
    """Twelve poses, motions between neighbours and around the loop, and priors on some."""
    truth = random_rigid(rng, (12,))
    nodes = np.arange(12), np.roll(np.arange(12), -1)
    measured = between(truth.at(nodes[0]), truth.at(nodes[1]))
    measured = perturb(measured, 0.02 * rng.standard_normal((12, 6)))
    known = np.array([0, 5])

    def linearize(poses):
        residual, by_first, by_second = motion_residual(
            poses.at(nodes[0]), poses.at(nodes[1]), measured, SIGMA_M, SIGMA_RAD
        )
        prior, by_pose = prior_residual(poses.at(known), truth.at(known), 0.01, 0.01)
        return [
            Factors(residual, nodes, (by_first, by_second)),
            Factors(prior, (known,), (by_pose,)),
        ]

    start = perturb(truth, 0.1 * rng.standard_normal((12, 6)))
    found = [gauss_newton(start, linearize, perturb, s, 8) for s in (solve_dense, solve_sparse)]
    assert distance_m(*found).max() < 1e-6
    assert angle_deg(*found).max() < 1e-5
    residual, jacobian = to_dense(linearize(found[0]), 12)
    assert np.abs(jacobian.T @ residual).max() < 1e-6  # an optimum


def test_batches_are_as_one_by_one(rng):
    truth = random_rigid(rng, (3, 4))
    start = perturb(truth, 0.1 * rng.standard_normal((3, 4, 6)))

    def linearize_to(prior):
        def linearize(poses):
            residual, by_pose = prior_residual(poses, prior, SIGMA_M, SIGMA_RAD)
            return [Factors(residual, (np.arange(4),), (by_pose,))]

        return linearize

    together = gauss_newton(start, linearize_to(truth), perturb, solve_dense, 3)
    assert distance_m(together, truth).max() < 1e-9
    for row in range(3):
        one = linearize_to(Rigid3(*(part[row] for part in truth)))
        alone = gauss_newton(start.at(row), one, perturb, solve_dense, 3)
        np.testing.assert_allclose(together.translation_m[row], alone.translation_m, atol=1e-12)


def test_weights_of_geman_and_mcclure():
    lengths = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 50.0]])
    np.testing.assert_allclose(geman_mcclure(lengths, 5.0), [1, 0.25, 1 / 101**2])
