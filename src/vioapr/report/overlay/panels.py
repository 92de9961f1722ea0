"""A picture with content drawn by one estimate of the pose, labelled with how far off it is."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from vioapr.files.images import read_rgb
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3
from vioapr.report.overlay.canvas import Canvas, Layer, Pinhole
from vioapr.report.overlay.content import displacement_m, pose_error
from vioapr.report.overlay.marker import draw_marker, draw_shadow, pose_of
from vioapr.report.overlay.walk import TRUTH, OverlayWalk
from vioapr.schemas.anchors import Anchor

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

_COLORS = ("#d9377a", "#2f7fd6", "#e79a1c", "#2f9e63", "#7a55c7")
"""Of content, in its order; estimates have no colours, as content looks alike in all."""
_DIMMED = 0.45
"""Brightness of a picture without a pose."""
_TEXT_COLOR, _CHIP_COLOR = "#ffffff", (16, 18, 22, 190)
_CM_UP_TO_M = 10.0


def draw_panels(
    walk: OverlayWalk, row: int, anchors: tuple[Anchor, ...], width: int
) -> list[Image]:
    """Draw a frame's picture with content by every estimate, upright.

    Where there is a truth, a white outline shows where content belongs.

    Args:
        walk: The walk.
        row: The frame.
        anchors: The content.
        width: Of a panel, pixels.

    Raises:
        FileError: The picture cannot be read.
    """
    camera = walk.cameras[row]
    is_lying = walk.quarter_turns % 2 == 1
    camera = camera.resized(round(width * camera.width / camera.height) if is_lying else width)
    picture = read_rgb(walk.images[row], (camera.width, camera.height))
    poses = {name: one.at(row) for name, one in walk.poses.items()}
    layers = {
        name: draw_content(camera, pose, anchors) for name, pose in poses.items() if pose.is_known
    }
    panels: list[Image] = []
    for name, pose in poses.items():
        drawn = layers[name].over(picture) if name in layers else _dimmed(picture)
        if name != TRUTH and TRUTH in layers:
            drawn = _outline(drawn, layers[TRUTH], width)
        truth = poses[TRUTH] if TRUTH in layers else None
        panel = _turned(drawn, walk.quarter_turns)
        _write_on(panel, name, Sight(camera, walk.quarter_turns, pose, truth), anchors)
        panels.append(panel)
    return panels


class Sight(NamedTuple):
    """How a panel is seen.

    Attributes:
        camera: Of the picture at the panel's size, before it is turned.
        quarter_turns: By how many it is turned, counterclockwise.
        pose: world_from_cam that content is drawn by; NaN if not known.
        truth: world_from_cam, or None.
    """

    camera: Pinhole
    quarter_turns: int
    pose: Rigid3[FloatArray]
    truth: Rigid3[FloatArray] | None


def _dimmed(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return (picture * _DIMMED).astype(np.uint8)


def _turned(picture: NDArray[np.uint8], quarter_turns: int) -> Image:
    from PIL import Image

    return Image.fromarray(np.ascontiguousarray(np.rot90(picture, quarter_turns)))


def _write_on(panel: Image, name: str, sight: Sight, anchors: tuple[Anchor, ...]) -> None:
    """Write labels of content on a panel, and how far off it is."""
    from PIL import ImageDraw

    brush = ImageDraw.Draw(panel, "RGBA")
    if sight.pose.is_known:
        _label_content(brush, sight, anchors, panel.width)
    main = _main_of(sight, anchors)
    if name != TRUTH and (text := describe(sight.pose, sight.truth, main)):
        edge = 0.025 * panel.width
        draw_chip(brush, text, (edge, panel.height - edge), panel.width, from_top=False)


def content_colors() -> list[NDArray[np.float64]]:
    """The colours of content in its order, RGB, 0 to 1; further content begins again."""
    from PIL.ImageColor import getrgb

    return [np.array(getrgb(color)[:3]) / 255 for color in _COLORS]


def draw_content(
    camera: Pinhole, world_from_cam: Rigid3[FloatArray], anchors: tuple[Anchor, ...]
) -> Layer:
    """Draw all content as a camera sees it: what is nearer hides what is behind."""
    colors = content_colors()
    canvas, cam_from_world = Canvas(camera), world_from_cam.inverse()
    for number, anchor in enumerate(anchors):
        draw_marker(canvas, cam_from_world, anchor, colors[number % len(colors)])
    for anchor in anchors:
        draw_shadow(canvas, cam_from_world, anchor)
    return canvas.finish()


def describe(
    pose: Rigid3[FloatArray], truth: Rigid3[FloatArray] | None, anchor: Anchor | None
) -> list[str]:
    """Say how far off content and camera are, a line each.

    Args:
        pose: world_from_cam that content is drawn by.
        truth: The camera's, or None.
        anchor: The content in view, or None.
    """
    if not pose.is_known:
        return ["no pose"]
    if truth is None:
        return []
    error = pose_error(pose, truth)
    camera = f"camera {format_length(error.position_m)}, {error.orientation_deg:.1f}°"
    if anchor is None:
        return [camera]
    off = format_length(displacement_m(pose, truth, anchor))
    return [f"{anchor.label or 'content'}: {off} off", camera]


def format_length(length_m: float) -> str:
    """A length in centimetres, in metres where it is long."""
    return f"{length_m:.1f} m" if length_m >= _CM_UP_TO_M else f"{100 * length_m:.0f} cm"


def _main_of(sight: Sight, anchors: tuple[Anchor, ...]) -> Anchor | None:
    """The largest content in the picture, by the truth."""
    best, largest = None, 0.0
    for anchor in anchors if sight.truth is not None else ():
        assert sight.truth is not None  # else there is none to look at
        middle_m = pose_of(anchor).apply(np.array([0.0, 0.0, anchor.size_m / 2]))
        inside = sight.truth.inverse().apply(middle_m)
        if sight.camera.sees(inside) and anchor.size_m / inside[2] > largest:
            best, largest = anchor, anchor.size_m / float(inside[2])
    return best


def _outline(picture: NDArray[np.uint8], layer: Layer, width: int) -> NDArray[np.uint8]:
    """Draw the edge of what a layer covers: white, with a dark seam that keeps it visible."""
    covered = layer.covered > 0.5
    thickness = max(width // 300, 1)
    line = np.logical_and(binary_dilation(covered, iterations=thickness), ~covered)
    seam = np.logical_and(binary_dilation(line, iterations=1), ~line)
    outlined = picture.copy()
    outlined[seam] = (outlined[seam] * 0.55).astype(np.uint8)
    outlined[line] = 255
    return outlined


def _label_content(brush: ImageDraw, sight: Sight, anchors: tuple[Anchor, ...], width: int) -> None:
    """Write labels above content that is in the picture, the farthest first."""
    inside = [
        sight.pose.inverse().apply(pose_of(one).apply(np.array([0, 0, 1.06 * one.size_m])))
        for one in anchors
    ]
    for top_m, anchor in sorted(zip(inside, anchors, strict=True), key=lambda one: -one[0][2]):
        if anchor.label and sight.camera.sees(top_m):
            u, v = sight.camera.project(top_m)
            place = _turned_place(u, v, sight.camera, sight.quarter_turns)
            brush.text(
                place, anchor.label, font=font(_text_size(width), bold=True), anchor="mb",
                fill=_TEXT_COLOR, stroke_width=max(width // 200, 1), stroke_fill="#101216",
            )  # fmt: skip


def _turned_place(u: float, v: float, camera: Pinhole, quarter_turns: int) -> tuple[float, float]:
    """Where a pixel is after turning the picture counterclockwise."""
    for size in (camera.width, camera.height, camera.width)[:quarter_turns]:
        u, v = v, size - u
    return u, v


def draw_chip(
    brush: ImageDraw, lines: list[str], corner: tuple[float, float], width: int, *, from_top: bool
) -> None:
    """Write lines on a dark rounded ground: the first one bold.

    Args:
        brush: Pillow's, in mode RGBA.
        lines: At least one.
        corner: The left top corner, or the left bottom one.
        width: Of the panel, pixels: it decides how large the text is.
        from_top: Which corner it is.
    """
    size = _text_size(width)
    fonts = [font(size, bold=number == 0) for number in range(len(lines))]
    step, padding = 1.35 * size, 0.5 * size
    wide = max(one.getlength(line) for one, line in zip(fonts, lines, strict=True)) + 2 * padding
    tall = step * len(lines) + padding
    left, top = corner[0], corner[1] - (0 if from_top else tall)
    brush.rounded_rectangle((left, top, left + wide, top + tall), 0.45 * size, fill=_CHIP_COLOR)
    for number, (one, line) in enumerate(zip(fonts, lines, strict=True)):
        middle = top + padding / 2 + (number + 0.5) * step
        brush.text((left + padding, middle), line, font=one, anchor="lm", fill=_TEXT_COLOR)


def _text_size(width: int) -> int:
    return max(round(0.036 * width), 11)


@cache
def font(size: int, *, bold: bool = False) -> FreeTypeFont:
    """The figures' font, which comes with Matplotlib."""
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path(), "fonts", "ttf", name), size)
