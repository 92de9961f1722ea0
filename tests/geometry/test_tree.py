from typing import Any, NamedTuple

import numpy as np

from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_leaves, tree_map, tree_paths


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
