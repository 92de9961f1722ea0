"""Where a metric, z-up map lies on the earth, by satellite positions of its recordings.

Coordinates on WGS 84 are converted by COLMAP, which mapping needs anyway.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.mapping.colmap import load_pycolmap
from vioapr.schemas.map_summary import Georeference
from vioapr.schemas.scene import GeodeticOrigin

DEFAULT_SIGMA_M = 5.0
MIN_FIXES = 10
MAX_HEADING_SIGMA_DEG = 5.0
"""A heading less certain than this is not worth turning the world for."""

CORRELATION_S = 10.0
"""Errors of fixes closer in time are taken as one: phones filter their positions."""

_ITERATIONS = 20


class Fixes(NamedTuple):
    """Satellite positions, n of them.

    Attributes:
        world_m: Positions in the map at their times, shape (n, 3).
        latitude_deg: Shape (n,), WGS 84.
        longitude_deg: Shape (n,).
        altitude_m: Above the ellipsoid, shape (n,), NaN where not known.
        sigma_m: Horizontal accuracy, shape (n,), NaN where not known.
        timestamp_s: Shape (n,).
    """

    world_m: NDArray[np.float64]
    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]
    altitude_m: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    timestamp_s: NDArray[np.float64]


def georeference(fixes: Fixes) -> Georeference | str:
    """Fit heading and offset, robustly; scale and up are the map's own.

    Returns:
        The fit, or why there is none.
    """
    world_m, latitude_deg, longitude_deg, altitude_m, sigma_m, timestamp_s = fixes
    if len(world_m) < MIN_FIXES:
        return f"only {len(world_m)} satellite positions at mapped moments; {MIN_FIXES} are needed"
    middle = GeodeticOrigin(
        latitude_deg=float(np.median(latitude_deg)),
        longitude_deg=float(np.median(longitude_deg)),
        altitude_m=float(np.nanmedian(altitude_m)) if np.isfinite(altitude_m).any() else 0.0,
    )
    enu = enu_from_geodetic(latitude_deg, longitude_deg, altitude_m, middle)
    level_m = enu[:, :2]
    sigma = np.where(np.isfinite(sigma_m) & (sigma_m > 0), sigma_m, DEFAULT_SIGMA_M)
    heading, offset, weights = fit_heading(world_m[:, :2], level_m, sigma)

    turned = turn(world_m[:, :2], heading)
    residual_m = float(np.median(np.linalg.norm(level_m - turned - offset, axis=1)))
    from_mean = turned - np.average(turned, axis=0, weights=weights)
    spread_m = np.sqrt(np.average((from_mean**2).sum(axis=1), weights=weights))
    blocks = len(np.unique(np.floor(timestamp_s / CORRELATION_S)))
    noise_m = max(residual_m, float(np.median(sigma)) / 2)
    heading_sigma = float(np.degrees(noise_m / max(spread_m, 1e-9) / np.sqrt(blocks)))
    if not heading_sigma <= MAX_HEADING_SIGMA_DEG:
        return (
            f"satellite positions are too uncertain for this small a walk: north would be known "
            f"to {heading_sigma:.0f} deg, {MAX_HEADING_SIGMA_DEG:g} are needed"
        )
    up_m = enu[:, 2] - world_m[:, 2]
    height_m = float(np.nanmedian(up_m)) if np.isfinite(up_m).any() else 0.0
    # Least squares of the fixes' lengths by the map's.
    enu_from_mean = level_m - np.average(level_m, axis=0, weights=weights)
    dot = (weights[:, None] * from_mean * enu_from_mean).sum()
    return Georeference(
        enu_heading_deg=float(np.degrees(heading)),
        origin=geodetic_from_enu(np.array([*offset, height_m]), middle),
        fixes=len(world_m),
        residual_m=residual_m,
        heading_sigma_deg=heading_sigma,
        scale=float(dot / (weights[:, None] * from_mean * from_mean).sum()),
    )


def fit_heading(
    world_m: NDArray[np.float64], enu_m: NDArray[np.float64], sigma_m: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Fit a turn and an offset in the plane, by iteratively reweighted least squares (Huber).

    Args:
        world_m: Points, shape (n, 2).
        enu_m: Where they are to be, shape (n, 2).
        sigma_m: Standard error of each, shape (n,).

    Returns:
        The turn in rad, the offset, shape (2,), and the points' weights, shape (n,).
    """
    weights = 1 / sigma_m**2
    heading, offset = 0.0, np.zeros(2)
    for _ in range(_ITERATIONS):
        a = world_m - np.average(world_m, axis=0, weights=weights)
        b = enu_m - np.average(enu_m, axis=0, weights=weights)
        cross = (weights * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum()
        dot = (weights * (a * b).sum(axis=1)).sum()
        heading = float(np.arctan2(cross, dot))
        offset = np.average(enu_m - turn(world_m, heading), axis=0, weights=weights)
        residual = np.linalg.norm(enu_m - turn(world_m, heading) - offset, axis=1) / sigma_m
        weights = np.minimum(1.0, 1.5 / np.maximum(residual, 1e-9)) / sigma_m**2
    return heading, offset, weights


def turn(points_m: NDArray[np.float64], heading_rad: float) -> NDArray[np.float64]:
    """Turn points of the plane counterclockwise, shape (n, 2)."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return points_m @ np.array([[c, s], [-s, c]])


def enu_from_geodetic(
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    origin: GeodeticOrigin,
) -> NDArray[np.float64]:
    """East, north and up of points from an origin, shape (n, 3), m; up NaN without altitude.

    On WGS 84, in the plane that touches it at the origin.
    """
    altitude = np.where(np.isfinite(altitude_m), altitude_m, origin.altitude_m)
    points = np.column_stack([latitude_deg, longitude_deg, altitude])
    enu = _wgs84().ellipsoid_to_enu(
        points, origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    enu[:, 2] = np.where(np.isfinite(altitude_m), enu[:, 2], np.nan)
    return enu


def geodetic_from_enu(enu_m: NDArray[np.float64], origin: GeodeticOrigin) -> GeodeticOrigin:
    """Latitude, longitude and altitude of a point by its offset from an origin, shape (3,).

    Exact to 3 nm; within a kilometre of a pole, the altitude to 0.2 mm.
    """
    ((latitude, longitude, altitude),) = _wgs84().enu_to_ellipsoid(
        enu_m[None], origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    return GeodeticOrigin(
        latitude_deg=float(latitude), longitude_deg=float(longitude), altitude_m=float(altitude)
    )


def _wgs84() -> Any:
    pycolmap = load_pycolmap()
    return pycolmap.GPSTransform(pycolmap.GPSTransformEllipsoid.WGS84)
