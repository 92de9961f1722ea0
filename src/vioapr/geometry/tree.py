"""Trees of arrays: named tuples in named tuples, with arrays (or None) as leaves.

Poses, frames, estimates and states of fusion methods are such trees. Whatever is done to every
array of one is done by `tree_map`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

Tree = TypeVar("Tree")


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
    if not isinstance(tree, tuple):
        return function(tree, *others)
    parts = (tree_map(function, *branches) for branches in zip(tree, *others, strict=True))  # type: ignore[arg-type]
    kind: Any = type(tree)
    return kind(*parts) if hasattr(tree, "_fields") else kind(parts)


def tree_leaves(tree: object) -> Iterator[Any]:
    """The arrays of a tree, in order, without None."""
    if isinstance(tree, tuple):
        for branch in tree:
            yield from tree_leaves(branch)
    elif tree is not None:
        yield tree


def tree_paths(tree: object, root: str = "") -> Iterator[str]:
    """The names of `tree_leaves`, in the same order: field names joined by dots."""
    if isinstance(tree, tuple):
        for field, branch in zip(getattr(tree, "_fields", range(len(tree))), tree, strict=True):
            yield from tree_paths(branch, f"{root}.{field}" if root else str(field))
    elif tree is not None:
        yield root
