"""The report: tables, figures and how to read them, on one page that needs no other file."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from pathlib import Path
from typing import Any

from vioapr._version import __version__
from vioapr.errors import FormatError
from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.metrics import PRECISION_LEVELS, Summary, summarize
from vioapr.evaluation.tables import Group, Row
from vioapr.files.text import write_text
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import View
from vioapr.fusion.types import Status
from vioapr.report.figures import FigureFiles, count_figure_ticks, save_figures
from vioapr.report.formatting import (
    UNKNOWN,
    format_levels,
    format_median,
    format_number,
    format_p95,
    format_share,
    format_walks,
)
from vioapr.report.page import embed_figure, make_page, make_table
from vioapr.report.style import method_colors

_STATUS_KEY = {
    Status.KEYFRAME: "the regressor's prediction, which odometry confirms",
    Status.OPTIMIZED: "the prediction was replaced by a pose that the method computed",
    Status.TRACKED: "carried by odometry from the last reference",
    Status.PREDICTED: "the prediction, unchecked (method apr)",
    Status.UNLOCALIZED: "no pose: nothing is known yet, or tracking is lost",
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
        view: Likewise.
        date: When it was made; without it, equal inputs make equal pages.
        tick: Called as often as `count_report_ticks` says, for progress.

    Returns:
        The page's path.

    Raises:
        FormatError: The folder is a file, or a file cannot be written.
    """
    page = folder / "index.html"
    if folder.exists() and not folder.is_dir():
        raise FormatError(folder, "expected a folder to write the report to, got a file")
    if page.is_dir():
        raise FormatError(page, "expected to write a file, got a folder of this name")
    figures = save_figures(groups, folder, tick)
    run = _run(groups, command, params_of_method or {}, view, date)
    sections = [
        _section(f"group-{number}", group, [f for f in figures if f.group is group])
        for number, group in enumerate(groups, 1)
    ]
    write_text(page, _page(title, groups, [run, _key(), _overview(groups), *sections]))
    return page


def _page(title: str, groups: Sequence[Group], sections: Iterable[str]) -> str:
    links = [("run", "What was run"), ("key", "How to read it"), ("overview", "Overview")]
    links += [(f"group-{number}", group.title) for number, group in enumerate(groups, 1)]
    return make_page(title, links, sections)


def _run(
    groups: Sequence[Group],
    command: str | None,
    params_of_method: Mapping[str, Any],
    view: str | None,
    date: str | None,
) -> str:
    """What was run: counts, methods with parameters, view, version and command."""
    results = [result for group in groups for result in group.results]
    cases = {id(result.case): len(result.status) for result in results}
    walks = {(r.case.set_name, r.case.walk) for r in results}
    entries = [
        ("Walks", f"{len(walks)}, fused {len(cases)} times (odometries and regressors)"),
        ("Frames", f"{sum(cases.values())} with ground truth, in all of these"),
        *(("View", _VIEW_KEY.get(name, name)) for name in [view] if name),
        ("vioapr", __version__),
        *(("Date", text) for text in [date] if text),
    ]
    items = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in entries)
    rows = [
        [_method_name(name, groups), *(escape(t) for t in _describe(name, params_of_method))]
        for name in _methods(groups)
    ]
    methods = make_table([["method", "what it does", "parameters"]], rows, text_columns=3)
    shown = f"<h3>Command</h3><pre><code>{escape(command)}</code></pre>" if command else ""
    return f"""<h2 id="run">What was run</h2>
<dl>{items}</dl>
<div class="words">{methods}</div>
{shown}"""


def _describe(method: str, params_of_method: Mapping[str, Any]) -> tuple[str, str]:
    """A method in words, and its parameters."""
    summary = METHODS[method].summary if method in METHODS else UNKNOWN
    params = params_of_method.get(method)
    if params is None or not is_dataclass(params):
        return summary, UNKNOWN
    values = [f"{field.name} = {getattr(params, field.name)}" for field in fields(params)]
    return summary, ", ".join(values) or "none"


def _key() -> str:
    statuses = "".join(
        f"<dt>{status.label}</dt><dd>{text}</dd>" for status, text in _STATUS_KEY.items()
    )
    levels = "; ".join(
        f"{name}: within {limit_m:g} m and {limit_deg:g}°"
        for name, (limit_m, limit_deg) in PRECISION_LEVELS.items()
    )
    return f"""<h2 id="key">How to read it</h2>
<p>Errors are distances of positions in metres and angles between orientations in degrees,
written m / °. A run is a walk with one draw of odometry; figures of a group are means over
runs of each run's own. Every figure says which share of the frames it covers, and
<em>raw</em> is the regressor alone on exactly these frames. The better of the two is
<b>bold</b>.</p>
<p>Precision levels: {levels}. The tables say how many per cent of the counted frames reach
each.</p>
<h3>Where a pose comes from</h3>
<dl>{statuses}</dl>"""


def _overview(groups: Sequence[Group]) -> str:
    """A row a group: the raw regressor, then every method over all frames that have a pose."""
    methods = [name for name in _methods(groups) if name != "apr"]
    names = ["", "", "raw, all predictions", *(_method_name(name, groups) for name in methods)]
    spans = [1, 1, 2, *(3 for _ in methods)]
    head = ["set, odometry, regressor", "runs", "median", "p95"]
    head += ["median", "p95", "share"] * len(methods)
    rows = []
    for number, group in enumerate(groups, 1):
        link = f'<a href="#group-{number}">{escape(group.title)}</a>'
        cells = [link, str(group.cases), format_median(group.raw), format_p95(group.raw)]
        for name in methods:
            row = next(
                (r for r in group.rows if (r.method, r.subset) == (name, "all frames")), None
            )
            cells += _overview_cells(row)
        rows.append(cells)
    starts = [2, *(4 + 3 * index for index in range(len(methods)))]
    table = make_table([names, head], rows, text_columns=1, spans=spans, starts=starts)
    return f"""<h2 id="overview">Overview</h2>
<p>All frames that have a pose; m / °. <b>Bold</b>: better than the raw regressor on the same
frames.</p>
{table}"""


def _overview_cells(row: Row | None) -> list[str]:
    if row is None:
        return [UNKNOWN] * 3
    median, _ = _compare(format_median, row.fused, row.raw, operator.lt)
    p95, _ = _compare(format_p95, row.fused, row.raw, operator.lt)
    return [median, p95, format_share(row.fused)]


def _section(anchor: str, group: Group, figures: Iterable[FigureFiles]) -> str:
    shown = "\n".join(_figure(figure) for figure in figures)
    return f"""<section>
<h2 id="{anchor}">{escape(group.title)}</h2>
<p class="note">{escape(format_walks(group))}. On all predictions, the raw regressor's median is
{format_median(group.raw)} (m / °).</p>
{_group_table(group)}
{shown}
<details><summary>Every walk ({len(group.results)} rows)</summary>
{_walks_table(group)}
</details>
</section>"""


def _group_table(group: Group) -> str:
    """The paper's Tables 2-5: a row a method and subset of the frames."""
    head = ["method", "frames", "runs", "share", *["method", "raw"] * len(_COMPARED)]
    rows = [
        [
            _method_name(row.method, [group]),
            row.subset,
            str(row.walks),
            format_share(row.fused),
            *_compared_cells(row.fused, row.raw),
        ]
        for row in group.rows
    ]
    return _compared_table(head, rows, text_columns=2)


def _walks_table(group: Group) -> str:
    """A row a walk, odometry and method, over all frames that have a pose."""
    head = ["walk", "VIO", "method", "frames", "share"]
    head += [*["method", "raw"] * len(_COMPARED), *(status.label for status in _STATUS_KEY)]
    cases = list(dict.fromkeys(id(result.case) for result in group.results))
    by_case = sorted(group.results, key=lambda result: cases.index(id(result.case)))
    rows = [_walk_cells(result, group) for result in by_case]
    return _compared_table(head, rows, text_columns=3, extra="share by status, %")


def _walk_cells(result: Result, group: Group) -> list[str]:
    has_pose = ~result.has_status(Status.UNLOCALIZED)
    fused = summarize(result.errors, has_pose)
    raw = summarize(result.raw_errors, has_pose)
    count = len(result.status)
    shares = (
        format_number(100 * result.has_status(status).sum() / count if count else float("nan"), 1)
        for status in _STATUS_KEY
    )
    names = [
        escape(result.case.walk),
        escape(result.case.vio),
        _method_name(result.method, [group]),
    ]
    return [*names, str(count), format_share(fused), *_compared_cells(fused, raw), *shares]


def _compared_cells(fused: Summary, raw: Summary) -> list[str]:
    return [
        cell
        for _, text_of, is_better in _COMPARED
        for cell in _compare(text_of, fused, raw, is_better)
    ]


def _compared_table(
    head: list[str], rows: list[list[str]], *, text_columns: int, extra: str = ""
) -> str:
    """A table whose columns come in pairs of method and raw, under a heading each."""
    before = head.index("method", text_columns)
    after = len(head) - before - 2 * len(_COMPARED)
    names = [""] * before + [title for title, _, _ in _COMPARED] + [extra] * bool(after)
    spans = [1] * before + [2] * len(_COMPARED) + [after] * bool(after)
    starts = [before + 2 * index for index in range(len(_COMPARED) + bool(after))]
    return make_table([names, head], rows, text_columns=text_columns, spans=spans, starts=starts)


def _compare(
    text_of: Callable[[Summary], str],
    fused: Summary,
    raw: Summary,
    is_better: Callable[[float, float], bool],
) -> tuple[str, str]:
    """Two summaries' figures as HTML, each number bold where it is better than its counterpart.

    Numbers are compared as printed: what looks equal is not called better.
    """
    own, other = text_of(fused).split("/"), text_of(raw).split("/")
    if len(own) != len(other) or UNKNOWN in [part.strip() for part in own + other]:
        return "/".join(own), "/".join(other)

    def mark(parts: list[str], others: list[str]) -> str:
        pairs = zip(parts, others, strict=True)
        return "/".join(f"<b>{a}</b>" if is_better(float(a), float(b)) else a for a, b in pairs)

    return mark(own, other), mark(other, own)


def _figure(figure: FigureFiles) -> str:
    return embed_figure(
        figure.png, figure.svg, f"{figure.kind}: {figure.group.title}", figure.caption
    )


def _methods(groups: Sequence[Group]) -> list[str]:
    return list(dict.fromkeys(result.method for group in groups for result in group.results))


def _method_name(method: str, groups: Sequence[Group]) -> str:
    """A method's name after a dot of its colour in the figures."""
    color = method_colors(["apr", *_methods(groups)])[method]
    return f'<span class="dot" style="background:{color}"></span>{escape(method)}'
