"""Pages that need no other file: their data, and the templates that make HTML of it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

_ENVIRONMENT = Environment(
    loader=PackageLoader("vioapr.report"),
    autoescape=True,
    undefined=StrictUndefined,  # what a template misses is a bug, not an empty place
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, kw_only=True)
class Page:
    """What every page has; each template adds its own.

    Attributes:
        title: The heading.
        contents: Anchors of the sections, and what to call them.
    """

    title: str
    contents: Sequence[tuple[str, str]]


class Cell(NamedTuple):
    """A cell of a table that is more than plain text.

    Attributes:
        parts: Texts between slashes, each with whether it is bold.
        color: Of a dot in front, in CSS, or None.
        link: Where it leads, or None.
    """

    parts: tuple[tuple[str, bool], ...]
    color: str | None = None
    link: str | None = None


class Heading(NamedTuple):
    """A column's heading, or that of several."""

    text: str | Cell
    span: int = 1


@dataclass(frozen=True)
class Table:
    """A table that scrolls sideways where it is wider than the page.

    Attributes:
        heads: Rows of headings.
        rows: Cells.
        text_columns: This many columns from the left are text, the others figures.
        starts: Columns that begin with a line.
    """

    heads: Sequence[Sequence[Heading]]
    rows: Sequence[Sequence[str | Cell]]
    text_columns: int
    starts: Sequence[int] = ()


class Figure(NamedTuple):
    """A picture in the page itself, with links to its files.

    Attributes:
        source: The picture as a data URL.
        name: What it shows, in a few words.
        caption: What it shows, at length.
        png: The file, relative to the page.
        svg: The file, relative to the page.
    """

    source: str
    name: str
    caption: str
    png: str
    svg: str


def embed_figure(png: Path, svg: Path, name: str, caption: str) -> Figure:
    """Read a figure's files and embed the smaller one.

    Args:
        png: In the folder `figures` beside the page.
        svg: In the same folder.
        name: What it shows, in a few words.
        caption: What it shows, at length.
    """
    kind_of = {png.read_bytes(): "png", svg.read_bytes(): "svg+xml"}
    content = min(kind_of, key=len)
    data = base64.b64encode(content).decode("ascii")
    source = f"data:image/{kind_of[content]};base64,{data}"
    return Figure(source, name, caption, f"figures/{png.name}", f"figures/{svg.name}")


def render_page(template: str, page: Page) -> str:
    """Make HTML of a page's data; all texts are escaped.

    Args:
        template: Name of a file in `templates/`, which says what it needs of the page.
        page: Its data, as the variable `page`.
    """
    return _ENVIRONMENT.get_template(template).render(page=page)
