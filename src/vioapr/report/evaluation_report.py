"""The report of an evaluation: tables, figures and how to read them, on one page."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from vioapr._version import __version__
from vioapr.errors import AlreadyExistsError
from vioapr.evaluation.metrics import PRECISION_LEVELS, Summary, summarize
from vioapr.evaluation.tables import Group
from vioapr.files.text import write_text
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import View
from vioapr.fusion.types import Status
from vioapr.plurals import count_of
from vioapr.report.figures import FIGURES, count_figure_ticks, save_figures
from vioapr.report.formatting import (
    RELIABILITY_HEADERS,
    UNKNOWN,
    format_levels,
    format_median,
    format_number,
    format_p95,
    format_reliability,
    format_share,
    format_walks,
)
from vioapr.report.page import Cell, Figure, Heading, Page, Table, embed_figure, render_page
from vioapr.report.style import method_colors

_STATUS_KEY = {
    Status.KEYFRAME: "the regressor's prediction, which odometry confirms",
    Status.OPTIMIZED: "the prediction was replaced by a pose that the method computed",
    Status.TRACKED: "carried by odometry from the last reference",
    Status.PREDICTED: "the prediction, unchecked (method apr)",
    Status.UNLOCALIZED: "no pose: nothing is known, tracking is lost, or not here",
}
_VIEW_KEY = {
    "retrospective": "retrospective: predictions that later proved right count as keyframes",
    "live": "live: what was known when each frame arrived",
}
_COMPARED = (
    ("median, m / °", format_median, operator.lt),
    ("95th percentile, m / °", format_p95, operator.lt),
    ("high / medium / low, %", format_levels, operator.gt),
)
"""Pairs of columns: title, format, and which of two numbers is better."""


@dataclass(frozen=True)
class Section:
    """A group's part of the page.

    Attributes:
        anchor: Its name for links.
        title: Of the group.
        walks: How many there are, in words.
        raw_median: The raw regressor's, over all predictions.
        table: A row a method and subset of the frames.
        reliability: A row a method: content jumps, and whether sigmas can be believed.
        figures: Drift, trajectories, distributions and, where sigmas are stated, risk.
        all_walks: A row a walk and method.
    """

    anchor: str
    title: str
    walks: str
    raw_median: str
    table: Table
    reliability: Table
    figures: Sequence[Figure]
    all_walks: Table


@dataclass(frozen=True, kw_only=True)
class EvaluationPage(Page):
    """The data of `evaluation.html`.

    Attributes:
        facts: What was run: names and texts.
        methods: What each does, and its parameters.
        command: The command that made the page, or "".
        levels: The precision levels, in words.
        statuses: Where a pose comes from: labels and texts.
        overview: A row a group.
        sections: A section a group.
    """

    facts: Sequence[tuple[str, str]]
    methods: Table
    command: str
    levels: str
    statuses: Sequence[tuple[str, str]]
    overview: Table
    sections: Sequence[Section]


REPORT_PATTERNS = ("index.html", *(f"figures/*_{kind}.*" for kind in FIGURES))
"""Of the paths that `write_report` writes in its folder."""


def count_report_ticks(groups: Sequence[Group]) -> int:
    """How often `write_report` calls its tick."""
    return count_figure_ticks(groups)


def write_report(
    groups: Sequence[Group],
    folder: Path,
    *,
    title: str,
    command: str | None = None,
    params_of_method: Mapping[str, Any] | None = None,
    view: View | None = None,
    date: str | None = None,
    tick: Callable[[], object] | None = None,
) -> Path:
    """Write `index.html`, with everything inside, and the figures as files beside it.

    Args:
        groups: From `group_results`.
        folder: Made if needed; files of an earlier report are replaced.
        title: The page's heading.
        command: The command that made it, to be shown.
        params_of_method: The methods' parameters, as `evaluate_cases` got them.
        view: As `evaluate_cases` got it.
        date: When it was made; without it, equal inputs make equal pages.
        tick: Called as often as `count_report_ticks` says, for progress.

    Returns:
        The page's path.

    Raises:
        AlreadyExistsError: The folder is a file, or the page a folder.
        UnwritableError: A file cannot be written.
    """
    path = folder / "index.html"
    if folder.exists() and not folder.is_dir():
        raise AlreadyExistsError(folder, "expected a folder to write the report to, got a file")
    if path.is_dir():
        raise AlreadyExistsError(path, "expected to write a file, got a folder of this name")
    figures = save_figures(groups, folder, tick)
    sections = [
        Section(
            anchor=f"group-{number}",
            title=group.title,
            walks=format_walks(group),
            raw_median=format_median(group.raw),
            table=make_group_table(group),
            reliability=make_reliability_table(group),
            figures=[
                embed_figure(one.png, one.svg, f"{one.kind}: {group.title}", one.caption)
                for one in figures
                if one.group is group
            ],
            all_walks=make_walks_table(group),
        )
        for number, group in enumerate(groups, 1)
    ]
    page = EvaluationPage(
        title=title,
        contents=[
            ("run", "What was run"),
            ("key", "How to read it"),
            ("overview", "Overview"),
            *((section.anchor, section.title) for section in sections),
        ],
        facts=list_facts(groups, view, date),
        methods=make_methods_table(groups, params_of_method or {}),
        command=command or "",
        levels="; ".join(
            f"{name}: within {limit_m:g} m and {limit_deg:g}°"
            for name, (limit_m, limit_deg) in PRECISION_LEVELS.items()
        ),
        statuses=[(status.label, text) for status, text in _STATUS_KEY.items()],
        overview=make_overview(groups),
        sections=sections,
    )
    write_text(path, render_page("evaluation.html", page))
    return path


def list_facts(
    groups: Sequence[Group], view: str | None, date: str | None
) -> list[tuple[str, str]]:
    """List what was run: counts of walks and frames, view, version and date."""
    results = [result for group in groups for result in group.results]
    frames_of_case = {id(result.case): len(result.status) for result in results}
    walks = {(result.case.set_name, result.case.walk) for result in results}
    runs = len(frames_of_case)
    facts = [
        ("Walks", f"{len(walks)}, fused {count_of(runs, 'time')} (odometries and regressors)"),
        ("Frames", f"{sum(frames_of_case.values())} with ground truth, in all of these"),
    ]
    if view:
        facts.append(("View", _VIEW_KEY.get(view, view)))
    facts.append(("vioapr", __version__))
    if date:
        facts.append(("Date", date))
    return facts


def make_methods_table(groups: Sequence[Group], params_of_method: Mapping[str, Any]) -> Table:
    """Make a table of what each method does and of its parameters."""
    rows = []
    for name in _methods(groups):
        params, described = params_of_method.get(name), UNKNOWN
        if params is not None and is_dataclass(params):
            values = (f"{field.name} = {getattr(params, field.name)}" for field in fields(params))
            described = ", ".join(values) or "none"
        summary = METHODS[name].summary if name in METHODS else UNKNOWN
        rows.append([_method_cell(name, groups), summary, described])
    heads = [[Heading(text) for text in ("method", "what it does", "parameters")]]
    return Table(heads, rows, text_columns=3)


def make_overview(groups: Sequence[Group]) -> Table:
    """Make a row a group: the raw regressor, then every method over all frames with a pose."""
    methods = [name for name in _methods(groups) if name != "apr"]
    names = [Heading(""), Heading(""), Heading("raw, all predictions", 2)]
    names += [Heading(_method_cell(name, groups), 3) for name in methods]
    head = ["set, odometry, regressor", "runs", "median", "p95"]
    head += ["median", "p95", "share"] * len(methods)
    rows = []
    for number, group in enumerate(groups, 1):
        cells: list[str | Cell] = [Cell(((group.title, False),), link=f"#group-{number}")]
        cells += [str(group.cases), format_median(group.raw), format_p95(group.raw)]
        over_all = {row.method: row for row in group.rows if row.subset == "all frames"}
        for name in methods:
            if name in over_all:
                row = over_all[name]
                median, _, p95, *_ = compare_summaries(row.fused, row.raw)
                cells += [median, p95, format_share(row.fused)]
            else:
                cells += [UNKNOWN] * 3
        rows.append(cells)
    starts = [2, *(4 + 3 * index for index in range(len(methods)))]
    return Table([names, [Heading(text) for text in head]], rows, text_columns=1, starts=starts)


def make_group_table(group: Group) -> Table:
    """Make the paper's Tables 2-5: a row a method and subset of the frames."""
    rows: list[list[str | Cell]] = [
        [
            _method_cell(row.method, [group]),
            row.subset,
            str(row.walks),
            format_share(row.fused),
            *compare_summaries(row.fused, row.raw),
        ]
        for row in group.rows
    ]
    return _compared_table(["method", "frames", "runs", "share"], rows, text_columns=2)


def make_reliability_table(group: Group) -> Table:
    """Make a row a method: content jumps, and errors of the frames that it is surest of."""
    rows: list[list[str | Cell]] = [
        [_method_cell(row.method, [group]), str(row.walks), *format_reliability(row.figures)]
        for row in group.reliability
    ]
    heads = [[Heading(text) for text in ("method", "runs", *RELIABILITY_HEADERS)]]
    return Table(heads, rows, text_columns=1, starts=[2, 4])


def make_walks_table(group: Group) -> Table:
    """Make a row a walk, odometry and method, over all frames that have a pose."""
    cases = list(dict.fromkeys(id(result.case) for result in group.results))
    rows = []
    for result in sorted(group.results, key=lambda result: cases.index(id(result.case))):
        has_pose = ~result.has_status(Status.UNLOCALIZED)
        fused = summarize(result.errors, has_pose)
        count = len(result.status)
        cells: list[str | Cell] = [result.case.walk, result.case.vio]
        cells += [_method_cell(result.method, [group]), str(count), format_share(fused)]
        cells += compare_summaries(fused, summarize(result.raw_errors, has_pose))
        for status in _STATUS_KEY:
            share = result.has_status(status).sum() / count if count else float("nan")
            cells.append(format_number(100 * share, 1))
        rows.append(cells)
    head = ["walk", "VIO", "method", "frames", "share"]
    labels = [status.label for status in _STATUS_KEY]
    return _compared_table(head, rows, text_columns=3, statuses=labels)


def compare_summaries(fused: Summary, raw: Summary) -> list[Cell]:
    """Make cells of a method and of raw in turns, each number bold where it is the better one.

    Numbers are compared as printed: what looks equal is not called better.
    """
    cells = []
    for _, text_of, is_better in _COMPARED:
        own, other = text_of(fused).split("/"), text_of(raw).split("/")
        is_known = len(own) == len(other) and UNKNOWN not in map(str.strip, own + other)
        for ours, theirs in ((own, other), (other, own)):
            if is_known:
                pairs = zip(ours, theirs, strict=True)
                cells.append(Cell(tuple((a, is_better(float(a), float(b))) for a, b in pairs)))
            else:
                cells.append(Cell(tuple((part, False) for part in ours)))
    return cells


def _compared_table(
    head: list[str],
    rows: list[list[str | Cell]],
    *,
    text_columns: int,
    statuses: Sequence[str] = (),
) -> Table:
    """A table whose columns come in pairs of method and raw, under a heading each.

    Shares of the frames by status may follow them.
    """
    names = [Heading("") for _ in head] + [Heading(title, 2) for title, _, _ in _COMPARED]
    starts = [len(head) + 2 * index for index in range(len(_COMPARED))]
    if statuses:
        names.append(Heading("share by status, %", len(statuses)))
        starts.append(len(head) + 2 * len(_COMPARED))
    columns = [*head, *["method", "raw"] * len(_COMPARED), *statuses]
    heads = [names, [Heading(text) for text in columns]]
    return Table(heads, rows, text_columns=text_columns, starts=starts)


def _methods(groups: Sequence[Group]) -> list[str]:
    return list(dict.fromkeys(result.method for group in groups for result in group.results))


def _method_cell(method: str, groups: Sequence[Group]) -> Cell:
    """A method's name after a dot of its colour in the figures."""
    color = method_colors(["apr", *_methods(groups)])[method]
    return Cell(((method, False),), color=color)
