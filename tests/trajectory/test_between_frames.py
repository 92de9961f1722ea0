import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory, interpolate_between_frames


def walk(times, position_m=None, turn_deg=None):
    times = np.asarray(times, dtype=float)
    if position_m is None:
        position_m = np.outer(times, [1.0, 0.0, 0.5])
    angles = 20 * times if turn_deg is None else np.asarray(turn_deg, dtype=float)
    quats = quaternion.from_rotvec(np.outer(np.deg2rad(angles), [0.0, 0.0, 1.0]))
    return Trajectory.from_arrays(times, position_m, quats)


@pytest.mark.parametrize("rate_hz", [2, 10, 30, 200])
def test_even_motion_is_interpolated_exactly(rate_hz):
    track = walk(np.arange(0, 4 * rate_hz) / rate_hz)
    at = np.array([0.013, 1.71, 2.0, 0.6])
    poses, is_known = interpolate_between_frames(track, at)
    assert is_known.all()
    np.testing.assert_allclose(poses.translation_m, np.outer(at, [1, 0, 0.5]), atol=1e-12)
    turn_deg = np.rad2deg(quaternion.to_rotvec(poses.quat_xyzw)[:, 2])
    np.testing.assert_allclose(turn_deg, 20 * at, atol=1e-9)


def test_nothing_is_extrapolated():
    poses, is_known = interpolate_between_frames(walk([1.0, 1.1, 1.2]), np.array([0.99, 1.21, 1.2]))
    assert is_known.tolist() == [False, False, True]
    np.testing.assert_array_equal(poses.translation_m[:2], 0)
    np.testing.assert_array_equal(poses.quat_xyzw[:2], [[0, 0, 0, 1]] * 2)


def test_a_lost_tracker_is_not_interpolated():
    times = np.delete(np.arange(60) / 30, slice(20, 24))  # 5 steps without a frame: 0.17 s
    _, is_known = interpolate_between_frames(walk(times), np.array([0.61, 0.7, 0.81]))
    assert is_known.tolist() == [True, False, True]
    times = np.delete(np.arange(20) / 2, 7)  # one frame of a slow tracker: 1 s
    _, is_known = interpolate_between_frames(walk(times), np.array([2.7, 3.2, 4.2]))
    assert is_known.tolist() == [True, False, True]


def test_a_slow_tracker_is_not_interpolated():
    _, is_known = interpolate_between_frames(walk(np.arange(9.0)), np.array([2.5]))
    assert not is_known.any()


@pytest.mark.parametrize("rate_hz", [2, 30])
@pytest.mark.parametrize("kind", ["moves", "turns"])
def test_a_reset_is_not_interpolated(rate_hz, kind):
    times = np.arange(4 * rate_hz) / rate_hz
    is_after = times >= 2
    position_m = np.outer(times, [1.0, 0, 0]) + np.outer(is_after, [8.0 * (kind == "moves"), 0, 0])
    track = walk(times, position_m, 20 * times + 120 * is_after * (kind == "turns"))
    at = np.array([1.4, 2 - 0.3 / rate_hz, 2.1])
    assert interpolate_between_frames(track, at)[1].tolist() == [True, False, True]


def test_a_track_in_centimetres_is_no_row_of_resets():
    times = np.arange(60) / 30
    _, is_known = interpolate_between_frames(
        walk(times, np.outer(times, [2000.0, 0, 0])), np.array([0.51])
    )
    assert is_known.all()


def test_a_single_frame_has_no_neighbours():
    poses, is_known = interpolate_between_frames(walk([1.0]), np.array([0.5, 1.0]))
    assert not is_known.any()
    assert poses.batch_shape == (2,)
