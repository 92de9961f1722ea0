"""Arrays of any backend that follows the Python Array API: NumPy, PyTorch, traced PyTorch.

`Array` and `Mask` say what batched code may do with arrays. NumPy's arrays and PyTorch's tensors
satisfy them. What a backend's namespace returns (`xp.sqrt(...)`) has no type of its own, as
namespaces are found at run time.
"""

# The members of the two types are described by the standard.
# ruff: noqa: D102

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, Self, TypeAlias, cast

import array_api_compat
import array_api_compat.numpy
import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import TypeVar


class Mask(Protocol):
    """An array of booleans: what comparisons give and choices take."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def ndim(self) -> int: ...
    @property
    def dtype(self) -> Any: ...
    def __array__(self) -> np.ndarray[Any, Any]: ...
    def any(self) -> Any: ...
    def all(self) -> Any: ...
    def __getitem__(self, key: Any, /) -> Self: ...
    def __and__(self, other: Any, /) -> Self: ...
    def __or__(self, other: Any, /) -> Self: ...
    def __invert__(self) -> Self: ...


class Array(Protocol):
    """An array of numbers."""

    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def ndim(self) -> int: ...
    @property
    def dtype(self) -> Any: ...
    @property
    def mT(self) -> Self: ...
    def __array__(self) -> np.ndarray[Any, Any]: ...
    def __len__(self) -> int: ...
    def __float__(self) -> float: ...
    def __int__(self) -> int: ...
    def __getitem__(self, key: Any, /) -> Self: ...
    def __neg__(self) -> Self: ...
    def __add__(self, other: Any, /) -> Self: ...
    def __radd__(self, other: Any, /) -> Self: ...
    def __sub__(self, other: Any, /) -> Self: ...
    def __rsub__(self, other: Any, /) -> Self: ...
    def __mul__(self, other: Any, /) -> Self: ...
    def __rmul__(self, other: Any, /) -> Self: ...
    def __truediv__(self, other: Any, /) -> Self: ...
    def __rtruediv__(self, other: Any, /) -> Self: ...
    def __floordiv__(self, other: Any, /) -> Self: ...
    def __mod__(self, other: Any, /) -> Self: ...
    def __pow__(self, other: Any, /) -> Self: ...
    def __matmul__(self, other: Any, /) -> Self: ...
    def __lt__(self, other: Any, /) -> Mask: ...
    def __le__(self, other: Any, /) -> Mask: ...
    def __gt__(self, other: Any, /) -> Mask: ...
    def __ge__(self, other: Any, /) -> Mask: ...


ArrayT = TypeVar("ArrayT", bound=Array, default=Any)
"""One backend's arrays: a function that takes them gives the same kind back."""

FloatArray: TypeAlias = NDArray[np.float64]
"""NumPy's doubles, as all analysis has them."""

_NUMPY_TYPES = (np.ndarray, np.generic)
_device = cast("Callable[[Any], Any]", array_api_compat.device)  # pyright: ignore[reportUnknownMemberType]


def namespace(*arrays: Array | Mask) -> Any:
    """The Array API namespace that the arrays belong to."""
    # NumPy's case is short-cut: it is the streaming one, where microseconds count.
    for array in arrays:
        if not isinstance(array, _NUMPY_TYPES):
            return array_api_compat.array_namespace(*arrays)
    return array_api_compat.numpy


def constant(values: ArrayLike, like: ArrayT) -> ArrayT:
    """`values` as an array with the namespace, dtype and device of `like`."""
    xp = namespace(like)
    if xp is array_api_compat.numpy:
        # Most constants are doubles already, and asking costs as much as a product.
        if isinstance(values, np.ndarray) and values.dtype == like.dtype:
            return cast("ArrayT", values)
        return xp.asarray(values, dtype=like.dtype)
    return xp.asarray(np.asarray(values).tolist(), dtype=like.dtype, device=_device(like))


def zeros(shape: tuple[int, ...], like: ArrayT) -> ArrayT:
    """Zeros with the namespace, dtype and device of `like`."""
    return namespace(like).zeros(shape, dtype=like.dtype, device=_device(like))


def norm(vectors: ArrayT) -> ArrayT:
    """Euclidean length over the last axis, shape (..., n) to (...)."""
    xp = namespace(vectors)
    return xp.sqrt(xp.sum(vectors * vectors, axis=-1))


def select(condition: Mask, if_true: ArrayT, if_false: ArrayT) -> ArrayT:
    """`where` for values that have more trailing axes than the condition.

    Args:
        condition: Booleans, shape (...).
        if_true: Values, shape (...) followed by any axes.
        if_false: Values of the same shapes.
    """
    xp = namespace(condition, if_true)
    trailing = if_true.ndim - condition.ndim
    return xp.where(condition[(..., *(None,) * trailing)], if_true, if_false)


def holds_nowhere(condition: Mask) -> bool:
    """Whether it is certain that a condition holds in no row, so that work can be left out.

    Known in NumPy only; see `compute_where`.
    """
    return namespace(condition) is array_api_compat.numpy and not condition.any()


def holds_everywhere(condition: Mask) -> bool:
    """Whether it is certain that a condition holds in all rows; see `holds_nowhere`."""
    return namespace(condition) is array_api_compat.numpy and bool(condition.all())


def compute_where(
    condition: Mask,
    compute: Callable[..., tuple[Array, ...]],
    inputs: tuple[Array, ...],
    otherwise: tuple[Array, ...],
) -> tuple[Array, ...]:
    """`compute(*inputs)` in the rows where a condition holds, `otherwise` in the others.

    For what is costly and rarely needed. NumPy computes the needed rows only. Other backends
    compute all and select: which rows are needed is not known when a graph is traced, and not
    worth a synchronization on a GPU.

    Args:
        condition: Booleans, the batch shape (...).
        compute: From arrays of shape (rows, ...) to a tuple of arrays of shape (rows, ...).
        inputs: Arrays of the batch shape and further axes.
        otherwise: Arrays of the batch shape and the further axes of the results.
    """
    if namespace(condition, *inputs) is not array_api_compat.numpy:
        computed = compute(*inputs)
        return tuple(select(condition, *pair) for pair in zip(computed, otherwise, strict=True))
    if holds_nowhere(condition):
        return otherwise
    rows = np.asarray(condition)
    results = tuple(np.array(array) for array in otherwise)
    computed = compute(*(array[rows] for array in inputs))
    for result, values in zip(results, computed, strict=True):
        result[rows] = values
    return results
