import numpy as np
import pytest
from tests.helpers import random_rigid, to_numpy

from vioapr.geometry import frames, rigid
from vioapr.geometry.rigid import Rigid3

BATCHES = [(), (1,), (3, 1, 2)]


def matrices(transform):
    return to_numpy(transform.to_matrix())


@pytest.mark.parametrize("batch", BATCHES)
def test_transforms_compose_as_matrices_do(xp, rng, batch):
    a_from_b, b_from_c = random_rigid(rng, batch, xp), random_rigid(rng, batch, xp)
    np.testing.assert_allclose(
        matrices(a_from_b @ b_from_c), matrices(a_from_b) @ matrices(b_from_c), atol=1e-14
    )
    np.testing.assert_allclose(
        matrices(a_from_b.inverse()), np.linalg.inv(matrices(a_from_b)), atol=1e-14
    )
    np.testing.assert_allclose(
        matrices(rigid.between(a_from_b, b_from_c)),
        np.linalg.inv(matrices(a_from_b)) @ matrices(b_from_c),
        atol=1e-14,
    )
    identity = Rigid3.identity(batch, like=a_from_b.translation_m)
    np.testing.assert_array_equal(matrices(identity), np.broadcast_to(np.eye(4), (*batch, 4, 4)))
    assert identity.batch_shape == batch


def test_from_matrix_inverts_to_matrix(rng):
    transform = random_rigid(rng, (5,))
    again = Rigid3.from_matrix(transform.to_matrix())
    np.testing.assert_allclose(matrices(again), matrices(transform), atol=1e-14)


@pytest.mark.parametrize("batch", BATCHES)
def test_known_poses_are_those_without_nan(xp, rng, batch):
    known = random_rigid(rng, batch, xp)
    assert to_numpy(known.is_known).shape == batch
    assert to_numpy(known.is_known).all()
    assert Rigid3.unknown(batch).batch_shape == batch
    assert not Rigid3.unknown(batch).is_known.any()
    np.testing.assert_array_equal(
        rigid.stack([Rigid3.unknown(), Rigid3.identity()]).is_known, [0, 1]
    )


def test_distance_and_angle_by_hand():
    here = Rigid3(np.zeros(3), np.array([0.0, 0, 0, 1]))
    there = Rigid3(np.array([3.0, 4.0, 0.0]), np.array([0, 0, np.sqrt(0.5), np.sqrt(0.5)]))
    assert rigid.distance_m(here, there) == 5.0
    assert rigid.angle_deg(here, there) == pytest.approx(90.0)
    halfway = rigid.interpolate(here, there, np.asarray(0.5))
    np.testing.assert_allclose(halfway.translation_m, [1.5, 2.0, 0.0])
    assert rigid.angle_deg(here, halfway) == pytest.approx(45.0)


def test_opengl_camera_looks_along_its_minus_z():
    # An OpenGL camera at the origin of a y-up world looks along -z; so must ours, along +z_cam.
    world_from_cam = frames.cam_from_arcam(Rigid3.identity())
    np.testing.assert_allclose(world_from_cam.apply(np.array([0.0, 0, 1])), [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(world_from_cam.apply(np.array([0.0, 1, 0])), [0, -1, 0], atol=1e-15)
    again = frames.cam_from_arcam(world_from_cam)
    assert rigid.angle_deg(again, Rigid3.identity()) == pytest.approx(0, abs=1e-12)


def test_y_up_and_z_up_worlds():
    up_in_y_world = Rigid3(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0, 0, 1]))
    z_up = frames.z_up_from_y_up(up_in_y_world)
    np.testing.assert_allclose(z_up.translation_m, [1, -3, 2], atol=1e-15)
    back = frames.y_up_from_z_up(z_up)
    np.testing.assert_allclose(matrices(back), matrices(up_in_y_world), atol=1e-15)


@pytest.mark.parametrize(
    ("mirror", "axis"), [(frames.mirror_y, 1), (frames.mirror_z, 2)], ids=["y", "z"]
)
def test_mirroring_is_conjugation_by_the_mirror(rng, mirror, axis):
    pose = random_rigid(rng, (4,))
    reflection = np.eye(4)
    reflection[axis, axis] = -1
    expected = reflection @ matrices(pose) @ reflection
    np.testing.assert_allclose(matrices(mirror(pose)), expected, atol=1e-14)
    np.testing.assert_allclose(matrices(mirror(mirror(pose))), matrices(pose), atol=1e-14)
