import numpy as np
import pytest

from vioapr.errors import AssociationError, ParameterError
from vioapr.trajectory import Trajectory, associate, poses_of_frames


def make(times, names=None, is_timed=True):
    count = len(times)
    quats = np.tile([0.0, 0, 0, 1], (count, 1))
    positions = np.outer(times, [1.0, 0, 0])
    return Trajectory.from_arrays(times, positions, quats, names, is_timed=is_timed)


def pairs(left, right, tolerance_s=0.01):
    found = associate(left, right, tolerance_s)
    return list(zip(found.left_rows.tolist(), found.right_rows.tolist(), strict=True))


def test_association_is_one_to_one_and_takes_the_nearest():
    left, right = make([0.0, 1.0, 2.0]), make([0.004, 0.996, 1.003, 5.0])
    assert pairs(left, right) == [(0, 0), (1, 2)]


def test_poses_of_frames():
    known = make([0.004, 0.996, 1.003, 5.0], ["a", "b", "c", "d"])
    by_time = poses_of_frames(known, np.array([0.0, 1.0, 2.0]))
    np.testing.assert_array_equal(by_time.translation_m[:, 0], [0.004, 1.003, np.nan])
    np.testing.assert_array_equal(by_time.quat_xyzw[:, 3], [1, 1, np.nan])
    by_name = poses_of_frames(known, None, ["d", "e", "a", "b", "c"])
    np.testing.assert_array_equal(by_name.translation_m[:, 0], [5.0, np.nan, 0.004, 0.996, 1.003])
    assert poses_of_frames(known, np.zeros(0)).translation_m.shape == (0, 3)
    with pytest.raises(AssociationError, match="not both have image names"):
        poses_of_frames(known, None)


def test_association_keeps_to_the_tolerance():
    left, right = make([0.0, 1.0]), make([0.011, 1.009])
    assert pairs(left, right) == [(1, 1)]
    assert pairs(left, right, 0.02) == [(0, 0), (1, 1)]
    assert pairs(left, make([10.0, 11.0])) == []


def test_association_of_a_slow_with_a_fast_stream():
    fast, slow = make(np.arange(600) / 60), make(np.arange(10.0))
    assert pairs(slow, fast) == [(i, 60 * i) for i in range(10)]


def test_association_by_name_without_a_clock():
    left = make([0, 1, 2], ["a", "b", "c"], is_timed=False)
    assert pairs(left, make([0, 1], ["c", "a"], is_timed=False)) == [(0, 1), (2, 0)]
    with pytest.raises(AssociationError, match="no timestamps"):
        associate(left, make([0, 1], is_timed=False))


@pytest.mark.parametrize("tolerance_s", [-0.1, float("nan")])
def test_association_refuses_a_bad_tolerance(tolerance_s):
    with pytest.raises(ParameterError, match="tolerance"):
        associate(make([0.0]), make([0.0]), tolerance_s)


def test_interpolation_by_hand():
    quats = [[0, 0, 0, 1], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]]
    walk = Trajectory.from_arrays([0.0, 2.0], [[0, 0, 0], [4, 0, 2]], quats)
    middle = walk.interpolate([0.5, 1.0, 2.0])
    np.testing.assert_allclose(middle.position_m, [[1, 0, 0.5], [2, 0, 1], [4, 0, 2]])
    angles = 2 * np.arctan2(middle.quat_xyzw[:, 2], middle.quat_xyzw[:, 3])
    np.testing.assert_allclose(angles, np.pi / 2 * np.array([0.25, 0.5, 1.0]))
    with pytest.raises(ParameterError, match="covers 0.000000 s to 2.000000 s"):
        walk.interpolate([2.1])


def test_interpolation_of_a_single_pose():
    np.testing.assert_allclose(make([3.0]).interpolate([3.0]).position_m, [[3, 0, 0]])


@pytest.mark.parametrize(
    ("times", "position", "quat", "message"),
    [
        ([0.0, 1.0], np.nan, [0, 0, 0, 1], "pose 2: expected finite numbers"),
        ([0.0, 1.0], 0.0, [0, 0, 0, 0], "unit quaternion, got one of norm 0"),
        ([0.0, 1.0], 0.0, [0, 0, 0, 2], "unit quaternion, got one of norm 2"),
        ([1.0, 1.0], 0.0, [0, 0, 0, 1], "a duplicate of the one before"),
        ([2.0, 1.0], 0.0, [0, 0, 0, 1], "earlier than the one before"),
        ([0.0, np.inf], 0.0, [0, 0, 0, 1], "finite"),
    ],
)
def test_a_bad_pose_is_named(times, position, quat, message):
    positions = [[0, 0, 0], [position, 0, 0]]
    with pytest.raises(ParameterError, match=message):
        Trajectory.from_arrays(times, positions, [[0, 0, 0, 1], quat])


def test_bad_shapes_are_named():
    with pytest.raises(ParameterError, match="expected at least one pose"):
        Trajectory.from_arrays([], np.zeros((0, 3)), np.zeros((0, 4)))
    with pytest.raises(ParameterError, match="expected shapes"):
        Trajectory.from_arrays([0.0], np.zeros((1, 2)), np.zeros((1, 4)))
    with pytest.raises(ParameterError, match="expected 2 names"):
        make([0, 1], ["a"])


def test_nearly_unit_quaternions_are_normalized():
    walk = Trajectory.from_arrays([0.0], np.zeros((1, 3)), [[0, 0, 0, 1.005]])
    np.testing.assert_array_equal(walk.quat_xyzw, [[0, 0, 0, 1]])
