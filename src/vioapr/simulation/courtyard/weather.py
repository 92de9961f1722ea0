"""Light and weather: what differs between recordings of one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.simulation.courtyard.noise import Field, fractal, step

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Weather:
    """Light on a day; colours are linear, in units of a white wall in overcast daylight.

    Attributes:
        name: For people.
        sun_azimuth_deg: Where the sun stands, counterclockwise from the world's x axis.
        sun_elevation_deg: Above the horizon.
        sun: Its light; 0 where clouds hide it.
        sky: Light of the whole sky on level ground.
        bounce: Light that ground and walls throw back.
        lamps: Street lamps and windows.
        zenith: The sky's own colour overhead.
        horizon: Its colour above the roofs.
        clouds: Share of the sky, 0 to 1.
        cloud: Their colour.
        haze_per_m: How fast distance fades into the horizon's colour.
        wetness: 0 for dry ground, 1 after rain.
        exposure: Gain that a phone would choose.
        exposure_time_s: How long the shutter is open.
        noise: Of the sensor at that gain, a share of white.
    """

    name: str
    sun_azimuth_deg: float
    sun_elevation_deg: float
    sun: Rgb
    sky: Rgb
    bounce: Rgb
    lamps: Rgb
    zenith: Rgb
    horizon: Rgb
    clouds: float
    cloud: Rgb
    haze_per_m: float
    wetness: float
    exposure: float
    exposure_time_s: float
    noise: float

    @property
    def sun_direction(self) -> NDArray[np.float64]:
        """Unit vector towards the sun, world."""
        azimuth, elevation = np.deg2rad([self.sun_azimuth_deg, self.sun_elevation_deg])
        level = np.cos(elevation)
        return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])

    @property
    def has_sun(self) -> bool:
        """Whether anything throws a shadow."""
        return max(self.sun) > 0


SUNNY = Weather(
    "sunny", 232.0, 50.0, (2.3, 2.15, 1.85), (0.5, 0.57, 0.68), (0.34, 0.31, 0.27), (0, 0, 0),
    (0.22, 0.4, 0.75), (0.66, 0.78, 0.92), 0.35, (1.35, 1.33, 1.3), 0.0006, 0.0, 0.9, 0.002, 0.008,
)  # fmt: skip
OVERCAST = Weather(
    "overcast", 200.0, 60.0, (0, 0, 0), (0.93, 0.97, 1.04), (0.16, 0.155, 0.15), (0, 0, 0),
    (0.62, 0.66, 0.72), (0.85, 0.87, 0.9), 0.95, (0.9, 0.92, 0.95), 0.0012, 0.0, 1.4, 0.006, 0.012,
)  # fmt: skip
LATE_SUN = Weather(
    "late sun", 158.0, 27.0, (2.5, 1.75, 1.05), (0.36, 0.42, 0.52), (0.28, 0.22, 0.17), (0, 0, 0),
    (0.3, 0.42, 0.65), (0.95, 0.8, 0.62), 0.3, (1.4, 1.1, 0.85), 0.0012, 0.0, 1.1, 0.004, 0.012,
)  # fmt: skip
AFTER_RAIN = Weather(
    "after rain", 300.0, 38.0, (0, 0, 0), (0.68, 0.74, 0.82), (0.1, 0.105, 0.11),
    (0.12, 0.08, 0.04), (0.4, 0.44, 0.5), (0.68, 0.72, 0.77), 1.0, (0.62, 0.65, 0.7),
    0.002, 0.8, 2.0, 0.010, 0.018,
)  # fmt: skip
DUSK = Weather(
    "low light", 250.0, 10.0, (0, 0, 0), (0.11, 0.13, 0.19), (0.03, 0.03, 0.035),
    (0.95, 0.55, 0.22), (0.06, 0.09, 0.18), (0.34, 0.27, 0.27), 0.6, (0.2, 0.17, 0.2),
    0.001, 0.0, 3.8, 0.022, 0.035,
)  # fmt: skip
MORNING = Weather(
    "morning", 20.0, 36.0, (2.2, 1.95, 1.55), (0.46, 0.52, 0.6), (0.3, 0.27, 0.23), (0, 0, 0),
    (0.28, 0.45, 0.75), (0.78, 0.83, 0.9), 0.5, (1.3, 1.25, 1.18), 0.0018, 0.25, 0.95, 0.003, 0.009,
)  # fmt: skip

WEATHERS = {w.name: w for w in (SUNNY, OVERCAST, LATE_SUN, AFTER_RAIN, DUSK, MORNING)}


def paint_sky(rng: np.random.Generator, weather: Weather, size_px: int = 512) -> Field:
    """The upper half of the sky as a disc seen from below, (size, size, 3), linear.

    A direction (x, y, z) is at the disc's (x, y) / (1 + z), from -1 to 1.
    """
    grid = (np.arange(size_px, dtype=np.float32) + 0.5) / size_px * 2 - 1
    x, y = np.meshgrid(grid, grid)
    squared = np.minimum(x * x + y * y, 1.0)
    up = (1 - squared) / (1 + squared)
    share = step(up, -0.15, 0.75)[..., None]
    picture = np.asarray(weather.horizon, np.float32) * (1 - share) + np.multiply(
        weather.zenith, share
    )
    billows = fractal(rng, (size_px, size_px), slope=1.75, coarsest_px=size_px / 2.2)
    level = 1.6 - 3.2 * weather.clouds
    cover = step(billows, level, level + 1.1)
    shade = 1 + 0.1 * fractal(rng, (size_px, size_px), slope=1.6) - 0.16 * step(billows, level, 3)
    clouds = np.asarray(weather.cloud, np.float32) * shade[..., None]
    picture = picture + (clouds - picture) * (0.92 * cover)[..., None]
    direction = np.stack([x * (1 + up), y * (1 + up), up], axis=-1)
    glow = np.exp(-(1 - direction @ weather.sun_direction) * 14.0)
    return (picture + np.multiply(weather.sun, 0.35 * glow[..., None])).astype(np.float32)
