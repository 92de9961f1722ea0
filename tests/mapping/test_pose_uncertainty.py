"""Stated standard deviations of poses: by hand, by drawing errors, and of what a map adds."""

import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.localization.uncertainty import (
    CHI2_MEDIAN,
    CHI2_P95,
    PoseSigmas,
    sigma_of_map,
    sigmas_of_pnp,
)

POSE = Rigid3(np.array([1.0, -2.0, 0.5]), quaternion.from_rotvec(np.array([0.3, -0.2, 0.9])))
FOCAL_PX = 300.0


def seen(world_from_cam, points_m):
    x, y, z = world_from_cam.inverse().apply(points_m).T
    return FOCAL_PX * np.column_stack([x / z, y / z])


def test_sigmas_are_those_of_solved_poses(rng):
    """Poses solved from pixels with errors scatter as stated, whatever the camera's pose."""
    points_m = POSE.apply(rng.uniform([-2, -2, 3], [2, 2, 6], (60, 3)))
    true = seen(POSE, points_m)
    columns = []
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-6
        turned = quaternion.multiply(POSE.quat_xyzw, quaternion.from_rotvec(step[3:]))
        moved = POSE.apply(step[:3])
        columns.append((seen(Rigid3(moved, turned), points_m) - true).ravel() / 1e-6)
    solve = np.linalg.pinv(np.stack(columns, axis=1))
    errors = np.stack([solve @ rng.normal(0, 0.5, true.size) for _ in range(4000)])
    expected_m = np.sqrt((errors[:, :3] ** 2).mean())
    expected_deg = np.degrees(np.sqrt((errors[:, 3:] ** 2).mean()))
    stated = [
        sigmas_of_pnp(POSE, points_m, rng.normal(0, 0.5, true.shape), FOCAL_PX) for _ in range(200)
    ]
    assert np.mean([s.position_m for s in stated]) == pytest.approx(expected_m, rel=0.05)
    assert np.mean([s.orientation_deg for s in stated]) == pytest.approx(expected_deg, rel=0.05)


def test_the_map_adds_what_errors_ask_for(rng):
    added, count = 0.03, 20_000
    sigma = rng.uniform(0.01, 0.05, count)
    scale = np.hypot(sigma, added)
    error = np.linalg.norm(rng.normal(size=(count, 3)) * scale[:, None], axis=1)
    assert sigma_of_map(error, sigma) == pytest.approx(added, rel=0.05)
    assert sigma_of_map(error, 3 * scale) == 0.0


def test_a_tail_asks_for_more():
    """One answer in ten is far off: the median alone would not see it."""
    error = np.full(100, 0.001)
    error[::10] = 0.1
    found = sigma_of_map(error, np.full(100, 0.001))
    assert found == pytest.approx(0.1 / np.sqrt(CHI2_P95), rel=0.01)


def test_constants_of_the_distribution(rng):
    squared = (rng.normal(size=(200_000, 3)) ** 2).sum(axis=1)
    assert np.median(squared) == pytest.approx(CHI2_MEDIAN, rel=0.01)
    assert np.quantile(squared, 0.95) == pytest.approx(CHI2_P95, rel=0.01)


def test_errors_add_by_their_squares():
    assert PoseSigmas(0.3, 4.0).and_of_map(PoseSigmas(0.4, 3.0)) == PoseSigmas(0.5, 5.0)
    assert np.isnan(PoseSigmas(0.3, 4.0).and_of_map(PoseSigmas(np.nan, np.nan))).all()
