"""Trees of arrays: named tuples in named tuples, with arrays (or None) as leaves.

Poses, frames, estimates and states of fusion methods are such trees. Whatever is done to every
array of one is done by `tree_map`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar, cast, overload

from vioapr.geometry.arrays import namespace

Tree = TypeVar("Tree")


@overload
def tree_map(function: Callable[[Any], Any], tree: Tree) -> Tree: ...
@overload
def tree_map(function: Callable[[Any, Any], Any], tree: Tree, other: Tree, /) -> Tree: ...
@overload
def tree_map(function: Callable[..., Any], tree: Tree, *others: Tree) -> Tree: ...
def tree_map(function: Callable[..., Any], tree: Tree, *others: Tree) -> Tree:
    """Apply a function to every array of a tree, and to the arrays in its place in others.

    Args:
        function: Takes one array of each tree, and returns the new one.
        tree: A tuple, named tuple or array. None stays None.
        others: Trees of the same structure.

    Returns:
        A tree of the same structure.
    """
    if tree is None:
        return tree
    if not isinstance(cast("object", tree), tuple):
        return function(tree, *others)
    trees = cast("tuple[tuple[Any, ...], ...]", (tree, *others))
    parts = (tree_map(function, *branches) for branches in zip(*trees, strict=True))
    kind: Any = trees[0].__class__
    return kind(*parts) if hasattr(kind, "_fields") else kind(parts)


def tree_at(tree: Tree, index: Any) -> Tree:
    """The elements of every array of a tree at an index of the axes that all have in common."""

    def take(array: Any) -> Any:
        return array[index]

    return tree_map(take, tree)


def tree_stack(trees: Sequence[Tree], axis: int = 0) -> Tree:
    """Join trees of one structure along a new axis, at least one tree."""

    def stack(*arrays: Any) -> Any:
        return namespace(*arrays).stack(list(arrays), axis=axis)

    return tree_map(stack, *trees)


def tree_leaves(tree: object) -> Iterator[Any]:
    """The arrays of a tree, in order, without None."""
    if isinstance(tree, tuple):
        for branch in cast("tuple[object, ...]", tree):
            yield from tree_leaves(branch)
    elif tree is not None:
        yield tree


def tree_paths(tree: object, root: str = "") -> Iterator[str]:
    """The names of `tree_leaves`, in the same order: field names joined by dots."""
    if isinstance(tree, tuple):
        branches = cast("tuple[object, ...]", tree)
        fields: Any = getattr(branches, "_fields", range(len(branches)))
        for field, branch in zip(fields, branches, strict=True):
            yield from tree_paths(branch, f"{root}.{field}" if root else str(field))
    elif tree is not None:
        yield root
