import numpy as np
import pytest
from tests.trajectory.walks import make

from vioapr.errors import AssociationError, ParameterError
from vioapr.trajectory import associate, nearest_rows, poses_of_frames


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


def test_nearest_rows_by_hand():
    among_s = np.array([0.0, 1.0, 4.0])
    times_s = np.array([-5.0, 0.4, 0.5, 0.6, 2.4, 2.6, 9.0])
    assert nearest_rows(times_s, among_s).tolist() == [0, 0, 0, 1, 1, 2, 2]
    assert nearest_rows(times_s, np.array([3.0])).tolist() == [0] * 7
