"""A reproduction's outcome as tables of text, Markdown and JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vioapr.files.text import write_text
from vioapr.recipes.comparison import ALL_FRAMES, Comparison, Figures, Kind, Line
from vioapr.recipes.recipes import MODELS
from vioapr.recipes.references import ReferenceLine
from vioapr.report.formatting import UNKNOWN

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
    """What came out.

    Attributes:
        title: The data set's.
        differences: In what the trainings are not as published.
        notes: What else one must know to read the tables.
        tables: For people.
        content: For programs.
    """

    title: str
    differences: tuple[str, ...]
    notes: tuple[str, ...]
    tables: tuple[TextTable, ...]
    content: dict[str, Any]

    @property
    def warning(self) -> str:
        """The heading of `differences`."""
        return "NOT as published: these settings differ, and so may the figures"


def comparison_table(comparison: Comparison) -> TextTable:
    """One of the paper's tables for one regressor."""
    name, kind = MODELS[comparison.model], comparison.kind
    what = "median m / deg" if kind == "median" else "% within high/medium/low accuracy"
    is_printed = ("paper",) if kind == "levels" else ()
    header = (
        "frames", "scene", name, "paper", "difference", f"{name}^vio", "paper", "difference",
        "share %", *is_printed, "raw, same",
    )  # fmt: skip
    sections: dict[str, list[tuple[str, ...]]] = {}
    for line in comparison.lines:
        label = f"all: {line.method}" if line.subset == ALL_FRAMES else _LABELS[line.subset]
        rows = sections.setdefault(label, [])
        rows.append(("" if rows else label, *_cells(line, kind)))
    title = f"Table {comparison.number}, {comparison.place} scenes, {name}: {what}"
    return TextTable(title, header, tuple(map(tuple, sections.values())))


def _cells(line: Line, kind: Kind) -> list[str]:
    raw, fused = (
        [format_figures(pair.ours, kind), format_figures(pair.paper, kind),
         format_figures(pair.difference, kind, "+")]
        for pair in (line.raw, line.fused)
    )  # fmt: skip
    share = [format_figures(line.share.ours, "levels")]
    if kind == "levels":
        share.append(format_figures(line.share.paper, "levels"))
    return [line.scene, *raw, *fused, *share, format_figures(line.raw_same, kind)]


def reference_table(title: str, lines: Sequence[ReferenceLine], models: Sequence[str]) -> TextTable:
    """Raw medians beside published ones."""
    columns = [col for m in models for col in (MODELS[m], "published", "difference")]
    rows = []
    for line in lines:
        cells = [line.scene]
        for pair in line.medians.values():
            cells += [format_figures(pair.ours, "median", digits=3),
                      format_figures(pair.paper, "median", digits=3),
                      format_figures(pair.difference, "median", "+", digits=3)]  # fmt: skip
        rows.append((*cells, format_figures(line.dfnet, "median", digits=3)))
    header = ("scene", *columns, "DFNet, published")
    return TextTable(f"{title}, all test frames: median m / deg", header, (tuple(rows),))


def format_figures(figures: Figures | None, kind: Kind, sign: str = "", *, digits: int = 2) -> str:
    """Medians as "1.11 / 3.61", percentages as "3.2/18.4/87.0".

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


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """As plain values."""
    lines = []
    for line in comparison.lines:
        content = asdict(line)
        for name in ("raw", "fused", "share"):
            content[name] = getattr(line, name)._asdict()
        lines.append(content)
    return {
        "number": comparison.number,
        "place": comparison.place,
        "kind": comparison.kind,
        "model": comparison.model,
        "lines": lines,
    }


def reference_json(line: ReferenceLine) -> dict[str, Any]:
    """As plain values."""
    medians = {
        model: {"ours": pair.ours, "published": pair.paper} for model, pair in line.medians.items()
    }
    return {"scene": line.scene, "medians": medians, "dfnet": line.dfnet}


def markdown(report: Report) -> str:
    """The whole report."""
    parts = [f"# {report.title}, reproduced"]
    if report.differences:
        listed = "\n".join(f"> - {text}" for text in report.differences)
        parts.append(f"> **{report.warning}**\n>\n{listed}")
    if report.notes:
        parts.append("\n".join(f"- {text}" for text in report.notes))
    for table in report.tables:
        rows = [table.header, ("---",) * len(table.header)]
        rows += [row for section in table.sections for row in section]
        parts.append(f"## {table.title}\n\n" + "\n".join(f"| {' | '.join(r)} |" for r in rows))
    return "\n\n".join(parts) + "\n"


def write_report(report: Report, folder: Path) -> tuple[Path, Path]:
    """Write Markdown and JSON; returns where they are.

    Raises:
        FormatError: They cannot be written.
    """
    paths = folder / MARKDOWN_FILE, folder / JSON_FILE
    write_text(paths[0], markdown(report))
    content = {"title": report.title, "differences": report.differences, "notes": report.notes}
    write_text(paths[1], json.dumps(content | report.content, indent=1) + "\n")
    return paths
