"""The page of a build: what was found, how good it is, how honest, and what to record next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vioapr.evaluation.calibration.sigmas import PROMISED
from vioapr.evaluation.metrics import Summary
from vioapr.evaluation.reliability import Reliability
from vioapr.evaluation.view_coverage import Coverage, Views
from vioapr.files.text import write_text
from vioapr.plurals import count_of
from vioapr.report.figures.coverage import coverage_figure
from vioapr.report.formatting import (
    format_error,
    format_levels,
    format_median,
    format_number,
    format_p95,
    format_reliability,
    format_share,
)
from vioapr.report.page import Cell, Figure, Heading, Page, Table, embed_figure, render_page
from vioapr.report.style import RAW, method_colors, save_figure
from vioapr.schemas.build import (
    AccuracyRecord,
    BuildSummary,
    BuiltLocalizer,
    CoverageRecord,
    SupportRecord,
)
from vioapr.schemas.calibration import Coverage as SigmaCoverage
from vioapr.schemas.results import RowRecord, SummaryRecord

PAGE_FILE, EVALUATION_FOLDER = "index.html", "evaluation"
_CHAIN = "chain"
_CAPTION = (
    "The ground that somebody walked on, from above: the darker, the more directions were "
    "recorded from there. Numbers are those of the list above; arrows show where few looked."
)


@dataclass(frozen=True, kw_only=True)
class BuildPage(Page):
    """The data of `build.html`.

    Attributes:
        headline: What came out, in a sentence or two.
        facts: What was found: names and texts.
        advice: What to record next, a sentence each.
        areas: Where in the place, a sentence each, as numbered on the plan.
        plan: Coverage from above.
        coverage: Coverage in figures: names and texts.
        localizers: A row a localizer; None where there is one.
        accuracy: Of the best, by tracker, a row a method over all frames with a pose.
        support: Errors by how many training images were near; None without test recordings.
        honesty: Whether stated uncertainties hold: names and texts.
        links: Pages with more: their paths and names.
        steps: A row a step.
        commands: What to do with it.
    """

    headline: str
    facts: Sequence[tuple[str, str]]
    advice: Sequence[str]
    areas: Sequence[str]
    plan: Figure
    coverage: Sequence[tuple[str, str]]
    localizers: Table | None
    accuracy: Sequence[tuple[str, Table]]
    support: Table | None
    honesty: Sequence[tuple[str, str]]
    links: Sequence[tuple[str, str]]
    steps: Table
    commands: Sequence[str]


def write_build_report(
    folder: Path,
    summary: BuildSummary,
    coverage: Coverage,
    train: Mapping[str, Views],
    test: Mapping[str, Views],
    *,
    has_compass: bool,
    commands: Sequence[str],
) -> Path:
    """Write the page of a build, and its figure as files beside it.

    Args:
        folder: The build's, within the scene's.
        summary: Of the build.
        coverage: As the summary has it, whole.
        train: Of the training recordings.
        test: Of the test recordings.
        has_compass: Whether the world's x is east.
        commands: What to do with the localizer.

    Returns:
        The page's path.

    Raises:
        UnwritableError: A file cannot be written.
    """
    gaps = summary.coverage.gaps
    drawn = coverage_figure(coverage, gaps, train, test, has_compass=has_compass)
    png, svg = save_figure(drawn, folder / "figures" / "coverage")
    localizer = summary.localizers[0]
    links = [("../map/report/index.html", "the map")] if summary.mapped.is_mapped else []
    for one in summary.localizers:
        if one.accuracy:
            path = f"{EVALUATION_FOLDER}/{one.model.replace(':', '-')}/index.html"
            links.append((path, f"every test walk by {one.model}"))
    page = BuildPage(
        title=f"{summary.scene}: localizer",
        contents=[
            ("result", "Result"),
            ("next", "What to record next"),
            ("accuracy", "How accurate"),
            ("honesty", "How honest"),
            ("use", "Use it"),
            ("steps", "Steps"),
        ],
        headline=describe_result(localizer),
        facts=list_facts(summary),
        advice=summary.advice,
        areas=summary.areas,
        plan=embed_figure(png, svg, "coverage", _CAPTION),
        coverage=list_coverage(summary.coverage),
        localizers=make_localizers_table(summary.localizers) if summary.localizers[1:] else None,
        accuracy=[(one.vio, make_accuracy_table(one)) for one in localizer.accuracy],
        support=make_support_table(localizer.support) if localizer.support else None,
        honesty=list_honesty(localizer),
        links=links,
        steps=make_steps_table(summary.seconds),
        commands=commands,
    )
    write_text(folder / PAGE_FILE, render_page("build.html", page))
    return folder / PAGE_FILE


def describe_result(localizer: BuiltLocalizer) -> str:
    """Say in a sentence or two how good the localizer is."""
    if not localizer.accuracy:
        return "A localizer was built. No test recording says how accurate it is."
    most = max(localizer.accuracy, key=lambda one: one.walks)
    (row,) = (row for row in _whole_rows(most) if row.method == _CHAIN)
    fused, raw = _summary_of(row.fused), _summary_of(most.raw)
    return (
        f"On {count_of(most.walks, 'test walk')} that it has not learned, it answers "
        f"{format_share(fused)} of the frames, half of them within {_pair(format_median(fused))} "
        f"and 95 % within {_pair(format_p95(fused))}. Raw predictions alone: "
        f"{_pair(format_median(raw))}, and {_pair(format_p95(raw))}."
    )


def _pair(text: str) -> str:
    """Put units to what the tables say as `m / °`."""
    length, _, angle = text.partition(" / ")
    return f"{length} m and {angle}°" if angle else text


def list_facts(summary: BuildSummary) -> list[tuple[str, str]]:
    """List what was found in the scene and what was made of it."""
    checked, mapped, localizer = summary.checked, summary.mapped, summary.localizers[0]
    counts = (checked.recordings, "recording"), (checked.images, "image")
    facts = [("Scene", ", ".join(count_of(count, noun) for count, noun in counts))]
    if mapped.is_mapped:
        share = 100 * mapped.registered / max(mapped.images, 1)
        facts.append(
            ("Map", f"{share:.0f} % of its images have a place, {count_of(mapped.points, 'point')}")
        )
    else:
        facts.append(("Ground truth", "came with the scene; nothing was mapped"))
    facts.append(("Regressor", localizer.model))
    facts.append(("File", f"localizer.onnx, {localizer.bytes / 1e6:.1f} MB, method {_CHAIN}"))
    facts.append(("Time", f"{sum(summary.seconds.values()) / 60:.1f} minutes"))
    facts += [("Note", note) for note in checked.notes]
    return facts


def list_coverage(record: CoverageRecord) -> list[tuple[str, str]]:
    """Say from how much of the ground how much was seen."""
    return [
        ("Seen all round", f"{100 * record.all_round:.0f} % of the ground that was walked on"),
        ("Passed one way only", f"{100 * record.one_way:.0f} %"),
        ("Seen in one recording alone", f"{100 * record.one_walk:.0f} % of the views"),
        ("Cells", f"{record.cells}, of {record.cell_m:.1f} m"),
    ]


def list_honesty(localizer: BuiltLocalizer) -> list[tuple[str, str]]:
    """Say whether what the localizer states of its errors is true."""
    facts: list[tuple[str, str]] = []
    by = ", without the calibration" if localizer.is_calibrated else ""
    for one in localizer.accuracy:
        for row in one.reliability:
            if row.method == _CHAIN:
                figures = Reliability(
                    *(_known(getattr(row.figures, name)) for name in Reliability._fields)
                )
                jumps, _, wrong, *_ = format_reliability(figures)
                facts.append(("Wrong and sure", f"{wrong} of the frames err by above 5 sigmas{by}"))
                facts.append(("Content jumps", f"{jumps} a minute above 5 cm{by}"))
    left_out = localizer.left_out
    if left_out is None:
        return [*facts, ("Calibration", f"none: {localizer.why_not}")]
    promised = " / ".join(f"{100 * share:.0f}" for share in PROMISED)
    for name, shares in (("Position", left_out.position), ("Orientation", left_out.orientation)):
        text = f"{_shares(shares)} % of frames within 1 / 2 / 3 sigmas; {promised} are promised"
        facts.append((name, f"{text} (each walk by what the others say)"))
    own, other = left_out.calibrated.median_m, left_out.uncalibrated.median_m
    verdict = "the file carries it" if localizer.is_calibrated else "the file goes without it"
    ratios = f"{own:.2f} with it, {other:.2f} without"
    facts.append(
        (
            "Calibration",
            f"median error over the raw regressor's: {ratios}; {verdict}",
        )
    )
    return facts


def make_localizers_table(localizers: Sequence[BuiltLocalizer]) -> Table:
    """Make a row a localizer and tracker, the best localizer first."""
    rows: list[list[str | Cell]] = []
    for number, one in enumerate(localizers):
        for accuracy in one.accuracy:
            (row,) = (row for row in _whole_rows(accuracy) if row.method == _CHAIN)
            fused, raw = _summary_of(row.fused), _summary_of(accuracy.raw)
            texts = [format_share(fused), format_median(fused), format_p95(fused)]
            name = Cell(((one.model, number == 0),))
            rows.append([name, f"{one.bytes / 1e6:.1f}", format_median(raw), *texts])
    names = ("regressor", "MB", "raw median, m / °", "share", "chain, m / °", "95th percentile")
    return Table([[Heading(name) for name in names]], rows, text_columns=1)


def make_accuracy_table(accuracy: AccuracyRecord) -> Table:
    """Make a row a method over all frames with a pose."""
    rows = _whole_rows(accuracy)
    colors = method_colors([RAW, *(row.method for row in rows)])
    cells: list[list[str | Cell]] = []
    for row in rows:
        figures = _summary_of(row.fused)
        cells.append(
            [
                Cell(((row.method, row.method == _CHAIN),), color=colors[row.method]),
                format_share(figures),
                format_median(figures),
                format_p95(figures),
                format_levels(figures),
            ]
        )
    names = ("method", "share", "median, m / °", "95th percentile, m / °", "high / medium / low, %")
    return Table([[Heading(name) for name in names]], cells, text_columns=1)


def make_support_table(records: Sequence[SupportRecord]) -> Table:
    """Make a row a class of test frames: how many training images are near, and what they err."""
    total = max(sum(record.frames for record in records), 1)
    rows: list[list[str | Cell]] = []
    for one in records:
        if one.most is None:
            label = f"{one.least} or more"
        else:
            label = str(one.least) if one.least == one.most else f"{one.least} to {one.most}"
        pairs = (one.raw_median_m, one.raw_median_deg), (one.fused_median_m, one.fused_median_deg)
        texts = [f"{format_error(_known(m))} / {format_error(_known(deg))}" for m, deg in pairs]
        rows.append([label, f"{100 * one.frames / total:.0f} %", *texts])
    names = ("training images from near", "test frames", "raw median, m / °", "chain, m / °")
    return Table([[Heading(name) for name in names]], rows, text_columns=1)


def make_steps_table(seconds: Mapping[str, float]) -> Table:
    """Make a row a step, with how long it took."""
    rows = [[name, format_number(value, 1)] for name, value in seconds.items()]
    return Table([[Heading("step"), Heading("seconds")]], rows, text_columns=1)


def _whole_rows(accuracy: AccuracyRecord) -> list[RowRecord]:
    return [row for row in accuracy.rows if row.subset == "all frames"]


def _summary_of(record: SummaryRecord) -> Summary:
    return Summary(*(_known(getattr(record, name)) for name in Summary._fields))  # type: ignore[arg-type]


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _shares(shares: SigmaCoverage) -> str:
    from vioapr.schemas.base import to_plain

    return " / ".join(f"{100 * value:.0f}" for value in to_plain(shares).values())
