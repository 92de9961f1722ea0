import numpy as np
import pytest

from vioapr.geometry import quaternion, rigid
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.simulation.court import (
    COUNT,
    HEADINGS_DEG,
    WALL_M,
    crossing_rows,
    moved_along,
    see_pairs,
    sequential_rows,
    walk_court,
)

FORWARD = np.array([0.0, 0.0, 1.0])


def test_cameras_look_outwards_from_their_circles(rng):
    walks = walk_court(rng)
    place = walks.world_from_cam.translation_m[:, :2]
    radius = np.linalg.norm(place, axis=1)
    np.testing.assert_allclose(radius, np.repeat([6.0, 7.0], COUNT))
    view = quaternion.rotate(walks.world_from_cam.quat_xyzw, FORWARD)
    across = np.linalg.norm(view[:, :2], axis=1)
    np.testing.assert_allclose((view[:, :2] * place).sum(axis=1) / radius / across, 1)


def test_worlds_have_their_headings_and_the_second_drifts(rng):
    walks = walk_court(rng, drift_deg=8.0)
    y_up = y_up_from_z_up(walks.world_from_cam)
    turn = quaternion.multiply(walks.vio_from_cam.quat_xyzw, quaternion.inverse(y_up.quat_xyzw))
    heading_deg = np.rad2deg(quaternion.to_rotvec(turn))
    np.testing.assert_allclose(heading_deg[:, [0, 2]], 0, atol=1e-6)
    first, last = heading_deg[[0, COUNT], 1], heading_deg[[COUNT - 1, -1], 1]
    np.testing.assert_allclose(first, HEADINGS_DEG)
    np.testing.assert_allclose(last, [HEADINGS_DEG[0], HEADINGS_DEG[1] + 8])


def test_a_jump_moves_the_second_half_of_the_second_walk():
    still, jumped = (
        walk_court(np.random.default_rng(1), jump_m=jump_m).vio_from_cam for jump_m in (0.0, 0.6)
    )
    moved_m = rigid.distance_m(still, jumped)
    np.testing.assert_allclose(moved_m, np.repeat([0, 0, 0, 0.6], COUNT // 2), atol=1e-9)


def test_two_views_by_hand():
    """A camera and one a metre to its right, turned to the left by 90 degrees."""
    turn = quaternion.from_rotvec(np.array([0.0, -np.pi / 2, 0.0]))
    poses = rigid.Rigid3(np.array([[0.0, 0, 0], [1, 0, 0]]), np.stack([[0, 0, 0, 1.0], turn]))
    views = see_pairs(poses, [(0, 1)], noise_deg=0.0)
    np.testing.assert_allclose(views.direction, [[1, 0, 0]])
    seen = quaternion.rotate(views.second_from_first[0], FORWARD)
    np.testing.assert_allclose(seen, [1, 0, 0], atol=1e-12)  # ahead is to the second's right
    np.testing.assert_allclose(views.turn_deg, np.degrees(2 * np.arctan(1 / WALL_M / 2)))


def test_noise_is_of_its_stated_size(rng):
    walks = walk_court(rng)
    rows = crossing_rows(1) * 20
    exact, noisy = (see_pairs(walks.world_from_cam, rows, noise) for noise in (0.0, 2.0))
    turned = quaternion.angle_between_deg(exact.second_from_first, noisy.second_from_first)
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(2 * np.sqrt(3), rel=0.1)


def test_pairs():
    rows = sequential_rows()
    assert len(rows) == 2 * (COUNT - 1 + COUNT - 2)
    assert all(a // COUNT == b // COUNT for a, b in rows)
    assert crossing_rows(10, 3) == [(0, 43), (10, 53), (20, 63), (30, 73)]


def test_moving_along_the_wall(rng):
    truth = walk_court(rng).world_from_cam
    moved = moved_along(truth, [3, 50], 4.0)
    seen = truth.inverse().at(3).apply(moved.translation_m[3])
    np.testing.assert_allclose(seen, [4, 0, 0], atol=1e-9)
    assert np.flatnonzero(rigid.distance_m(truth, moved) > 0).tolist() == [3, 50]
