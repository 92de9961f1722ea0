"""The phone's camera along a walk: exposure, white balance, blur and noise of every frame."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vioapr.files.images import JPEG_QUALITY
from vioapr.scene.frames import Intrinsics
from vioapr.simulation.courtyard.render import Figure, Renderer, Shot
from vioapr.simulation.courtyard.walks import Motion
from vioapr.simulation.courtyard.weather import Weather

_TARGET_GREY = 112.0
"""Mean value that the exposure aims at, of 255."""
_ADAPTATION = 0.08
"""Share of the way that the exposure goes at every frame."""
_RANGE = 1.7
"""How far automatic exposure may go from the weather's, as a factor either way."""


class Photographer:
    """Takes the pictures of one recording, one after another."""

    def __init__(
        self, rng: np.random.Generator, renderer: Renderer, weather: Weather, camera: Intrinsics
    ) -> None:
        """Begin a recording.

        Args:
            rng: Draws this recording's exposure and white balance.
            renderer: Its weather is set.
            weather: The same.
            camera: The phone's.
        """
        self._renderer, self._weather, self._camera = renderer, weather, camera
        self._gain = float(np.exp(rng.normal(0, 0.12)))
        self._balance = np.exp(
            rng.normal(0, 1, 2) @ np.array([[0.05, 0.0, -0.06], [0.0, 0.02, 0.0]])
        )
        self._adapted = 1.0
        self._seed = int(rng.integers(1, 2**31))

    def take(self, motion: Motion, time_s: float, figures: Sequence[Figure] = ()) -> bytes:
        """Take the next picture, as a JPEG file."""
        pixels = self.see(motion, time_s, figures)
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "JPEG", quality=JPEG_QUALITY)
        return file.getvalue()

    def see(
        self, motion: Motion, time_s: float, figures: Sequence[Figure] = ()
    ) -> NDArray[np.uint8]:
        """Take the next picture, shape (height, width, 3); exposure adapts to it."""
        weather = self._weather
        gain = weather.exposure * self._gain * self._adapted
        turned = motion.angular_velocity_rad_s(time_s) * weather.exposure_time_s
        self._seed += 1
        shot = Shot(tuple(gain * self._balance), tuple(turned), weather.noise, self._seed)  # type: ignore[arg-type]
        pixels = self._renderer.render(motion.world_from_cam(time_s), self._camera, shot, figures)
        self._adapt(pixels)
        return pixels

    def _adapt(self, pixels: NDArray[np.uint8]) -> None:
        """Automatic exposure follows the brightness of what it saw last, within limits."""
        grey = max(float(pixels[::4, ::4].mean()), 1.0)
        wanted = self._adapted * (_TARGET_GREY / grey) ** 1.5
        self._adapted *= (np.clip(wanted, 1 / _RANGE, _RANGE) / self._adapted) ** _ADAPTATION
