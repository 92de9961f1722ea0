import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.simulation.courtyard.devices import (
    ORIGIN,
    geodetic,
    measure_gnss,
    measure_heading,
    measure_imu,
)
from vioapr.simulation.courtyard.walks import walk


@pytest.fixture(scope="module")
def motion():
    return walk(np.random.default_rng(5), "figure eight", 60.0)


def test_the_imu_is_the_motion_with_bias_and_noise(rng, motion):
    imu = measure_imu(rng, motion, 60.0)
    np.testing.assert_allclose(np.diff(imu.timestamp_s), 0.01, atol=1e-9)
    assert imu.timestamp_s[-1] == pytest.approx(60.0)
    accel = imu.accel_m_s2 - motion.specific_force_m_s2(imu.timestamp_s)
    gyro = imu.gyro_rad_s - motion.angular_velocity_rad_s(imu.timestamp_s)
    assert 0.018 < accel.std(axis=0).min() < accel.std(axis=0).max() < 0.03
    assert np.abs(accel.mean(axis=0)).max() < 0.15
    assert 0.0012 < gyro.std(axis=0).min() < gyro.std(axis=0).max() < 0.002
    assert np.abs(gyro.mean(axis=0)).max() < 0.015
    # On average the phone is held up: what it feels is gravity, against y, which is down.
    assert imu.accel_m_s2.mean(axis=0)[1] == pytest.approx(-9.8, abs=0.3)


def test_geodetic_coordinates_are_of_a_plane_that_touches_the_ellipsoid():
    """At latitude 48 a degree is 111.2 km northwards and 74.6 km eastwards."""
    latitude, longitude, altitude = geodetic(np.array([[0, 0, 0], [0, 111.2, 0], [74.6, 0, 5.0]]))
    assert (latitude[0], longitude[0], altitude[0]) == (48.0, 11.0, 520.0)
    assert latitude[1] - ORIGIN.latitude_deg == pytest.approx(0.001, rel=1e-3)
    assert longitude[2] - ORIGIN.longitude_deg == pytest.approx(0.001, rel=1e-3)
    assert altitude[2] == 525.0


def test_gnss_is_metres_off_and_stays_so(motion):
    errors = []
    for seed in range(20):
        gnss = measure_gnss(np.random.default_rng(seed), motion, 60.0)
        exact = geodetic(motion.position_m(gnss.timestamp_s))
        errors.append((gnss.latitude_deg - exact[0]) * 111.2e3)
    errors = np.array(errors)
    assert 1.5 < errors.std() < 4.5
    assert np.corrcoef(errors[:, :-1].ravel(), errors[:, 1:].ravel())[0, 1] > 0.9


def test_the_compass_is_degrees_off(motion):
    heading = measure_heading(np.random.default_rng(2), motion, 60.0)
    view = quaternion.rotate(
        motion.world_from_cam(heading.timestamp_s).quat_xyzw, np.array([0.0, 0.0, 1.0])
    )
    # North is y, east is x, and headings are clockwise.
    rad = np.deg2rad(heading.heading_deg)
    cosine = (np.sin(rad) * view[:, 0] + np.cos(rad) * view[:, 1]) / np.linalg.norm(
        view[:, :2], axis=1
    )
    error_deg = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
    assert 0.5 < np.median(error_deg) < 15
    assert ((heading.heading_deg >= 0) & (heading.heading_deg < 360)).all()
