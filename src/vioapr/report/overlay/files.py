"""Overlays as files: a sheet as PNG, a film as GIF or MP4."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MissingExtraError, ParameterError
from vioapr.files.atomic import replacing
from vioapr.files.text import write_bytes
from vioapr.report.overlay.panels import content_colors
from vioapr.report.overlay.sheet import choose_rows, choose_stretch, draw_row, draw_titled
from vioapr.report.overlay.walk import OverlayWalk
from vioapr.report.style import spread
from vioapr.schemas.anchors import Anchor
from vioapr.work.progress import Progress, silent

if TYPE_CHECKING:
    from PIL.Image import Image

ENDINGS = (".png", ".gif", ".mp4")
_WIDTHS = {".png": 480, ".gif": 300, ".mp4": 480}
_GIF_S = 12.0
_GIF_COLORS = 200
_SAMPLES, _SWATCH_PX = 6, 6


@dataclass(frozen=True)
class OverlayParams:
    """What of a walk is shown, and how large."""

    rows: int = 4
    """Frames on a PNG sheet."""
    width_px: int | None = None
    """Width of a picture; by default 480, in a GIF 300."""
    seconds: float | None = None
    """Length of a film; by default 12 in a GIF, the whole walk in an MP4."""
    rate_hz: float = 10.0
    """Pictures a second of a film, at most; it plays in real time."""

    def __post_init__(self) -> None:
        """Refuse values that mean nothing."""
        for name, least in (("rows", 1), ("width_px", 64)):
            value = getattr(self, name)
            if value is not None and not value >= least:
                raise ParameterError(f"`{name}`: expected at least {least}, got {value}")
        for name in ("seconds", "rate_hz"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ParameterError(f"`{name}`: expected a number above 0, got {value}")


def write_overlay(
    path: Path,
    walk: OverlayWalk,
    anchors: tuple[Anchor, ...],
    params: OverlayParams = OverlayParams(),
    progress: Progress = silent,
    *,
    overwrite: bool = True,
) -> int:
    """Draw content into a walk's pictures and write them.

    Args:
        path: Its ending says what: one of `ENDINGS`.
        walk: The walk.
        anchors: The content.
        params: What is shown.
        progress: Shows how far it has come.
        overwrite: Whether a file may be replaced.

    Returns:
        The number of frames shown.

    Raises:
        ParameterError: Another ending.
        MissingExtraError: For .mp4, PyAV is not installed.
        FileError: A picture cannot be read, or the file not be written.
    """
    kind = check_ending(path)
    if kind == ".mp4":
        _import_av()
    width = params.width_px or _WIDTHS[kind]
    if kind == ".png":
        rows = choose_rows(walk, anchors, params.rows)
    else:
        rows = _film_rows(walk, anchors, params, _GIF_S if kind == ".gif" else None)
    samples = [rows[k] for k in spread(len(rows), _SAMPLES)] if kind == ".gif" else []
    with progress("drawing content", len(rows) + len(samples)) as tick:

        def draw(row: int) -> Image:
            strip = draw_row(walk, row, anchors, width)
            tick()
            return strip

        if kind == ".png":
            buffer = io.BytesIO()
            draw_titled(walk, [draw(row) for row in rows], width).save(buffer, format="png")
            write_bytes(path, buffer.getvalue(), overwrite=overwrite)
            return len(rows)
        frames = (draw_titled(walk, [draw(row)], width) for row in rows)
        durations_s = _durations_s(walk, rows)
        with replacing(path, overwrite=overwrite) as partial:
            if kind == ".gif":
                palette = find_palette([draw_titled(walk, [draw(k)], width) for k in samples])
                _write_gif(partial, frames, durations_s, palette)
            else:
                _write_mp4(partial, frames, durations_s)
    return len(rows)


def check_ending(path: Path) -> str:
    """The kind of a file by its name, in lower case.

    Raises:
        ParameterError: It is none of `ENDINGS`.
    """
    kind = path.suffix.lower()
    if kind not in ENDINGS:
        raise ParameterError(f"`out`: expected a name ending in {', '.join(ENDINGS)}, got {path}")
    return kind


def _film_rows(
    walk: OverlayWalk, anchors: tuple[Anchor, ...], params: OverlayParams, default_s: float | None
) -> list[int]:
    seconds = params.seconds or default_s
    rows = np.arange(len(walk)) if seconds is None else choose_stretch(walk, anchors, seconds)
    kept: list[int] = []
    for row in rows.tolist():
        # A tenth of slack: a frame a little early is the one that was meant.
        if not kept or walk.timestamp_s[row] - walk.timestamp_s[kept[-1]] > 0.9 / params.rate_hz:
            kept.append(row)
    return kept


def _durations_s(walk: OverlayWalk, rows: Sequence[int]) -> NDArray[np.float64]:
    """How long each frame is seen: until the next one, the last as long as is usual."""
    steps_s = np.diff(walk.timestamp_s[list(rows)])
    return np.append(steps_s, np.median(steps_s) if len(steps_s) else 1.0)


def find_palette(samples: Sequence[Image]) -> Image:
    """Find one palette for all frames of a film, so that colours do not flicker.

    Args:
        samples: Some of the frames, of one size, at least one.

    Returns:
        An image in a palette, as `Image.quantize` takes it.
    """
    from PIL import Image
    from PIL.Image import Quantize, Resampling

    width, height = (max(size // 2, 1) for size in samples[0].size)
    shades = [shade for color in content_colors() for shade in _shades(color)]
    mosaic = Image.new("RGB", (width, height * len(samples) + _SWATCH_PX * len(shades)))
    for number, sample in enumerate(samples):
        mosaic.paste(sample.resize((width, height), Resampling.NEAREST), (0, number * height))
    # Content is small in pictures, and is what one looks at: its shades count as much as walls.
    for number, shade in enumerate(shades):
        top = height * len(samples) + number * _SWATCH_PX
        mosaic.paste(shade, (0, top, width, top + _SWATCH_PX))
    return mosaic.quantize(_GIF_COLORS, Quantize.MEDIANCUT)


def _shades(color: NDArray[np.float64]) -> list[tuple[int, int, int]]:
    """A colour of content from its dark side to its light one."""
    dark_to_light = np.linspace(0.6, 1.0, 5)[:, None] * color * 255
    return [(int(r), int(g), int(b)) for r, g, b in dark_to_light.round()]


def _write_gif(
    path: Path, frames: Iterator[Image], durations_s: NDArray[np.float64], palette: Image
) -> None:
    from PIL.Image import Dither

    indexed = (frame.quantize(palette=palette, dither=Dither.NONE) for frame in frames)
    first = next(indexed)
    # GIF counts hundredths of a second; rounding their sum keeps the pace.
    ends = np.round(np.cumsum(durations_s) * 100)
    steps_ms = np.maximum(np.diff(ends, prepend=0.0), 2) * 10
    with path.open("wb") as file:
        first.save(
            file, format="gif", save_all=True, append_images=indexed, loop=0,
            duration=steps_ms.astype(int).tolist(), optimize=False,
        )  # fmt: skip


def _write_mp4(path: Path, frames: Iterator[Image], durations_s: NDArray[np.float64]) -> None:
    """Write H.264 that every browser and phone plays, each frame at its own time."""
    av = _import_av()
    base = Fraction(1, 90_000)
    starts_s = np.concatenate([[0.0], np.cumsum(durations_s)[:-1]])
    rate = max(round(1 / float(np.median(durations_s))), 1)
    first = next(frames)
    with path.open("wb") as file, av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height = first.size
        stream.pix_fmt, stream.time_base = "yuv420p", base
        stream.options = {"crf": "20", "preset": "medium"}
        for start_s, image in zip(starts_s, chain([first], frames), strict=True):
            frame = av.VideoFrame.from_image(image)
            frame.pts, frame.time_base = round(start_s / base), base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _import_av() -> Any:
    try:
        import av
    except ImportError:
        raise MissingExtraError("Writing an MP4", "av", "video") from None
    return av
