"""Where a metric, z-up map lies on the earth, by satellite positions of its recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.scene.scene import GeodeticOrigin

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
DEFAULT_SIGMA_M = 5.0
MIN_FIXES = 10
MAX_HEADING_SIGMA_DEG = 5.0
"""A heading less certain than this is not worth turning the world for."""

CORRELATION_S = 10.0
"""Errors of fixes closer in time are taken as one: phones filter their positions."""

_ITERATIONS = 20


@dataclass(frozen=True)
class Georeference:
    """The fit of a map to satellite positions.

    Attributes:
        enu_heading_deg: Angle by which the map is turned about z, so that x is east, y north.
        origin: Where the map's origin is, WGS 84.
        fixes: Satellite positions used.
        residual_m: Median horizontal distance between them and the map.
        heading_sigma_deg: Standard error of the heading.
        scale: Metres of the fixes per metre of the map; 1 if both are right. Not applied.
    """

    enu_heading_deg: float
    origin: GeodeticOrigin
    fixes: int
    residual_m: float
    heading_sigma_deg: float
    scale: float


def georeference(
    world_m: NDArray[np.float64],
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    sigma_m: NDArray[np.float64],
    timestamp_s: NDArray[np.float64],
) -> Georeference | str:
    """Fit heading and offset, robustly; scale and up are the map's own.

    Args:
        world_m: Positions in the map at the fixes' times, shape (n, 3).
        latitude_deg: Shape (n,), WGS 84.
        longitude_deg: Shape (n,).
        altitude_m: Shape (n,), NaN where not known.
        sigma_m: Horizontal accuracy, shape (n,), NaN where not known.
        timestamp_s: Shape (n,).

    Returns:
        The fit, or why there is none.
    """
    if len(world_m) < MIN_FIXES:
        return f"only {len(world_m)} satellite positions at mapped moments; {MIN_FIXES} are needed"
    middle = GeodeticOrigin(
        float(np.median(latitude_deg)),
        float(np.median(longitude_deg)),
        float(np.nanmedian(altitude_m)) if np.isfinite(altitude_m).any() else 0.0,
    )
    enu = enu_from_geodetic(latitude_deg, longitude_deg, altitude_m, middle)
    sigma = np.where(np.isfinite(sigma_m) & (sigma_m > 0), sigma_m, DEFAULT_SIGMA_M)
    heading, offset, weights = _fit(world_m[:, :2], enu[:, :2], sigma)
    turned = _turn(world_m[:, :2], heading)
    residual = np.linalg.norm(enu[:, :2] - turned - offset, axis=1)
    spread_m = np.sqrt(np.average(_square_from_mean(turned, weights), weights=weights))
    blocks = len(np.unique(np.floor(timestamp_s / CORRELATION_S)))
    noise_m = max(float(np.median(residual)), float(np.median(sigma)) / 2)
    heading_sigma = np.degrees(noise_m / max(spread_m, 1e-9) / np.sqrt(blocks))
    if not heading_sigma <= MAX_HEADING_SIGMA_DEG:
        return (
            f"satellite positions are too uncertain for this small a walk: north would be known "
            f"to {heading_sigma:.0f} deg, {MAX_HEADING_SIGMA_DEG:g} are needed"
        )
    up_m = enu[:, 2] - world_m[:, 2]
    height = float(np.nanmedian(up_m)) if np.isfinite(up_m).any() else 0.0
    return Georeference(
        float(np.degrees(heading)),
        geodetic_from_enu(np.array([*offset, height]), middle),
        len(world_m),
        float(np.median(residual)),
        float(heading_sigma),
        _scale(turned, enu[:, :2], weights),
    )


def _fit(
    world: NDArray[np.float64], enu: NDArray[np.float64], sigma: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Heading, offset and weights by iteratively reweighted least squares (Huber)."""
    weights = 1 / sigma**2
    heading, offset = 0.0, np.zeros(2)
    for _ in range(_ITERATIONS):
        a = world - np.average(world, axis=0, weights=weights)
        b = enu - np.average(enu, axis=0, weights=weights)
        cross = (weights * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum()
        dot = (weights * (a * b).sum(axis=1)).sum()
        heading = float(np.arctan2(cross, dot))
        offset = np.average(enu - _turn(world, heading), axis=0, weights=weights)
        residual = np.linalg.norm(enu - _turn(world, heading) - offset, axis=1) / sigma
        weights = np.minimum(1.0, 1.5 / np.maximum(residual, 1e-9)) / sigma**2
    return heading, offset, weights


def _turn(points: NDArray[np.float64], heading_rad: float) -> NDArray[np.float64]:
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return points @ np.array([[c, s], [-s, c]])


def _square_from_mean(
    points: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    return ((points - np.average(points, axis=0, weights=weights)) ** 2).sum(axis=1)


def _scale(
    turned: NDArray[np.float64], enu: NDArray[np.float64], weights: NDArray[np.float64]
) -> float:
    a = turned - np.average(turned, axis=0, weights=weights)
    b = enu - np.average(enu, axis=0, weights=weights)
    dot, square = (weights[:, None] * a * b).sum(), (weights[:, None] * a * a).sum()
    return float(dot / square)


def enu_from_geodetic(
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    origin: GeodeticOrigin,
) -> NDArray[np.float64]:
    """East, north and up of points from an origin, shape (n, 3), m; up NaN without altitude.

    On WGS 84, in the plane that touches it at the origin; exact within a millimetre up to a
    kilometre away.
    """
    altitude = np.where(np.isfinite(altitude_m), altitude_m, origin.altitude_m)
    points = ecef_from_geodetic(latitude_deg, longitude_deg, altitude)
    at = [np.array([v]) for v in (origin.latitude_deg, origin.longitude_deg, origin.altitude_m)]
    enu = (points - ecef_from_geodetic(*at)) @ _enu_axes(origin).T
    enu[:, 2] = np.where(np.isfinite(altitude_m), enu[:, 2], np.nan)
    return enu


def geodetic_from_enu(enu_m: NDArray[np.float64], origin: GeodeticOrigin) -> GeodeticOrigin:
    """Latitude, longitude and altitude of a point given by its offset from an origin."""
    at = [np.array([v]) for v in (origin.latitude_deg, origin.longitude_deg, origin.altitude_m)]
    x, y, z = ecef_from_geodetic(*at)[0] + enu_m @ _enu_axes(origin)
    square = FLATTENING * (2 - FLATTENING)
    level = np.hypot(x, y)
    latitude = np.arctan2(z, level * (1 - square))
    for _ in range(5):  # converges by a factor of 300 each time
        normal = SEMI_MAJOR_M / np.sqrt(1 - square * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + square * normal * np.sin(latitude), level)
    normal = SEMI_MAJOR_M / np.sqrt(1 - square * np.sin(latitude) ** 2)
    # Not level / cos(latitude), which fails at the poles.
    altitude = level * np.cos(latitude) + z * np.sin(latitude) - SEMI_MAJOR_M**2 / normal
    return GeodeticOrigin(
        float(np.degrees(latitude)), float(np.degrees(np.arctan2(y, x))), float(altitude)
    )


def ecef_from_geodetic(
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Earth-centred coordinates of WGS 84 positions, shape (n, 3), m."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    square = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_M / np.sqrt(1 - square * np.sin(latitude) ** 2)
    level = (normal + altitude_m) * np.cos(latitude)
    return np.column_stack(
        [
            level * np.cos(longitude),
            level * np.sin(longitude),
            (normal * (1 - square) + altitude_m) * np.sin(latitude),
        ]
    )


def _enu_axes(origin: GeodeticOrigin) -> NDArray[np.float64]:
    """East, north and up in earth-centred coordinates, the rows."""
    latitude, longitude = np.radians(origin.latitude_deg), np.radians(origin.longitude_deg)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
