"""A fusion method's state as one flat vector of floats, which any runtime can carry.

Element 0 is a tag that says whose state it is; a vector of zeros is the state before the first
frame. The other elements are the leaves of the method's nested tuples, in order.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vioapr.geometry.arrays import Array, namespace
from vioapr.geometry.tree import tree_leaves, tree_map, tree_paths

_TAG_BITS = 23
"""float32 holds integers of this many bits exactly, with one to spare."""


@dataclass(frozen=True)
class Leaf:
    """One array of the state.

    Attributes:
        name: Path of field names, e.g. `reference.vio_from_cam.quat_xyzw`.
        shape: Without the batch axis.
        is_boolean: Stored as 0 or 1.
    """

    name: str
    shape: tuple[int, ...]
    is_boolean: bool

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


class StateLayout:
    """The place of every array of a method's state in the flat vector.

    Attributes:
        leaves: In order.
        size: Elements of the vector, the tag included.
        tag: Element 0 once a frame has been taken in: a whole number from 1 to 2^23. It depends
            on the method, its structure and the caller's own words, so that states of other
            models are told apart.
        initial: Shape (size,), the state before the first frame, spelled out.
    """

    def __init__(self, template: Any, identity: str) -> None:
        """Lay out a state.

        Args:
            template: The state before the first frame, of batch shape (1,), in NumPy.
            identity: What a state must not be mixed up between: method and regressor.
        """
        self._template = template
        arrays = list(tree_leaves(self._template))
        self.leaves = tuple(
            Leaf(name, tuple(array.shape[1:]), array.dtype == np.bool_)
            for name, array in zip(tree_paths(self._template), arrays, strict=True)
        )
        self.size = 1 + sum(leaf.size for leaf in self.leaves)
        words = f"{self.leaves} {identity}"
        self.tag = 1 + zlib.crc32(words.encode()) % 2**_TAG_BITS
        parts = [array.astype(np.float32).reshape(-1) for array in arrays]
        self.initial = np.concatenate([[np.float32(self.tag)], *parts]).astype(np.float32)

    def unpack(self, pieces: Sequence[Array]) -> Any:
        """The method's state, batch shape (1,), from the leaves' pieces of the vector."""
        arrays = []
        for leaf, piece in zip(self.leaves, pieces, strict=True):
            xp = namespace(piece)
            is_vector = leaf.shape == (leaf.size,)
            array = piece[None] if is_vector else xp.reshape(piece, (1, *leaf.shape))
            arrays.append(array > 0.5 if leaf.is_boolean else array)
        following = iter(arrays)
        return tree_map(lambda _: next(following), self._template)

    def pack(self, state: Any) -> list[Any]:
        """The pieces of the vector, each of shape (k,), from a state of batch shape (1,)."""
        pieces = []
        for array in tree_leaves(state):
            xp = namespace(array)
            is_float = xp.isdtype(array.dtype, "real floating")
            pieces.append(xp.reshape(array if is_float else xp.astype(array, xp.float32), (-1,)))
        return pieces
