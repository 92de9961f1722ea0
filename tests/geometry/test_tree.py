from typing import Any, NamedTuple

import numpy as np

from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_at, tree_leaves, tree_map, tree_paths, tree_stack


class State(NamedTuple):
    pose: Rigid3
    count: Any
    pair: tuple[Any, Any]


STATE = State(Rigid3(np.zeros(3), np.ones(4)), None, (np.full(2, 2.0), np.full(1, 3.0)))


def test_paths_name_the_leaves_in_order():
    names = ["pose.translation_m", "pose.quat_xyzw", "pair.0", "pair.1"]
    assert list(tree_paths(STATE)) == names
    assert [leaf.size for leaf in tree_leaves(STATE)] == [3, 4, 2, 1]
    assert list(tree_paths(np.zeros(2))) == [""]
    assert list(tree_paths(())) == []


def test_a_mapped_tree_has_the_same_types():
    doubled = tree_map(lambda a, b: a + b, STATE, STATE)
    assert isinstance(doubled, State)
    assert isinstance(doubled.pose, Rigid3)
    assert doubled.count is None
    assert type(doubled.pair) is tuple
    assert doubled.pair[0].tolist() == [4.0, 4.0]


def test_trees_are_stacked_and_taken_apart_again():
    other = tree_map(lambda a: -a, STATE)
    for axis in (0, 1):
        both = tree_stack([STATE, other], axis)
        assert isinstance(both.pose, Rigid3)
        assert both.count is None
        index = (slice(None),) * axis
        for ours, theirs in zip(
            tree_leaves(tree_at(both, (*index, 1))), tree_leaves(other), strict=True
        ):
            np.testing.assert_array_equal(ours, theirs)
