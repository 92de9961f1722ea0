"""Poses as columns of method `chain`: position, then quaternion xyzw, shape (..., 7, 1).

Several of them lie side by side along the last axis. Products with quaternions are linear in
each factor, so each is a matrix, or one outer product and one table: few operations, in NumPy
as in a graph on a phone.
"""

from __future__ import annotations

import numpy as np

from vioapr.geometry import frames, quaternion
from vioapr.geometry.arrays import Array, constant, namespace
from vioapr.geometry.rigid import Rigid3

_UNITS = np.eye(4)
_FORWARD = np.array([0.0, 0.0, 1.0, 0.0])


def _z_up_from_y_up() -> np.ndarray:
    """The matrix of `frames.z_up_from_y_up`, on columns."""
    turned = frames.z_up_from_y_up(
        Rigid3(np.eye(7)[:, :3], np.where(np.arange(7)[:, None] > 2, np.eye(7)[:, 3:], 0.0))
    )
    return np.concatenate(turned, axis=1).T * (np.kron(np.eye(2), np.ones((4, 4)))[1:, 1:])


def _of_pairs(product: np.ndarray, row: int, column: int) -> np.ndarray:
    """Of the outer product of two stacked quaternions, one block, shape (k, 64)."""
    pairs = np.zeros((product.shape[-1], 8, 8))
    pairs[:, 4 * row : 4 * row + 4, 4 * column : 4 * column + 4] = np.moveaxis(product, -1, 0)
    return pairs.reshape(-1, 64)


def _sandwich(vector: np.ndarray) -> np.ndarray:
    """The product q v q^-1 of all q_i q_j, shape (4, 4, 3)."""
    left = quaternion.multiply(_UNITS, vector)
    return quaternion.multiply(left[:, None], quaternion.inverse(_UNITS))[..., :3]


def _comparison_table() -> np.ndarray:
    product = quaternion.multiply(_UNITS[:, None], quaternion.inverse(_UNITS))
    gaze = _sandwich(_FORWARD)
    return np.concatenate(
        [_of_pairs(product, 0, 1), _of_pairs(gaze, 0, 0), _of_pairs(gaze, 1, 1)], axis=0
    )


def _turn_table() -> np.ndarray:
    """All of q v q^-1 for the three unit vectors, shape (9, 16), row-major."""
    columns = [_sandwich(unit) for unit in _UNITS[:3]]
    return np.stack(columns, axis=-1).reshape(16, 9).T


def _factors(product: np.ndarray) -> np.ndarray:
    """The matrix of the other factor, row-major, from a factor, shape (16, 4).

    Args:
        product: Products of the units, the factor's index first, shape (4, 4, 4).
    """
    return np.moveaxis(product, 0, -1).swapaxes(0, 1).reshape(16, 4)


def _cross_table() -> np.ndarray:
    units = np.eye(3)
    return np.cross(units[:, None], units).reshape(9, 3).T


_Z_UP_FROM_Y_UP = _z_up_from_y_up()
_COMPARISON_TABLE, _TURN_TABLE = _comparison_table(), _turn_table()
_PRODUCT_TABLE = quaternion.multiply(_UNITS[:, None], _UNITS).reshape(16, 4).T
_BY_INVERSE_ON_RIGHT = _factors(quaternion.multiply(_UNITS, quaternion.inverse(_UNITS)[:, None]))
_BY_INVERSE_ON_LEFT = _factors(quaternion.multiply(quaternion.inverse(_UNITS)[:, None], _UNITS))
_CROSS_TABLE = _cross_table()


def column(pose: Rigid3) -> Array:
    """Of a pose of shape (...)."""
    return namespace(pose.translation_m).concat(list(pose), axis=-1)[..., None]


def z_up_column(y_up_from_cam: Rigid3) -> Array:
    """Of a pose in a y-up world, in the z-up world that shares its x."""
    y_up = column(y_up_from_cam)
    return constant(_Z_UP_FROM_Y_UP, y_up) @ y_up


def y_up_turn(world_from_z_up: Array) -> Array:
    """world_from_y_up, from the quaternion of world_from_z_up, shapes (..., 4, 1)."""
    return constant(_Y_UP_ON_THE_RIGHT, world_from_z_up) @ world_from_z_up


_Y_UP_ON_THE_RIGHT = quaternion.multiply(_UNITS, np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])).T


def compare(apr_world_from_cam: Array, vio_from_cam: Array) -> Array:
    """world_from_vio's quaternion, and both viewing directions, shape (..., 10, 1).

    The viewing direction is the camera's z axis, in the world and in the tracking world.
    """
    xp = namespace(vio_from_cam)
    both = xp.concat([apr_world_from_cam[..., 3:, :], vio_from_cam[..., 3:, :]], axis=-2)
    return constant(_COMPARISON_TABLE, both) @ _outer(both, both)


def rotation_matrix(quat: Array) -> Array:
    """Shapes (..., 4, 1) to (..., 3, 3)."""
    flat = constant(_TURN_TABLE, quat) @ _outer(quat, quat)
    return namespace(flat).reshape(flat, (*flat.shape[:-2], 3, 3))


def product(left: Array, right: Array) -> Array:
    """The Hamilton product of quaternions, shapes (..., 4, 1)."""
    return constant(_PRODUCT_TABLE, left) @ _outer(left, right)


def turns_from(quats: Array, origin: Array) -> Array:
    """Q origin^-1 as rotation vectors, shapes (..., 4, n) and (..., 4, 1) to (..., 3, n).

    A vector is the doubled imaginary part, 2 sin(angle / 2) times the axis: the rotation
    vector, for all angles that count, in the world's axes.
    """
    turns = _matrix(_BY_INVERSE_ON_RIGHT, origin) @ quats
    vectors = 2 * turns[..., :3, :]
    return namespace(turns).where(turns[..., 3:, :] < 0, -vectors, vectors)


def since(quats: Array, start: Array) -> Array:
    """start^-1 q, shapes (..., 4, n) and (..., 4, 1) to (..., 4, n)."""
    return _matrix(_BY_INVERSE_ON_LEFT, start) @ quats


def turned(quat: Array, vector: Array) -> Array:
    """The inverse of `turns_from`: the quaternion after a rotation by a vector, (..., 4, 1)."""
    xp = namespace(quat)
    half2 = vector.mT @ vector / 4
    # At most by 60 degrees: a correction beyond that is not to be had from one solution.
    shorter = xp.minimum(0.5 / xp.sqrt(xp.maximum(half2, 1e-12)), 1.0)
    half = vector * (shorter / 2)
    real = xp.sqrt(1 - xp.minimum(half2, 0.25))
    return product(xp.concat([half, real], axis=-2), quat)


def cross(left: Array, right: Array) -> Array:
    """Cross products of vectors side by side, shape (..., 3, n)."""
    pairs = left[..., :, None, :] * right[..., None, :, :]
    flat = namespace(pairs).reshape(pairs, (*pairs.shape[:-3], 9, pairs.shape[-1]))
    return constant(_CROSS_TABLE, flat) @ flat


def _matrix(factors: np.ndarray, quat: Array) -> Array:
    flat = constant(factors, quat) @ quat
    return namespace(flat).reshape(flat, (*flat.shape[:-2], 4, 4))


def _outer(left: Array, right: Array) -> Array:
    """All products of components, shapes (..., k, 1) and (..., m, 1) to (..., k m, 1)."""
    products = left @ right.mT
    size = products.shape[-2] * products.shape[-1]
    return namespace(products).reshape(products, (*products.shape[:-2], size, 1))
