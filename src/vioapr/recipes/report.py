"""The results of a reproduction as tables of text, Markdown and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vioapr.files.text import write_text
from vioapr.recipes.comparison import ALL_FRAMES
from vioapr.recipes.paper import MODELS
from vioapr.report.formatting import UNKNOWN
from vioapr.schemas.base import encode
from vioapr.schemas.reproduction import (
    Comparison,
    Figures,
    Kind,
    Pair,
    ReferenceLine,
    Reproduction,
)

_LABELS = {
    "only keyframes": "keyframes",
    "only optimized": "optimized",
    "keyframes + optimized": "both",
}
MARKDOWN_FILE, JSON_FILE = "reproduction.md", "reproduction.json"


@dataclass(frozen=True)
class TextTable:
    """A table to print.

    Attributes:
        title: Above it.
        header: Of the columns.
        sections: Rows, in sections between which a line is drawn.
    """

    title: str
    header: tuple[str, ...]
    sections: tuple[tuple[tuple[str, ...], ...], ...]


@dataclass(frozen=True)
class Report:
    """The results, for programs and for people.

    Attributes:
        content: For programs.
        tables: For people.
    """

    content: Reproduction
    tables: tuple[TextTable, ...]

    @property
    def warning(self) -> str:
        """The heading of the differences from the publication."""
        return "NOT as published: these settings differ, and so may the figures"


def comparison_table(comparison: Comparison) -> TextTable:
    """Lay out one of the paper's tables for one regressor."""
    name, kind = MODELS[comparison.model], comparison.kind
    unit = "median m / deg" if kind == "median" else "% within high/medium/low accuracy"
    is_printed = ("paper",) if kind == "levels" else ()
    header = (
        "frames", "scene", name, "paper", "difference", f"{name}^vio", "paper", "difference",
        "share %", *is_printed, "raw, same",
    )  # fmt: skip
    sections: dict[str, list[tuple[str, ...]]] = {}
    for line in comparison.lines:
        label = f"all: {line.method}" if line.subset == ALL_FRAMES else _LABELS[line.subset]
        rows = sections.setdefault(label, [])
        cells = ["" if rows else label, line.scene]
        for pair in (line.raw, line.fused):
            cells += format_pair(pair, kind)
        cells.append(format_figures(line.share.ours, "levels"))
        if kind == "levels":
            cells.append(format_figures(line.share.paper, "levels"))
        rows.append((*cells, format_figures(line.raw_same, kind)))
    title = f"Table {comparison.number}, {comparison.place} scenes, {name}: {unit}"
    return TextTable(title, header, tuple(map(tuple, sections.values())))


def reference_table(title: str, lines: Sequence[ReferenceLine], models: Sequence[str]) -> TextTable:
    """Lay out raw medians beside published ones."""
    columns = [col for m in models for col in (MODELS[m], "published", "difference")]
    rows = []
    for line in lines:
        cells = [line.scene]
        for pair in line.medians.values():
            cells += format_pair(pair, "median", digits=3)
        rows.append((*cells, format_figures(line.dfnet, "median", digits=3)))
    header = ("scene", *columns, "DFNet, published")
    return TextTable(f"{title}, all test frames: median m / deg", header, (tuple(rows),))


def format_pair(pair: Pair, kind: Kind, *, digits: int = 2) -> list[str]:
    """Format ours, theirs and the difference; see `format_figures`."""
    return [
        format_figures(pair.ours, kind, digits=digits),
        format_figures(pair.paper, kind, digits=digits),
        format_figures(pair.difference, kind, "+", digits=digits),
    ]


def format_figures(figures: Figures | None, kind: Kind, sign: str = "", *, digits: int = 2) -> str:
    """Format medians as "1.11 / 3.61", percentages as "3.2/18.4/87.0".

    Args:
        figures: Or None, which is a dash.
        kind: Of the figures.
        sign: "+" to show it, for differences.
        digits: Of positions, after the point.
    """
    if figures is None:
        return UNKNOWN
    if kind == "median":
        position_m, orientation_deg = figures
        return f"{position_m:{sign}.{digits}f} / {orientation_deg:{sign}.2f}"
    return "/".join(f"{value:{sign}.1f}" for value in figures)


def markdown(report: Report) -> str:
    """Write the whole report as Markdown."""
    content = report.content
    parts = [f"# {content.title}, reproduced"]
    if content.differences:
        listed = "\n".join(f"> - {text}" for text in content.differences)
        parts.append(f"> **{report.warning}**\n>\n{listed}")
    if content.notes:
        parts.append("\n".join(f"- {text}" for text in content.notes))
    for table in report.tables:
        rows = [table.header, ("---",) * len(table.header)]
        rows += [row for section in table.sections for row in section]
        parts.append(f"## {table.title}\n\n" + "\n".join(f"| {' | '.join(r)} |" for r in rows))
    return "\n\n".join(parts) + "\n"


def write_report(report: Report, folder: Path) -> tuple[Path, Path]:
    """Write Markdown and JSON; returns where they are.

    Raises:
        UnwritableError: They cannot be written.
    """
    paths = folder / MARKDOWN_FILE, folder / JSON_FILE
    write_text(paths[0], markdown(report))
    write_text(paths[1], encode(report.content, indent=1))
    return paths
