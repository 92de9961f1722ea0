"""Random fields that surfaces are painted with: grain, stains, cracks and per-tile variation.

Arrays are float32, rows from the top of a picture to its bottom.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import fft

Field = NDArray[np.floating]

_SMOOTH = 1.3


def fractal(
    rng: np.random.Generator,
    shape: tuple[int, int],
    *,
    slope: float = 1.2,
    coarsest_px: float | None = None,
    finest_px: float = 2.0,
    stretch: float = 1.0,
) -> Field:
    """Noise whose amplitude falls with frequency, mean 0, standard deviation 1, periodic.

    Args:
        rng: Source of randomness.
        shape: Rows and columns, px.
        slope: Amplitude is proportional to frequency ** -slope: 0 is white, 1 like stone,
            2 like clouds.
        coarsest_px: Longest wave, px; None for the whole picture.
        finest_px: Shortest wave, px.
        stretch: How many times longer its shapes are vertically than horizontally.
    """
    if slope >= _SMOOTH and finest_px <= 4 and min(shape) >= 256:
        # Smooth fields are drawn at a quarter of the size, which is 16 times faster.
        small = (-(-shape[0] // 4), -(-shape[1] // 4))
        coarsest = None if coarsest_px is None else coarsest_px / 4
        field = _spectral(rng, small, slope, coarsest, finest_px / 4, stretch)
        image = Image.fromarray(field).resize((shape[1], shape[0]), Image.Resampling.BICUBIC)
        return np.asarray(image)
    return _spectral(rng, shape, slope, coarsest_px, finest_px, stretch)


def _spectral(
    rng: np.random.Generator,
    shape: tuple[int, int],
    slope: float,
    coarsest_px: float | None,
    finest_px: float,
    stretch: float,
) -> Field:
    """White noise, its spectrum weighted."""
    white = rng.standard_normal(shape, dtype=np.float32)
    down = fft.fftfreq(shape[0]).astype(np.float32)[:, None] * np.float32(stretch)
    across = fft.rfftfreq(shape[1]).astype(np.float32)[None, :]
    squared = down * down + across * across
    squared[0, 0] = 1.0
    weight = squared ** np.float32(-slope / 2)
    weight[squared > 1 / finest_px**2] = 0.0
    if coarsest_px is not None:  # of a coarse picture, something is left in any case
        weight[squared < 1 / max(coarsest_px, 2.5 * finest_px) ** 2] = 0.0
    weight[0, 0] = 0.0
    spectrum = np.asarray(fft.rfft2(white)) * weight
    field = np.asarray(fft.irfft2(spectrum, s=shape))
    return (field / field.std()).astype(np.float32)


def step(field: Field, start: float, end: float) -> Field:
    """0 below `start`, 1 above `end`, smooth between; falling where start is above end."""
    share = np.clip((field - start) / (end - start), 0.0, 1.0)
    return (share * share * (3 - 2 * share)).astype(np.float32)


def coordinates_m(shape: tuple[int, int], px_per_m: float) -> tuple[Field, Field]:
    """Columns' x from the left, shape (1, w), and rows' y from the bottom, (h, 1), metres."""
    x = (np.arange(shape[1], dtype=np.float32) + 0.5) / px_per_m
    y = (shape[0] - 0.5 - np.arange(shape[0], dtype=np.float32)) / px_per_m
    return x[None, :], y[:, None]


def cracks(rng: np.random.Generator, shape: tuple[int, int], width: float = 0.02) -> Field:
    """Thin winding lines, 0 to 1: where a field changes sign, in some places only."""
    line = np.exp(-np.square(fractal(rng, shape, slope=1.6) / width))
    return line * step(fractal(rng, shape, slope=1.8), 0.6, 1.4)


def mix(base: Field, other: Field | NDArray | tuple[float, ...], share: Field | float) -> Field:
    """A colour picture with another laid over it.

    Args:
        base: Shape (h, w, 3).
        other: A picture or one colour.
        share: Of the other: one number, or a field of shape (h, w).
    """
    weight = np.asarray(share, dtype=np.float32)
    weight = weight[..., None] if weight.ndim else weight
    change = np.asarray(other, dtype=np.float32) - base
    change *= weight
    change += base
    return change


def to_pixels(picture: Field) -> NDArray[np.uint8]:
    """Colours from 0 to 1 as bytes."""
    return (np.clip(picture, 0.0, 1.0) * 255 + 0.5).astype(np.uint8)
