import numpy as np
import pytest
from tests.trajectory.walks import make

from vioapr.errors import ParameterError
from vioapr.trajectory import Trajectory


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
