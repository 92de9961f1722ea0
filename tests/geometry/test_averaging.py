import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from tests.helpers import to_numpy

from vioapr.errors import ParameterError
from vioapr.geometry import quaternion
from vioapr.geometry.averaging import geometric_median, mean_quaternion
from vioapr.geometry.umeyama import align_umeyama

BATCHES = [(), (1,), (3, 4)]


def test_median_of_an_equilateral_triangle_is_its_centre():
    angles = np.array([0, 2, 4]) * np.pi / 3
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1) + 5
    np.testing.assert_allclose(geometric_median(points, np.ones(3)), [5, 5, 5], atol=1e-12)


def test_median_ignores_a_far_outlier_as_the_mean_does_not():
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [100, 0, 0]])
    assert np.linalg.norm(geometric_median(points, np.ones(5))) < 0.1


def test_median_where_points_coincide():
    points = np.ones((4, 3))
    np.testing.assert_allclose(geometric_median(points, np.ones(4)), np.ones(3), atol=1e-15)


def test_median_minimizes_the_sum_of_distances(rng):
    for _ in range(20):
        points = rng.standard_normal((6, 3))
        found = minimize(
            lambda y, p=points: np.linalg.norm(p - y, axis=1).sum(),
            points.mean(0),
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000},
        )
        np.testing.assert_allclose(
            geometric_median(points, np.ones(6), iterations=300), found.x, atol=1e-5
        )


@pytest.mark.parametrize("batch", BATCHES)
def test_zero_weights_leave_points_out(xp, rng, batch):
    points = rng.standard_normal((*batch, 5, 3))
    weights = np.broadcast_to([1.0, 1, 1, 0, 0], (*batch, 5)).copy()
    median = geometric_median(xp.asarray(points), xp.asarray(weights))
    few = geometric_median(points[..., :3, :], np.ones((*batch, 3)))
    np.testing.assert_allclose(to_numpy(median), few, atol=1e-12)


@pytest.mark.parametrize("batch", BATCHES)
def test_mean_quaternion_agrees_with_scipy(xp, rng, batch):
    quats = quaternion.normalize(rng.standard_normal((*batch, 5, 4)) * 0.3 + [0, 0, 0, 1])
    quats *= rng.choice([-1, 1], size=(*batch, 5, 1))
    weights = rng.uniform(0.1, 1, (*batch, 5))
    mean = to_numpy(mean_quaternion(xp.asarray(quats), xp.asarray(weights)))
    for index in np.ndindex(*batch):
        expected = Rotation.from_quat(quats[index]).mean(weights[index]).as_quat(canonical=True)
        np.testing.assert_allclose(quaternion.canonical(mean[index]), expected, atol=1e-9)


def test_mean_of_two_turns_is_halfway():
    turns = quaternion.from_rotvec(np.array([[0.0, 0, 0.2], [0.0, 0, 0.6]]))
    mean = mean_quaternion(turns, np.ones(2))
    np.testing.assert_allclose(quaternion.to_rotvec(mean), [0, 0, 0.4], atol=1e-12)


def test_mean_of_opposite_components_does_not_cancel():
    quat = np.array([[1.0, -1, 0, 0]]) / np.sqrt(2)
    np.testing.assert_allclose(np.abs(mean_quaternion(quat, np.ones(1))), np.abs(quat[0]))


@pytest.mark.parametrize("with_scale", [False, True])
@pytest.mark.parametrize("batch", BATCHES)
def test_umeyama_finds_the_transform(xp, rng, batch, with_scale):
    scale = 1.7 if with_scale else 1.0
    quat = quaternion.normalize(rng.standard_normal((*batch, 4)))
    offset = rng.standard_normal((*batch, 3))
    source = rng.standard_normal((*batch, 8, 3))
    target = scale * quaternion.rotate(quat[..., None, :], source) + offset[..., None, :]
    found = align_umeyama(xp.asarray(source), xp.asarray(target), with_scale=with_scale)
    np.testing.assert_allclose(to_numpy(found.scale), scale, atol=1e-12)
    np.testing.assert_allclose(to_numpy(found.rigid.translation_m), offset, atol=1e-12)
    np.testing.assert_allclose(
        to_numpy(found.rigid.quat_xyzw), quaternion.canonical(quat), atol=1e-12
    )


def test_umeyama_never_mirrors(rng):
    source = rng.standard_normal((10, 3))
    found = align_umeyama(source, source * [1, 1, -1])
    assert np.linalg.det(quaternion.to_matrix(found.rigid.quat_xyzw)) == pytest.approx(1)


@pytest.mark.parametrize(
    ("points", "message"),
    [(np.zeros((2, 3)), "at least 3 points, got 2"), (np.outer(np.arange(5.0), [1, 2, 3]), "line")],
)
def test_umeyama_says_why_it_cannot(points, message):
    with pytest.raises(ParameterError, match=message):
        align_umeyama(points, points)
