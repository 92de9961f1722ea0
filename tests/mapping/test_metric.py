import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.helpers import random_rigid

from vioapr.errors import MappingError
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping import metric

UP_IN_VIO = np.array([0.0, 1.0, 0.0])


def wander(rng, count=100):
    """Poses along a smooth path of some metres."""
    positions = np.cumsum(0.2 * rng.standard_normal((count, 3)), axis=0)
    return Rigid3(positions, random_rigid(rng, (count,)).quat_xyzw)


def seen_by_vio(model_from_cam, metres_per_unit, rng):
    """The same cameras in a tracking world of another place, heading and unit."""
    turn = random_rigid(rng)
    poses = Rigid3(metres_per_unit * model_from_cam.translation_m, model_from_cam.quat_xyzw)
    return turn @ poses, turn


def estimate(model, vio, worlds=None, times=None):
    count = len(model.translation_m)
    worlds = np.zeros(count, dtype=int) if worlds is None else worlds
    times = np.arange(count) / 2 if times is None else times
    return metric.estimate_scales(model, vio, worlds, times)


def test_scale_of_a_perfect_tracker(rng):
    model = wander(rng)
    vio, _ = seen_by_vio(model, 0.25, rng)
    (scale,) = estimate(model, vio)
    assert scale.metres_per_unit == pytest.approx(0.25)
    assert scale.sigma < 1e-9


def test_scale_survives_jumps_and_drift(rng):
    """Half-way, the tracker jumps by 3 m; it turns by 20 deg along the way."""
    model = wander(rng, 200)
    vio, _ = seen_by_vio(model, 2.0, rng)
    turns = Rotation.from_euler("y", np.linspace(0, 20, 200)[:, None], degrees=True)
    positions = turns.apply(vio.translation_m)
    positions[100:] += [3.0, 0.0, 0.0]
    (scale,) = estimate(model, vio._replace(translation_m=positions))
    assert scale.metres_per_unit == pytest.approx(2.0, rel=0.02)


def test_tracking_worlds_are_told_apart_and_outliers_left_out(rng):
    model = wander(rng, 200)
    worlds = np.repeat([0, 1, 2, 3], 50)
    vio, _ = seen_by_vio(model, 1.0, rng)
    factor = np.array([1.01, 0.99, 1.0, 1.5])[worlds]
    vio = vio._replace(translation_m=vio.translation_m * factor[:, None])
    scales = estimate(model, vio, worlds)
    np.testing.assert_allclose(
        [s.metres_per_unit for s in scales], [1.01, 0.99, 1.0, 1.5], rtol=1e-9
    )
    assert [s.is_used for s in scales] == [True, True, True, False]
    assert metric.mean_scale(scales) == pytest.approx(1.0, abs=0.01)


def test_few_or_still_images_say_nothing(rng):
    model = wander(rng, 4)
    vio, _ = seen_by_vio(model, 1.0, rng)
    assert estimate(model, vio) == []
    still = Rigid3(np.zeros((50, 3)), model.quat_xyzw[[0] * 50])
    assert estimate(still, still) == []
    with pytest.raises(MappingError, match="scale is not known"):
        metric.mean_scale([])


def test_up_is_robust_and_its_spread_is_right(rng):
    model = wander(rng, 400)
    vio, vio_from_model = seen_by_vio(model, 1.0, rng)
    noise = Rotation.from_rotvec(np.radians(1.0) * rng.standard_normal((400, 3)))
    noisy = (Rotation.from_quat(vio.quat_xyzw) * noise).as_quat()
    noisy[:40] = random_rigid(rng, (40,)).quat_xyzw  # a tenth is nonsense
    gravity = metric.estimate_gravity(model, vio._replace(quat_xyzw=noisy), np.repeat([0, 1], 200))
    up = quaternion.rotate(vio_from_model.inverse().quat_xyzw, UP_IN_VIO)
    assert np.degrees(np.arccos(gravity.up @ up)) < 0.2
    # The median length of two normal components, a little more for the nonsense.
    assert gravity.spread_deg == pytest.approx(np.sqrt(2 * np.log(2)), rel=0.2)
    assert set(gravity.world_offset_deg) == {0, 1}


def test_the_world_is_vios_with_z_up(rng):
    """A model that is the tracking world itself, in other units: the world is known by hand."""
    vio = wander(rng, 30)
    model = vio._replace(translation_m=vio.translation_m / 5)
    world_from_model = metric.align_with_world(model, vio, 5.0, UP_IN_VIO)
    placed = world_from_model.apply_to(model)
    x, y, z = vio.translation_m.T
    np.testing.assert_allclose(placed.translation_m, np.column_stack([x, -z, y]), atol=1e-6)
    up = quaternion.rotate(world_from_model.rigid.quat_xyzw, UP_IN_VIO)
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("up", [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
def test_any_up_becomes_z(rng, up):
    vio, model = wander(rng, 30), wander(rng, 30)
    placed = metric.align_with_world(model, vio, 1.0, np.array(up))
    np.testing.assert_allclose(
        quaternion.rotate(placed.rigid.quat_xyzw, np.array(up)), [0, 0, 1], atol=1e-9
    )


def test_jumps_hardly_move_the_world(rng):
    model = wander(rng, 100)
    vio, vio_from_model = seen_by_vio(model, 1.0, rng)
    up = quaternion.rotate(vio_from_model.inverse().quat_xyzw, UP_IN_VIO)
    clean = metric.align_with_world(model, vio, 1.0, up)
    jumped = Rigid3(vio.translation_m.copy(), vio.quat_xyzw)
    jumped.translation_m[80:] += [50.0, 0.0, 0.0]
    moved = metric.align_with_world(model, jumped, 1.0, up)
    assert rigid.distance_m(clean.rigid, moved.rigid) < 0.05
    assert rigid.angle_deg(clean.rigid, moved.rigid) < 1e-6
