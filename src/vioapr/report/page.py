"""Parts of a page that needs no other file: the frame, tables and figures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from vioapr.report.style import CSS


def make_page(title: str, links: Iterable[tuple[str, str]], sections: Iterable[str]) -> str:
    """A whole page.

    Args:
        title: Its heading.
        links: For the contents: anchors and what to call them.
        sections: HTML, in which the anchors are.
    """
    contents = "\n".join(f'<li><a href="#{name}">{escape(text)}</a></li>' for name, text in links)
    body = "\n".join(sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{CSS}</style>
</head>
<body>
<div class="layout">
<nav aria-label="Contents"><ol>
{contents}
</ol></nav>
<main>
<h1>{escape(title)}</h1>
{body}
</main>
</div>
</body>
</html>
"""


def make_table(
    heads: list[list[str]],
    rows: list[list[str]],
    *,
    text_columns: int,
    spans: list[int] | None = None,
    starts: Iterable[int] = (),
) -> str:
    """A table that scrolls sideways where it is wider than the page.

    Args:
        heads: Rows of headings; all but the last span columns as `spans` says.
        rows: Cells, already escaped.
        text_columns: So many columns from the left are text, the others figures.
        spans: Columns that each heading of the rows above the last spans.
        starts: Columns that begin with a line.
    """
    lines = set(starts)

    def cell(tag: str, content: str, column: int, span: int = 1) -> str:
        names = ["text"] * (column < text_columns) + ["left"] * (column in lines)
        style = f' class="{" ".join(names)}"' if names else ""
        wide = f' colspan="{span}"' if span > 1 else ""
        return f"<{tag}{style}{wide}>{content}</{tag}>"

    def line(tag: str, cells: list[str], widths: Sequence[int]) -> str:
        columns = [sum(widths[:index]) for index in range(len(cells))]
        parts = (cell(tag, *each) for each in zip(cells, columns, widths, strict=True))
        return f"<tr>{''.join(parts)}</tr>"

    ones = [1] * len(heads[-1])
    head = "".join(line("th", h, ones if h is heads[-1] else spans or ones) for h in heads)
    body = "\n".join(line("td", row, ones) for row in rows)
    return (
        f'<div class="scroll" tabindex="0"><table><thead>{head}</thead>\n'
        f"<tbody>{body}</tbody></table></div>"
    )


def embed_figure(png: Path, svg: Path, name: str, caption: str) -> str:
    """A picture in the page itself, whichever file of the two is smaller.

    Args:
        png: The figure, in the folder `figures` beside the page.
        svg: Likewise.
        name: What it shows, in a few words.
        caption: What it shows, at length; not yet escaped.
    """
    content, kind = min(
        ((png.read_bytes(), "png"), (svg.read_bytes(), "svg+xml")),
        key=lambda each: len(each[0]),
    )
    data = base64.b64encode(content).decode("ascii")
    image = f'<img src="data:image/{kind};base64,{data}" alt="{escape(name)}">'
    links = ", ".join(
        f'<a href="figures/{path.name}">{path.suffix[1:].upper()}</a>' for path in (png, svg)
    )
    return f"""<figure>
<div class="scroll" tabindex="0">{image}</div>
<figcaption>{escape(caption)} Files: {links}.</figcaption>
</figure>"""
