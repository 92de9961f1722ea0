import numpy as np
from tests.court import joined, make_court, pairs_of

from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.two_view import between_worlds_deg, estimate_distances_m
from vioapr.mapping.verification import fits
from vioapr.simulation.court import COUNT, crossing_rows, sequential_rows

STRAIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def test_distances_are_known_by_those_of_neighbours(rng):
    images, truth = make_court(rng)
    found = joined(pairs_of(truth, sequential_rows()), pairs_of(truth, crossing_rows()))
    first, second = found.rows.T
    true_m = rigid.distance_m(truth.at(first), truth.at(second))
    np.testing.assert_allclose(estimate_distances_m(images, found), true_m, rtol=0.05)


def test_distances_without_neighbours_are_unknown(rng):
    images, truth = make_court(rng)
    assert np.isnan(estimate_distances_m(images, pairs_of(truth, crossing_rows()))).all()
    one_side = [row for row in sequential_rows() if row[0] < COUNT]
    found = joined(pairs_of(truth, one_side), pairs_of(truth, crossing_rows()))
    assert np.isfinite(estimate_distances_m(images, found)).all()


def test_heading_and_tilt_between_worlds(rng):
    """The second world is turned by -80 - 15 deg against the first."""
    images, truth = make_court(rng, drift_deg=0.0)
    exact = pairs_of(truth, crossing_rows(), noise_deg=0.0)
    heading, tilt = between_worlds_deg(exact, images.vio_from_cam)
    np.testing.assert_allclose(heading, 95, atol=1e-6)
    np.testing.assert_allclose(tilt, 0, atol=1e-5)


def rays_to(points, camera_from_first: Rigid3):
    seen = camera_from_first.apply(points)
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)


def test_rays_that_meet(rng):
    points = rng.uniform([-3, -2, 6], [3, 2, 9], (50, 3))
    first_from_second = Rigid3(np.array([1.0, 0.0, 0.2]), np.array([0.0, 0.1, 0.0, 0.995]))
    first = rays_to(points, Rigid3(np.zeros(3), STRAIGHT))
    second = rays_to(points, first_from_second.inverse())
    assert fits(first, second, first_from_second).all()
    # The next window, three metres on: seen along the same level lines, but behind the cameras.
    window = rays_to(points + np.array([3.0, 0.0, 0.0]), first_from_second.inverse())
    assert fits(first, window, first_from_second).mean() < 0.2
    other = rays_to(rng.permutation(points), first_from_second.inverse())
    assert fits(first, other, first_from_second).mean() < 0.3


def test_rays_from_one_place():
    first = np.array([[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])
    same = Rigid3(np.zeros(3), STRAIGHT)
    assert fits(first, first, same).all()
    assert fits(first, first[::-1], same).tolist() == [False, False]
