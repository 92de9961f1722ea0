"""Panels side by side, an estimate a column: one frame of a film, or a sheet of some frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vioapr.report.overlay.content import find_seen
from vioapr.report.overlay.panels import draw_chip, draw_panels, font
from vioapr.report.overlay.walk import FUSED, RAW, TRUTH, OverlayWalk
from vioapr.schemas.anchors import Anchor

if TYPE_CHECKING:
    from PIL.Image import Image

_TITLES = {RAW: "raw predictions", FUSED: "fused with VIO", TRUTH: "truth"}
_PAPER, _INK, _FAINT = "#ffffff", "#16181d", "#6b7280"
_HARDLY = 0.2
"""How well content must be seen at least, see `find_seen`, to be shown."""


def choose_rows(walk: OverlayWalk, anchors: tuple[Anchor, ...], count: int) -> list[int]:
    """Choose frames to show: of as many equal stretches of the walk, those that see content best.

    How well is decided by the reference poses alone, never by how large errors are.
    """
    seen = find_seen(walk, anchors).max(axis=1)
    rows = np.flatnonzero(seen > _HARDLY)
    if not len(rows):
        rows = np.arange(len(walk))
    parts = np.array_split(rows, min(count, len(rows)))
    return [int(part[seen[part].argmax()]) for part in parts]


def choose_stretch(
    walk: OverlayWalk, anchors: tuple[Anchor, ...], duration_s: float
) -> NDArray[np.intp]:
    """Choose the rows of the stretch of some seconds that sees most content."""
    seen, times = find_seen(walk, anchors).max(axis=1), walk.timestamp_s
    total = np.concatenate([[0.0], np.cumsum(seen)])
    ends = np.searchsorted(times, times + duration_s)
    start = int((total[ends] - total[:-1]).argmax())
    return np.arange(start, ends[start])


def draw_row(walk: OverlayWalk, row: int, anchors: tuple[Anchor, ...], width: int) -> Image:
    """Draw a frame by every estimate, panels side by side, with the time.

    Args:
        walk: The walk.
        row: The frame.
        anchors: The content.
        width: Of a panel, pixels.

    Raises:
        FileError: The picture cannot be read.
    """
    from PIL import Image, ImageDraw

    panels = draw_panels(walk, row, anchors, width)
    gap = max(width // 60, 2)
    size = len(panels) * (width + gap) - gap, max(panel.height for panel in panels)
    strip = Image.new("RGB", size, _PAPER)
    for number, panel in enumerate(panels):
        strip.paste(panel, (number * (width + gap), 0))
    elapsed_s = walk.timestamp_s[row] - walk.timestamp_s[0]
    corner = 0.025 * width, 0.025 * width
    brush = ImageDraw.Draw(strip, "RGBA")
    draw_chip(brush, [f"{elapsed_s:.1f} s"], corner, width, from_top=True)
    return strip


def draw_titled(walk: OverlayWalk, strips: list[Image], width: int) -> Image:
    """Put rows of panels below each other, under the names of the columns.

    Args:
        walk: The walk.
        strips: Of `draw_row`.
        width: Of a panel, pixels.
    """
    from PIL import Image, ImageDraw

    gap, margin, size = max(width // 60, 2), max(width // 24, 6), max(round(width / 24), 12)
    head, foot = margin + 2 * size, margin + (2 * size if TRUTH in walk.poses else 0)
    tall = sum(strip.height + gap for strip in strips) - gap
    wide = strips[0].width + 2 * margin
    sheet = Image.new("RGB", (wide + wide % 2, (even := head + tall + foot) + even % 2), _PAPER)
    brush = ImageDraw.Draw(sheet)
    for number, estimate in enumerate(walk.poses):
        place = margin + number * (width + gap), head - size
        brush.text(place, _TITLES[estimate], font=font(size, bold=True), anchor="lm", fill=_INK)
    top = head
    for strip in strips:
        sheet.paste(strip, (margin, top))
        top += strip.height + gap
    if TRUTH in walk.poses:
        text = "white outline: where content belongs"
        place = margin, top - gap + size + margin / 4
        brush.text(place, text, font=font(round(0.85 * size)), anchor="lm", fill=_FAINT)
    return sheet
