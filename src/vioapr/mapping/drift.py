"""VIO's drift and jumps taken out, as far as two-view geometries allow: a pose graph.

Unknown are a heading and a position of every image. Neighbours in time hold each other as VIO
says; pairs of images as their matches say (heading, direction, and roughly the distance). All
errors count robustly: trackers jump, and pairs may be of places that look alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.geometry.pose_graph import Factors, gauss_newton, geman_mcclure, solve_sparse
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.joining import about_up, link, miss_m
from vioapr.mapping.two_view import PairGeometries

VIO_M, VIO_SHARE, VIO_DEG = 0.005, 0.02, 0.5
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
    found = found._replace(rows=number[found.rows])
    worlds = images.tracking_world[rows]
    first = np.flatnonzero(worlds[1:] == worlds[:-1])
    vio, known = images.vio_from_cam.at(rows), poses.at(rows)
    for limit in ROUNDS:

        def linearize(poses: Rigid3, limit: float = limit) -> list[Factors]:
            factors = vio_factors(vio, first, poses), pair_factors(found, distance_m, poses)
            return [each._replace(weight=geman_mcclure(each.residual, limit)) for each in factors]

        known = gauss_newton(known, linearize, perturb_level, solve_sparse, 1)
    corrected = Rigid3(*(column.copy() for column in poses))
    corrected.translation_m[rows], corrected.quat_xyzw[rows] = known
    return corrected


def perturb_level(poses: Rigid3, tangent: NDArray[np.float64]) -> Rigid3:
    """Move poses in a world with y up by tangent vectors: t + d, and a turn about y.

    Args:
        poses: Shape (n,).
        tangent: Shape (n, 4): translation d in m, then the heading's change in rad.
    """
    turned = quaternion.multiply(about_up(np.degrees(tangent[:, 3])), poses.quat_xyzw)
    return Rigid3(poses.translation_m + tangent[:, :3], quaternion.normalize(turned))


def vio_factors(vio: Rigid3, first: NDArray[np.intp], poses: Rigid3) -> Factors:
    """The motions between neighbours against VIO's: position, shape (m, 3), and heading.

    Args:
        vio: Poses by VIO, shape (n,).
        first: Those whose next one is of the same tracking world, shape (m,).
        poses: Of now, shape (n,).
    """
    second = first + 1
    turn = quaternion.multiply(poses.quat_xyzw, quaternion.inverse(vio.quat_xyzw))
    way = quaternion.rotate(turn[first], vio.translation_m[second] - vio.translation_m[first])
    sigma_m = VIO_M + VIO_SHARE * np.linalg.norm(way, axis=1)
    off_m = poses.translation_m[second] - poses.translation_m[first] - way
    change = quaternion.multiply(turn[second], quaternion.inverse(turn[first]))
    heading = 2 * np.arctan2(change[:, 1], change[:, 3])
    heading = (heading + np.pi) % (2 * np.pi) - np.pi
    return level_factors(
        (first, second), off_m, np.broadcast_to(np.eye(3), (len(first), 3, 3)),
        -np.cross(_UP, way), sigma_m, heading, np.radians(VIO_DEG),
    )  # fmt: skip


def pair_factors(found: PairGeometries, distance_m: NDArray[np.float64], poses: Rigid3) -> Factors:
    """The motions between paired images against their matches: heading, direction, distance.

    Args:
        found: Pairs.
        distance_m: Roughly between their cameras, shape (m,), NaN where unknown.
        poses: Of now, shape (n,).
    """
    links = link(found, distance_m, poses)
    off_m, along_m = miss_m(links)
    across = np.eye(3) - links.direction[:, :, None] * links.direction[:, None, :]
    # The distance counts only where it is beyond its limits.
    is_within = (along_m > links.least_m) & (along_m < links.most_m)
    by_end = np.where(is_within[:, None, None], across, np.eye(3))
    by_turn = -along_m[:, None] * np.cross(_UP, links.direction)
    first, second = found.rows.T
    return level_factors(
        (first, second), off_m, by_end, by_turn, PAIR_M + PAIR_SHARE * along_m,
        -np.radians(links.heading_deg), np.radians(PAIR_DEG),
    )  # fmt: skip


def level_factors(
    nodes: tuple[NDArray[np.intp], NDArray[np.intp]],
    off_m: NDArray[np.float64],
    by_end: NDArray[np.float64],
    by_turn: NDArray[np.float64],
    sigma_m: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    sigma_rad: float,
) -> Factors:
    """Constraints between two poses each, of `perturb_level`'s four degrees of freedom.

    Args:
        nodes: Numbers of the first and of the second pose, shape (m,) each.
        off_m: Residual position of the second pose, shape (m, 3).
        by_end: Its derivatives by the second pose's position, shape (m, 3, 3); by the first's
            it is the opposite.
        by_turn: By the first pose's heading in rad, shape (m, 3).
        sigma_m: Standard error of the position, shape (m,).
        heading_rad: Residual heading of the second pose, shape (m,).
        sigma_rad: Its standard error.
    """
    by_first, by_second = np.zeros((2, len(off_m), 4, 4))
    by_second[:, :3, :3] = by_end / sigma_m[:, None, None]
    by_first[:, :3, :3] = -by_second[:, :3, :3]
    by_first[:, :3, 3] = by_turn / sigma_m[:, None]
    by_first[:, 3, 3], by_second[:, 3, 3] = -1 / sigma_rad, 1 / sigma_rad
    residual = np.column_stack([off_m / sigma_m[:, None], heading_rad / sigma_rad])
    return Factors(residual, nodes, (by_first, by_second))
