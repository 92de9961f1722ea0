import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.geometry.vectors import STANDARD_GRAVITY_M_S2
from vioapr.simulation.courtyard.ground import LAWNS_M
from vioapr.simulation.courtyard.layout import LAMP_PLACES_M
from vioapr.simulation.courtyard.walks import (
    ENTRANCE_M,
    ROUTES_M,
    SWAY_M,
    closed_route,
    walk,
)


@pytest.fixture(scope="module")
def motion():
    return walk(np.random.default_rng(3), "around", 30.0)


def test_a_closed_route_is_measured_along_itself():
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    line, length = closed_route(5 * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    assert length == pytest.approx(2 * np.pi * 5, rel=1e-3)
    np.testing.assert_allclose(line(length / 4), [0, 5], atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(line(np.linspace(0, length, 50), 1), axis=1), 1, 0.01)


def test_it_is_walked_by_a_person(motion):
    times = np.linspace(0, 30, 600)
    position = motion.position_m(times)
    speed = np.linalg.norm(motion.position_m(times, 1)[:, :2], axis=1)
    assert 0.8 < np.median(speed) < 1.6
    assert speed.max() < 2.5
    assert 1.35 < position[:, 2].min() < position[:, 2].max() < 1.7
    assert np.linalg.norm(position[0, :2] - ENTRANCE_M) < 4


def test_it_bobs_twice_a_stride(motion):
    times = np.arange(0, 30, 0.02)
    height = motion.position_m(times)[:, 2]
    power = np.abs(np.fft.rfft(height - height.mean())) ** 2
    frequency = np.fft.rfftfreq(len(times), 0.02)
    steps = (frequency > 1.0) & (frequency < 3.0)
    peak = frequency[steps][power[steps].argmax()]
    speed = np.linalg.norm(motion.position_m(times, 1)[:, :2], axis=1).mean()
    assert peak == pytest.approx(2 * speed / 1.35, rel=0.25)


def test_the_phone_is_held_upright_and_looks_about(motion):
    quats = motion.world_from_cam(np.linspace(0, 30, 300)).quat_xyzw
    up = -quaternion.rotate(quats, np.array([0.0, 1.0, 0.0]))
    assert up[:, 2].min() > 0.9
    view = quaternion.rotate(quats, np.array([0.0, 0.0, 1.0]))
    ahead = motion.position_m(np.linspace(0, 30, 300), 1)[:, :2]
    cosine = (view[:, :2] * ahead).sum(axis=1) / np.linalg.norm(ahead, axis=1)
    assert np.median(cosine) > 0.5
    assert cosine.min() < 0.7


def test_velocities_are_those_of_the_poses(motion):
    times, step = np.linspace(1, 29, 50), 1e-4
    before, after = (motion.world_from_cam(times + sign * step) for sign in (-1, 1))
    turn = quaternion.multiply(quaternion.inverse(before.quat_xyzw), after.quat_xyzw)
    np.testing.assert_allclose(
        motion.angular_velocity_rad_s(times), quaternion.to_rotvec(turn) / (2 * step), atol=1e-5
    )


def test_the_imu_integrates_back_to_the_walk(motion):
    """Strapdown integration of gyroscope and accelerometer, by the midpoint rule."""
    times = np.arange(0, 10.005, 0.01)
    middle = (times[1:] + times[:-1]) / 2
    gyro, force = motion.angular_velocity_rad_s(middle), motion.specific_force_m_s2(middle)
    start = motion.world_from_cam(times[0])
    quat, position = start.quat_xyzw, start.translation_m.copy()
    velocity = motion.position_m(times[0], 1)
    for turn, felt in zip(0.01 * gyro, force, strict=True):
        half = quaternion.multiply(quat, quaternion.from_rotvec(turn / 2))
        acceleration = quaternion.rotate(half, felt) - np.array([0, 0, STANDARD_GRAVITY_M_S2])
        position += 0.01 * velocity + 0.5e-4 * acceleration
        velocity = velocity + 0.01 * acceleration
        quat = quaternion.multiply(quat, quaternion.from_rotvec(turn))
    end = motion.world_from_cam(times[-1])
    assert np.linalg.norm(position - end.translation_m) < 0.02
    assert quaternion.angle_between_deg(quat, end.quat_xyzw) < 0.05


@pytest.mark.parametrize("route", ROUTES_M)
def test_no_route_goes_through_things(route):
    line, length = closed_route(ROUTES_M[route])
    place, room = line(np.linspace(0, length, 2000)), SWAY_M + 0.15
    assert np.linalg.norm(place, axis=1).min() > 2.9 + room, "the fountain"
    for low, high in LAWNS_M:
        inside = ((place > np.subtract(low, room)) & (place < np.add(high, room))).all(axis=1)
        assert not inside.any(), "a lawn"
    for lamp in LAMP_PLACES_M:
        assert np.linalg.norm(place - lamp, axis=1).min() > 0.2 + room, f"the lamp at {lamp}"
    assert (np.abs(place) < np.subtract([18, 13], 0.7 + room)).all(), "a wall"


@pytest.mark.parametrize("backwards", [False, True])
def test_walkers_keep_to_the_route(backwards):
    motion = walk(np.random.default_rng(1), "around", 60.0, backwards=backwards)
    line, length = closed_route(ROUTES_M["around"])
    route = line(np.linspace(0, length, 4000))
    place = motion.position_m(np.linspace(0, 60, 300))[:, :2]
    apart = np.linalg.norm(place[:, None] - route[None], axis=-1).min(axis=1)
    assert 0.05 < apart.max() < SWAY_M
