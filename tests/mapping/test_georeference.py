import numpy as np
import pytest

from vioapr.mapping.georeference import (
    Fixes,
    enu_from_geodetic,
    geodetic_from_enu,
    georeference,
)
from vioapr.schemas.map_summary import Georeference
from vioapr.schemas.scene import GeodeticOrigin

AALTO = GeodeticOrigin(60.1841, 24.8301, 20.0)


pytest.importorskip("pycolmap", reason="pycolmap is not installed")

AXIS_M, FLATNESS = 6378137.0, 1 / 298.257223563


def earth_centred_m(latitude_deg, longitude_deg, altitude_m):
    """By the textbook, for comparison."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    square = FLATNESS * (2 - FLATNESS)
    normal = AXIS_M / np.sqrt(1 - square * np.sin(latitude) ** 2)
    level = (normal + altitude_m) * np.cos(latitude)
    height = (normal * (1 - square) + altitude_m) * np.sin(latitude)
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), height], axis=-1)


def test_earth_centred_coordinates_of_known_places():
    """The equator on the prime meridian, and the north pole, 100 m up."""
    np.testing.assert_allclose(earth_centred_m(0, 0, 0), [6378137.0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(earth_centred_m(90, 0, 100), [0, 0, 6356852.314245], atol=1e-6)


@pytest.mark.parametrize(
    "origin",
    [AALTO, GeodeticOrigin(-33.9, 151.2), GeodeticOrigin(0, 180), GeodeticOrigin(89.99, 10, 50)],
)
def test_distances_are_those_of_earth_centred_coordinates(origin, rng):
    spread = rng.uniform(-1, 1, (200, 3)) * [0.005, 0.005, 50]
    middle = np.array([origin.latitude_deg, origin.longitude_deg, origin.altitude_m])
    place = middle + spread
    enu = enu_from_geodetic(*place.T, origin)
    centred = earth_centred_m(*place.T)
    centre = earth_centred_m(*middle)
    np.testing.assert_allclose(
        np.linalg.norm(enu, axis=1), np.linalg.norm(centred - centre, axis=1), atol=1e-6
    )
    apart = np.linalg.norm(enu[1:] - enu[:-1], axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(np.diff(centred, axis=0), axis=1), atol=1e-6)


def test_a_minute_of_latitude_is_a_nautical_mile():
    north = enu_from_geodetic(
        np.array([45.0 + 1 / 60]), np.array([7.0]), np.array([0.0]), GeodeticOrigin(45.0, 7.0)
    )[0]
    assert north[1] == pytest.approx(1852, rel=0.001)
    assert abs(north[0]) < 1e-6


@pytest.mark.parametrize("origin", [AALTO, GeodeticOrigin(-33.9, 151.2), GeodeticOrigin(0, 180)])
def test_there_and_back(origin, rng):
    offset = 300 * rng.standard_normal(3)
    there = geodetic_from_enu(offset, origin)
    back = enu_from_geodetic(
        *(np.array([v]) for v in (there.latitude_deg, there.longitude_deg, there.altitude_m)),
        origin,
    )
    np.testing.assert_allclose(back[0], offset, atol=1e-6)


def fixes(rng, size_m=60.0, noise_m=2.0, count=120, outliers=0):
    """A walk in a world turned by 30 deg, whose origin is at AALTO."""
    world = np.column_stack([size_m * rng.uniform(-0.5, 0.5, (count, 2)), np.zeros(count)])
    angle = np.radians(30)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    enu = np.column_stack([world[:, :2] @ turn.T, world[:, 2]])
    enu += noise_m * rng.standard_normal((count, 3))
    enu[:outliers] += [80.0, 0.0, 0.0]
    places = [geodetic_from_enu(offset, AALTO) for offset in enu]
    columns = np.array([(p.latitude_deg, p.longitude_deg, p.altitude_m) for p in places]).T
    return Fixes(world, *columns, np.full(count, noise_m), np.arange(count) * 1.0)


@pytest.mark.parametrize("outliers", [0, 15])
def test_heading_and_origin_are_found(rng, outliers):
    found = georeference(fixes(rng, outliers=outliers))
    assert isinstance(found, Georeference)
    assert found.enu_heading_deg == pytest.approx(30, abs=2)
    off = enu_from_geodetic(
        np.array([found.origin.latitude_deg]), np.array([found.origin.longitude_deg]),
        np.array([found.origin.altitude_m]), AALTO,
    )[0]  # fmt: skip
    assert np.abs(off).max() < 2.5
    assert found.scale == pytest.approx(1, abs=0.05)
    assert found.residual_m == pytest.approx(2.4, abs=0.8)  # the median of a Rayleigh of 2 m


def test_a_wrong_scale_shows(rng):
    world, *others = fixes(rng, noise_m=0.1)
    found = georeference(Fixes(world * 0.9, *others))
    assert isinstance(found, Georeference)
    assert found.scale == pytest.approx(1 / 0.9, rel=0.01)


def test_too_small_a_walk_says_why(rng):
    assert "too uncertain for this small a walk" in georeference(fixes(rng, 3.0, 5.0))
    few = Fixes(*(column[:5] for column in fixes(rng)))
    assert "only 5 satellite positions" in georeference(few)


def test_altitude_may_be_missing(rng):
    world, latitude, longitude, altitude, sigma, times = fixes(rng)
    found = georeference(
        Fixes(world, latitude, longitude, altitude * np.nan, sigma * np.nan, times)
    )
    assert isinstance(found, Georeference)
    assert found.origin.altitude_m == pytest.approx(0, abs=0.01)
