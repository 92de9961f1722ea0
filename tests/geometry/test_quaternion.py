import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.helpers import to_numpy

from vioapr.geometry import quaternion as q

BATCHES = [(), (1,), (3, 1, 2)]
QUARTER_TURN_ABOUT_Z = np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)])


def random_quats(rng, batch):
    quats = rng.standard_normal((*batch, 4))
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def test_a_quarter_turn_about_z_takes_x_to_y():
    turned = q.rotate(QUARTER_TURN_ABOUT_Z, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(turned, [-2.0, 1.0, 3.0], atol=1e-15)


def test_a_quarter_turn_about_x_takes_1_2_3_to_1_minus3_2():
    quat = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    np.testing.assert_allclose(q.rotate(quat, np.array([1.0, 2.0, 3.0])), [1, -3, 2], atol=1e-15)


def test_hamilton_not_jpl():
    i, j, k = np.eye(4)[:3]
    np.testing.assert_array_equal(q.multiply(i, j), k)
    np.testing.assert_array_equal(q.multiply(j, i), -k)


@pytest.mark.parametrize("batch", BATCHES)
def test_group_laws(xp, rng, batch):
    a, b, c = (xp.asarray(random_quats(rng, batch)) for _ in range(3))
    identity = xp.asarray([0.0, 0.0, 0.0, 1.0], dtype=xp.float64)

    def same(left, right):
        np.testing.assert_allclose(to_numpy(left), to_numpy(right), atol=1e-14)
        assert tuple(left.shape) == (*batch, 4)

    same(q.multiply(a, xp.broadcast_to(identity, a.shape)), a)
    same(q.multiply(a, q.inverse(a)), xp.broadcast_to(identity, a.shape))
    same(q.multiply(q.multiply(a, b), c), q.multiply(a, q.multiply(b, c)))
    same(q.canonical(q.from_matrix(q.to_matrix(a))), q.canonical(a))
    same(q.canonical(q.from_rotvec(q.to_rotvec(a))), q.canonical(a))


def test_agrees_with_scipy(rng):
    a, b = random_quats(rng, (100,)), random_quats(rng, (100,))
    left, right = Rotation.from_quat(a), Rotation.from_quat(b)
    vectors = rng.standard_normal((100, 3))
    np.testing.assert_allclose(
        q.canonical(q.multiply(a, b)), (left * right).as_quat(canonical=True), atol=1e-14
    )
    np.testing.assert_allclose(q.to_matrix(a), left.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(q.rotate(a, vectors), left.apply(vectors), atol=1e-14)
    np.testing.assert_allclose(q.to_rotvec(a), left.as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(q.angle_rad(a), left.magnitude(), atol=1e-14)
    np.testing.assert_allclose(
        q.angle_between_deg(a, b), np.rad2deg((left.inv() * right).magnitude()), atol=1e-12
    )


@pytest.mark.parametrize("axis", range(3))
def test_matrix_of_a_half_turn(axis):
    half_turn = np.eye(4)[axis]
    np.testing.assert_allclose(q.from_matrix(q.to_matrix(half_turn)), half_turn, atol=1e-15)


def test_angle_is_exact_where_arccos_is_not():
    tiny = 1e-9
    quat = q.from_rotvec(np.array([tiny, 0.0, 0.0]))
    assert q.angle_rad(quat) == pytest.approx(tiny, rel=1e-12)
    assert q.to_rotvec(quat)[0] == pytest.approx(tiny, rel=1e-12)


def test_angle_ignores_the_sign():
    assert q.angle_rad(-QUARTER_TURN_ABOUT_Z) == pytest.approx(np.pi / 2)


def test_slerp_halves_the_angle_on_the_shorter_arc():
    start, end = np.array([0.0, 0, 0, 1]), -QUARTER_TURN_ABOUT_Z
    half = q.slerp(start, end, np.asarray(0.5))
    np.testing.assert_allclose(q.to_rotvec(half), [0, 0, np.pi / 4], atol=1e-15)
