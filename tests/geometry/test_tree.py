from typing import NamedTuple

import numpy as np
import pytest
from tests.helpers import random_rigid, to_numpy

from vioapr.geometry import rigid
from vioapr.geometry.arrays import compute_where
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_at, tree_leaves, tree_map, tree_paths, tree_stack

BATCHES = [(), (1,), (3, 1, 2)]


class Branch(NamedTuple):
    pose: Rigid3
    sigma_m: np.ndarray | None
    pair: tuple[np.ndarray, np.ndarray]


def make_branch(rng, batch, xp=np):
    pair = tuple(xp.asarray(rng.normal(size=batch)) for _ in range(2))
    return Branch(random_rigid(rng, batch, xp), None, pair)


@pytest.mark.parametrize("batch", BATCHES)
def test_mapping_keeps_the_structure(xp, rng, batch):
    tree = make_branch(rng, batch, xp)
    doubled = tree_map(lambda leaf: leaf + leaf, tree)
    assert type(doubled) is Branch
    assert type(doubled.pose) is Rigid3
    assert type(doubled.pair) is tuple
    assert doubled.sigma_m is None
    for leaf, twice in zip(tree_leaves(tree), tree_leaves(doubled), strict=True):
        np.testing.assert_array_equal(to_numpy(twice), 2 * to_numpy(leaf))


@pytest.mark.parametrize("batch", BATCHES)
def test_mapping_obeys_identity_and_composition(rng, batch):
    tree = make_branch(rng, batch)
    assert all(
        a is b
        for a, b in zip(tree_leaves(tree), tree_leaves(tree_map(lambda x: x, tree)), strict=True)
    )
    stepwise = tree_map(np.negative, tree_map(np.square, tree))
    at_once = tree_map(lambda x: np.negative(np.square(x)), tree)
    for a, b in zip(tree_leaves(stepwise), tree_leaves(at_once), strict=True):
        np.testing.assert_array_equal(a, b)


def test_several_trees_are_mapped_leaf_by_leaf():
    left, right = Rigid3(np.ones(3), np.arange(4.0)), Rigid3(np.full(3, 2.0), np.ones(4))
    total = tree_map(lambda a, b: a + b, left, right)
    np.testing.assert_array_equal(total.translation_m, [3, 3, 3])
    np.testing.assert_array_equal(total.quat_xyzw, [1, 2, 3, 4])


def test_leaves_come_in_order_and_without_none():
    leaves = list(tree_leaves(((1, None), Rigid3(2, 3), 4)))
    assert leaves == [1, 2, 3, 4]
    assert list(tree_leaves(None)) == []
    assert tree_map(str, None) is None
    assert tree_map(str, 5) == "5"


def test_trees_of_other_structure_are_refused():
    with pytest.raises(ValueError, match="zip"):
        tree_map(lambda a, b: a, (1, 2), (1, 2, 3))


@pytest.mark.parametrize("batch", BATCHES)
def test_stack_and_choose_work_on_every_array(xp, rng, batch):
    left, right = random_rigid(rng, batch, xp), random_rigid(rng, batch, xp)
    both = rigid.stack([left, right])
    assert both.batch_shape == (2, *batch)
    for side, index in ((left, 0), (right, 1)):
        for whole, part in zip(both, side, strict=True):
            np.testing.assert_array_equal(to_numpy(whole)[index], to_numpy(part))
    condition = xp.asarray(rng.random(batch) < 0.5)
    chosen = rigid.choose(condition, left, right)
    for got, yes, no in zip(chosen, left, right, strict=True):
        expected = np.where(to_numpy(condition)[..., None], to_numpy(yes), to_numpy(no))
        np.testing.assert_array_equal(to_numpy(got), expected)


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_computing_where_needed_equals_computing_everywhere(xp, rng, batch, share):
    condition = rng.random(batch) < share
    values = rng.normal(size=(*batch, 3))
    otherwise = (np.zeros((*batch, 3)), np.full(batch, -1.0))
    got = compute_where(
        xp.asarray(condition),
        lambda v: (2 * v, v[..., 0]),
        (xp.asarray(values),),
        tuple(xp.asarray(part) for part in otherwise),
    )
    assert type(got) is tuple
    np.testing.assert_array_equal(
        to_numpy(got[0]), np.where(condition[..., None], 2 * values, otherwise[0])
    )
    np.testing.assert_array_equal(
        to_numpy(got[1]), np.where(condition, values[..., 0], otherwise[1])
    )


def test_paths_name_the_leaves_in_order():
    pose = Rigid3(np.zeros(3), np.ones(4))
    tree = Branch(pose, None, (np.full(2, 2.0), np.full(1, 3.0)))
    names = ["pose.translation_m", "pose.quat_xyzw", "pair.0", "pair.1"]
    assert list(tree_paths(tree)) == names
    assert [leaf.size for leaf in tree_leaves(tree)] == [3, 4, 2, 1]
    assert list(tree_paths(np.zeros(2))) == [""]
    assert list(tree_paths(())) == []


def test_trees_are_stacked_and_taken_apart_again():
    pose = Rigid3(np.zeros(3), np.ones(4))
    tree = Branch(pose, None, (np.full(2, 2.0), np.full(1, 3.0)))
    other = tree_map(lambda a: -a, tree)
    for axis in (0, 1):
        both = tree_stack([tree, other], axis)
        assert isinstance(both.pose, Rigid3)
        assert both.sigma_m is None
        index = (slice(None),) * axis
        for ours, theirs in zip(
            tree_leaves(tree_at(both, (*index, 1))), tree_leaves(other), strict=True
        ):
            np.testing.assert_array_equal(ours, theirs)
