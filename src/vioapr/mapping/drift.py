"""VIO's drift and jumps taken out, as far as two-view geometries allow: a pose graph.

Unknown are a heading and a position of every image. Neighbours in time hold each other as VIO
says; pairs of images as their matches say (heading, direction, and roughly the distance). All
errors count robustly: trackers jump, and pairs may be of places that look alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.joining import about_up, link, miss_m
from vioapr.mapping.two_view import PairGeometries

VIO_M, VIO_SHARE, VIO_DEG = 0.03, 0.02, 0.5
"""Standard errors of VIO between neighbours: position, its share of the way, heading."""

PAIR_M, PAIR_SHARE, PAIR_DEG = 0.1, 0.1, 2.0
"""Standard errors of a pair: position, its share of the distance, heading."""

ROUNDS = (10.0, 10.0, 5.0, 5.0, 3.0, 3.0, 2.0, 2.0, 2.0, 2.0)
"""Errors, in standard errors, from which one counts less: wide first, so that loops close."""

_UP = np.array([0.0, 1.0, 0.0])


def correct_drift(
    images: MapImages, found: PairGeometries, distance_m: NDArray[np.float64], poses: Rigid3
) -> Rigid3:
    """Poses of all images that agree with VIO and with most pairs.

    Args:
        images: The images.
        found: Pairs between images of one joined world.
        distance_m: Roughly between their cameras, shape (m,), NaN where unknown.
        poses: Of all images by VIO, in worlds with y up, NaN where there is none.

    Returns:
        Shape (n,), NaN as before.
    """
    rows = np.flatnonzero(images.has_vio)
    number = np.full(len(images), -1)
    number[rows] = np.arange(len(rows))
    chain = np.column_stack([rows[:-1], rows[1:]])
    chain = chain[images.tracking_world[chain[:, 0]] == images.tracking_world[chain[:, 1]]]
    for limit in ROUNDS:
        vio = _vio_errors(images.vio_from_cam, chain, poses)
        pairs = _pair_errors(found, distance_m, poses)
        step = _solve([(number[chain], vio), (number[found.rows], pairs)], len(rows), limit)
        poses = _moved(poses, rows, step)
    return poses


class _Errors(NamedTuple):
    """Of constraints between two images each, in standard errors.

    Attributes:
        position: Shape (m, 3).
        by_end: Derivatives by the second image's position, shape (m, 3, 3); by the first
            image's it is the opposite.
        by_turn: By the first image's heading, rad, shape (m, 3).
        heading: Shape (m,).
        by_heading: Derivative by the second image's heading, rad; by the first the opposite.
    """

    position: NDArray[np.float64]
    by_end: NDArray[np.float64]
    by_turn: NDArray[np.float64]
    heading: NDArray[np.float64]
    by_heading: NDArray[np.float64]


def _vio_errors(vio: Rigid3, chain: NDArray[np.intp], poses: Rigid3) -> _Errors:
    first, second = chain.T
    turn = quaternion.multiply(poses.quat_xyzw, quaternion.inverse(vio.quat_xyzw))
    way = quaternion.rotate(turn[first], vio.translation_m[second] - vio.translation_m[first])
    sigma_m = VIO_M + VIO_SHARE * np.linalg.norm(way, axis=1)
    moved = poses.translation_m[second] - poses.translation_m[first]
    change = quaternion.multiply(turn[second], quaternion.inverse(turn[first]))
    heading = 2 * np.arctan2(change[:, 1], change[:, 3])
    heading = (heading + np.pi) % (2 * np.pi) - np.pi
    sigma = np.full(len(chain), np.radians(VIO_DEG))
    return _Errors(
        (moved - way) / sigma_m[:, None],
        np.eye(3) / sigma_m[:, None, None],
        -np.cross(_UP, way) / sigma_m[:, None],
        heading / sigma,
        1 / sigma,
    )


def _pair_errors(found: PairGeometries, distance_m: NDArray[np.float64], poses: Rigid3) -> _Errors:
    links = link(found, distance_m, poses)
    off_m, along_m = miss_m(links)
    sigma_m = PAIR_M + PAIR_SHARE * along_m
    across = np.eye(3) - links.direction[:, :, None] * links.direction[:, None, :]
    is_within = (along_m > links.least_m) & (along_m < links.most_m)
    by_end = np.where(is_within[:, None, None], across, np.eye(3))
    sigma = np.full(len(found.rows), np.radians(PAIR_DEG))
    return _Errors(
        off_m / sigma_m[:, None],
        by_end / sigma_m[:, None, None],
        -along_m[:, None] * np.cross(_UP, links.direction) / sigma_m[:, None],
        -np.radians(links.heading_deg) / sigma,
        1 / sigma,
    )


def _solve(
    parts: list[tuple[NDArray[np.intp], _Errors]], count: int, limit: float
) -> NDArray[np.float64]:
    """One step of Gauss and Newton: changes of position (x, y, z) and heading, shape (n, 4)."""
    total, right = diags_array(np.full(4 * count, 1e-6)).tocsr(), np.zeros(4 * count)
    for rows, errors in parts:
        jacobian, residual, weight = _linearize(rows, errors, count, limit)
        weighted = jacobian.T @ diags_array(weight)
        total = total + weighted @ jacobian
        right -= weighted @ residual
    return np.asarray(spsolve(total.tocsc(), right)).reshape(count, 4)


def _linearize(
    rows: NDArray[np.intp], errors: _Errors, count: int, limit: float
) -> tuple[csr_array, NDArray[np.float64], NDArray[np.float64]]:
    m = len(rows)
    values = np.zeros((m, 4, 8))
    values[:, :3, :3], values[:, :3, 4:7] = -errors.by_end, errors.by_end
    values[:, :3, 3] = errors.by_turn
    values[:, 3, 3], values[:, 3, 7] = -errors.by_heading, errors.by_heading
    columns = (4 * rows[:, :, None] + np.arange(4)).reshape(m, 1, 8)
    lines = np.arange(4 * m).reshape(m, 4, 1)
    lines, columns = np.broadcast_arrays(lines, columns)
    shape = (4 * m, 4 * count)
    jacobian = coo_array((values.ravel(), (lines.ravel(), columns.ravel())), shape=shape).tocsr()
    residual = np.column_stack([errors.position, errors.heading])
    size = np.linalg.norm(residual, axis=1)
    weight = 1 / (1 + (size / limit) ** 2) ** 2  # Geman and McClure's
    return jacobian, residual.ravel(), np.repeat(weight, 4)


def _moved(poses: Rigid3, rows: NDArray[np.intp], step: NDArray[np.float64]) -> Rigid3:
    positions, quats = poses.translation_m.copy(), poses.quat_xyzw.copy()
    positions[rows] += step[:, :3]
    turned = quaternion.multiply(about_up(np.degrees(step[:, 3])), quats[rows])
    quats[rows] = quaternion.normalize(turned)
    return Rigid3(positions, quats)
