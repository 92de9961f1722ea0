"""Printed and painted things that make a place unlike others: posters, signs, a mural."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vioapr.simulation.courtyard.noise import Field, cracks, fractal, mix, step

_WORDS = (
    "CONCERT", "MARKET", "JAZZ", "THEATRE", "SUNDAY", "CIRCUS", "BOOKS", "CINEMA", "OPERA",
    "FLOWERS", "POETRY", "DANCE", "MUSEUM", "CHESS", "RECORDS", "BREAD", "HARVEST", "BALLET",
)  # fmt: skip


def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, which is the same on every machine."""
    return ImageFont.load_default(size_px)


def poster_sheet(
    rng: np.random.Generator, shape: tuple[int, int] = (1024, 1024), columns: int = 6
) -> Field:
    """A wall of torn, overlapping posters, no two alike, (h, w, 3)."""
    sheet = Image.new("RGB", (shape[1], shape[0]), (150, 140, 120))
    width = shape[1] // columns
    height = int(width * 1.4)
    for top in range(-height // 3, shape[0], int(height * 0.92)):
        for left in range(0, shape[1], width):
            turned = poster(rng, (width, height)).rotate(
                rng.uniform(-3, 3), expand=False, fillcolor=(150, 140, 120)
            )
            sheet.paste(turned, (left, top + int(rng.integers(-8, 8))))
    picture = np.asarray(sheet, dtype=np.float32) / 255
    # Sun-bleached, creased and torn off in places.
    picture = mix(picture, (0.82, 0.79, 0.72), np.clip(0.22 + 0.1 * fractal(rng, shape), 0, 0.7))
    picture = mix(picture, (0.9, 0.88, 0.83), 0.5 * cracks(rng, shape, 0.03))
    torn = step(fractal(rng, shape, slope=1.5), 1.5, 1.6)
    return mix(picture, (0.72, 0.68, 0.6), torn)


def sign(text: str, size_px: tuple[int, int], color: str, ground: str) -> Field:
    """A shop sign with a border, (h, w, 3)."""
    image = Image.new("RGB", size_px, ground)
    draw = ImageDraw.Draw(image)
    margin = size_px[1] // 14
    draw.rectangle((margin, margin, size_px[0] - margin, size_px[1] - margin), outline=color,
                   width=max(2, margin // 2))  # fmt: skip
    box = draw.textbbox((0, 0), text, font=font(int(size_px[1] * 0.55)))
    origin = ((size_px[0] - box[2] - box[0]) / 2, (size_px[1] - box[3] - box[1]) / 2)
    draw.text(origin, text, fill=color, font=font(int(size_px[1] * 0.55)))
    return np.asarray(image, dtype=np.float32) / 255


def mural(rng: np.random.Generator, size_px: tuple[int, int]) -> tuple[Field, Field]:
    """A painted wall of overlapping shapes and letters: colours (h, w, 3), cover (h, w)."""
    image = Image.new("RGBA", size_px, (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)
    width, height = size_px
    for _ in range(60):
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        reach = rng.uniform(0.03, 0.22) * width
        color = (*_ink(rng), 255)
        angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
        radius = reach * rng.uniform(0.5, 1.0, len(angle))
        points = [
            (x + r * np.cos(a), y + r * np.sin(a)) for a, r in zip(angle, radius, strict=True)
        ]
        draw.polygon(points, fill=color)
        draw.line([*points, points[0]], fill=(25, 25, 30, 255), width=int(rng.integers(2, 6)))
    for word in rng.choice(_WORDS, 3, replace=False):
        spot = (rng.uniform(0, width * 0.6), rng.uniform(0, height * 0.75))
        draw.text(spot, str(word), fill=(*_ink(rng), 255), font=font(height // 4), stroke_width=4,
                  stroke_fill=(240, 240, 230, 255))  # fmt: skip
    pixels = np.asarray(image, dtype=np.float32) / 255
    worn = 1 - 0.8 * step(fractal(rng, pixels.shape[:2], slope=1.1), 1.1, 1.9)
    return pixels[..., :3], 0.9 * pixels[..., 3] * worn


def tag(rng: np.random.Generator, size_px: tuple[int, int]) -> Field:
    """A sprayed scrawl: how much of the paint covers each pixel, (h, w)."""
    image = Image.new("L", size_px, 0)
    draw = ImageDraw.Draw(image)
    steps = rng.normal(0, 1, size=(60, 2)) * [size_px[0] / 9, size_px[1] / 5]
    path = np.cumsum(steps * 0.55, axis=0)
    path = (path - path.min(axis=0)) / np.ptp(path, axis=0) * (np.array(size_px) * 0.9) + 3
    smooth = np.stack([np.convolve(path[:, k], np.ones(4) / 4, "valid") for k in range(2)], axis=-1)
    draw.line([tuple(p) for p in smooth], fill=230, width=max(2, size_px[1] // 22), joint="curve")
    return np.asarray(image, dtype=np.float32) / 255


def _ink(rng: np.random.Generator, low: float = 25, high: float = 235) -> tuple[int, ...]:
    """A colour as printers mix them: rarely a pure one."""
    grey, color = rng.uniform(low, high), rng.uniform(low, high, 3)
    return tuple(int(c) for c in 0.5 * grey + 0.5 * color)


def poster(rng: np.random.Generator, size: tuple[int, int]) -> Image.Image:
    """A poster of two words, shapes and lines; width and height in pixels."""
    ground = _ink(rng, 20, 255)
    image = Image.new("RGB", size, ground)
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(2, 7)):
        x, y = rng.uniform(0, size[0]), rng.uniform(0, size[1])
        w, h = rng.uniform(0.1, 0.6) * size[0], rng.uniform(0.1, 0.5) * size[1]
        color = _ink(rng, 0, 255)
        shape = rng.choice(["ellipse", "rectangle", "line"])
        if shape == "line":
            draw.line((x, y, x + w, y + h), fill=color, width=int(rng.integers(3, 16)))
        else:
            getattr(draw, shape)((x - w / 2, y - h / 2, x + w / 2, y + h / 2), fill=color)
    ink = (15, 15, 20) if sum(ground) > 380 else (245, 240, 225)
    word, other = rng.choice(_WORDS, 2, replace=False)
    draw.text((size[0] * 0.06, size[1] * 0.05), str(word), fill=ink, font=font(size[0] // 6))
    draw.text((size[0] * 0.06, size[1] * 0.72), str(other), fill=ink, font=font(size[0] // 8))
    for line in range(rng.integers(2, 6)):
        y = size[1] * (0.84 + 0.03 * line)
        draw.line((size[0] * 0.06, y, size[0] * rng.uniform(0.4, 0.9), y), fill=ink, width=2)
    return image
