"""A look at a scene: pictures of every recording, and their routes from above."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vioapr.files.images import read_rgb
from vioapr.files.text import write_bytes
from vioapr.report.style import house_style, new_figure, spread
from vioapr.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = ("#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7", "#000000")
_COLUMNS = 6
_MOST = 8
"""Recordings of a split that are shown; more make a picture that nobody looks at."""
_DPI = 120


class Background(NamedTuple):
    """A picture of a place from above.

    Attributes:
        picture: An image file; its middle is the world's origin, up is y.
        width_m: Metres of ground from its left edge to its right.
    """

    picture: Path
    width_m: float


def contact_sheet(scene: Scene) -> Figure:
    """Pictures of up to 8 recordings of every split, a row each, evenly spread over its time."""
    ids = _shown(scene)
    with house_style():
        figure, axes = new_figure(
            2.05 * _COLUMNS, 1.68 * len(ids), rows=len(ids), cols=_COLUMNS, layout="constrained"
        )
        for row, id_ in enumerate(ids):
            recording = scene.recording(id_)
            count = len(recording.frames.timestamp_s)
            chosen = np.linspace(0, count - 1, _COLUMNS + 2).astype(int)[1:-1]
            weather = " · ".join(recording.info.notes[:1])
            for column, frame in enumerate(chosen):
                axis = axes[row * _COLUMNS + column]
                axis.imshow(read_rgb(recording.image_path(int(frame))))
                axis.set_axis_off()
            axes[row * _COLUMNS].set_title(f"{id_}   {weather}", loc="left", fontsize=9)
    return figure


def route_map(scene: Scene, background: Background | None = None) -> Figure:
    """Ground truth of the same recordings from above, x to the right and y up."""
    ids = _shown(scene)
    with house_style():
        figure, (axis,) = new_figure(9.0, 6.9)
        if background is not None:
            pixels = read_rgb(background.picture)
            half = background.width_m / 2 * np.array([1, pixels.shape[0] / pixels.shape[1]])
            axis.imshow(pixels, extent=(-half[0], half[0], -half[1], half[1]))
        for number, id_ in enumerate(ids):
            gt = scene.gt(id_)
            if gt is not None:
                style = "-" if id_ in scene.splits.get("train", ()) else (0, (3, 1.2))
                color = _COLORS[number % len(_COLORS)]
                axis.plot(*gt.position_m[:, :2].T, ls=style, color=color, lw=1.8, label=id_)
                axis.plot(*gt.position_m[0, :2], "o", color=color, mec="#222222", ms=6)
        axis.set(xlabel="x (m)", ylabel="y (m)")
        axis.grid(background is None)
        axis.set_aspect("equal")
        title = f"{len(ids)} of {len(scene.recording_ids)} recordings; dot: start; dashed: test"
        figure.legend(loc="outside upper center", ncols=8, title=title)
    return figure


def save_photo_figure(figure: Figure, path: Path) -> None:
    """Save a figure of photographs as PNG in all its colours.

    Raises:
        FormatError: It cannot be written.
    """
    content = io.BytesIO()
    with house_style():
        figure.savefig(content, format="png", dpi=_DPI, metadata={"Software": None})
    write_bytes(path, content.getvalue())


def _shown(scene: Scene) -> list[str]:
    """Some training recordings, some to test, then some of the others, evenly chosen."""
    train, test = (scene.splits.get(split, ()) for split in ("train", "test"))
    others = [id_ for id_ in scene.recording_ids if id_ not in (*train, *test)]
    return [ids[int(row)] for ids in (train, test, others) for row in spread(len(ids), _MOST)]
