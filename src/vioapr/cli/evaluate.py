"""`vioapr evaluate`: the paper's tables and figures for any walks."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Collection, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Annotated, Any

import tyro

from vioapr.cli.calibrated import require_chain, tabulate_calibrated
from vioapr.cli.console import progress, say, send_messages_aside, warn
from vioapr.cli.method_params import MethodParams, parse_methods
from vioapr.cli.streams import OutputFile
from vioapr.cli.tables import Column, Format, Row, Table, Value, show
from vioapr.errors import ParameterError, VioAprError
from vioapr.evaluation.calibration.calibrate import group_by_pair
from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import count_ticks
from vioapr.evaluation.tables import Group, tabulate, to_csv, to_records
from vioapr.evaluation.walk_tracks import WalkReader
from vioapr.files.outputs import check_outputs
from vioapr.files.text import write_text
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.body_from_cam import AUTO
from vioapr.fusion.calibrated import read_calibration
from vioapr.fusion.offline import View
from vioapr.fusion.smoothing import SMOOTHERS
from vioapr.report.evaluation_report import (
    REPORT_PATTERNS,
    count_report_ticks,
    write_report,
)
from vioapr.report.formatting import (
    RELIABILITY_HEADERS,
    format_levels,
    format_median,
    format_p95,
    format_reliability,
    format_share,
    format_walks,
)
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import encode
from vioapr.trajectory import DEFAULT_TOLERANCE_S
from vioapr.work.results import ResultFolder

_HOW_TO_READ = (
    "Errors: position m / orientation deg, means over walks of each walk's median and 95th "
    "percentile. Levels: % within 0.25 m, 2 deg / 0.5 m, 5 deg / 5 m, 10 deg. "
    "raw: the regressor alone on the same frames."
)
_HOW_TO_READ_RELIABILITY = (
    "Jumps: steps of displayed content above 5 cm beyond VIO's motion, at the camera or 3 m ahead. "
    "Wrong and sure: error above 5 stated sigmas. Mean: error of all frames with a pose, m / deg; "
    "surest: of that share of all frames, by stated sigma; risk area: averaged over all shares."
)


def evaluate(
    walks: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[FOLDER ...]")],
    methods: str = "apr,vio,vio-apr,chain",
    json_out: Annotated[OutputFile | None, tyro.conf.arg(name="json")] = None,
    csv_out: Annotated[OutputFile | None, tyro.conf.arg(name="csv")] = None,
    form: Format = "table",
    report: Path | None = None,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    view: View = "retrospective",
    offline: bool = False,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    calibration: Path | None = None,
    vio_from_cam: Annotated[str | None, tyro.conf.arg(metavar="auto|FILE")] = None,
    time_unit: TimeUnit | None = None,
    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    params: tyro.conf.OmitArgPrefixes[MethodParams] = MethodParams(),  # noqa: B008
) -> None:
    """Fuse walks and compare the poses with ground truth, in the paper's tables and figures.

    Every folder at or below the given paths that holds a file gt.*, at least one vio_<name>.*
    and at least one apr_<name>.* is a walk; the folder above it names its set. Figures are
    means over walks of each walk's own, and always say which share of the frames they cover
    and what the raw regressor gets on the same frames.

    What cannot be evaluated (a file that cannot be read, a walk without a part, frames that do
    not meet) is named, a line each, and left out; the exit code is 0 if something is left. With
    --strict it is 2, and nothing is written.

    Args:
        walks: Folders to search.
        methods: Methods to run, separated by commas: apr, vio, vio-apr, chain,
            pose-filter, mapnet-pgo, pose-graph.
        json_out: JSON to write: the tables, and every walk's own figures.
        csv_out: CSV to write: a row a frame that has ground truth, with its pose and errors.
        form: How to print the tables.
        report: Folder to write an HTML page with tables and figures to (index.html); an earlier
            report in it is replaced, other files stay.
        overwrite: Replace files that exist, also those that vioapr did not write; never one that is
            read.
        view: retrospective: predictions that later prove right count as keyframes, as in the
            paper's tables. live: what was known when each frame arrived.
        offline: Use the future too, by the methods that can (chain): the best trajectory after
            the walk. The others run as ever.
        tolerance_s: Largest difference of timestamps within a frame, s.
        calibration: What `vioapr calibrate` found, for method chain; a flag wins over what it says.
        vio_from_cam: For trackers that give poses of an IMU's body: how the camera is mounted on
            it. auto estimates it by ground truth; FILE holds the constant transform body_from_cam,
            see `vioapr fuse --help`.
        time_unit: Unit of all files' times; by default found from their values.
        strict: Refuse what is otherwise evaluated or left out with a warning.
        params: Parameters of the methods.

    Example:
        vioapr evaluate walks --methods vio-apr,chain --report report
    """
    chosen = parse_methods(methods, params)
    known = None
    if calibration is not None:
        require_chain(list(chosen))
        known = read_calibration(calibration)
    skip = None if strict else warn_of_skipped
    folders = find_walks(walks, refuse if strict else warn_of_skipped)
    read = [path for walk in folders for path in walk.paths]
    if vio_from_cam not in (None, AUTO):
        read.append(Path(vio_from_cam))
    if calibration is not None:
        read.append(calibration)
    check_outputs([json_out, csv_out], read, overwrite=overwrite)
    check_report(report, overwrite=overwrite)
    if form in ("csv", "json"):
        send_messages_aside()
    with progress("reading walks", len(folders)) as tick:
        options = ReadOptions(time_unit=time_unit, strict=strict)
        reader = WalkReader(options, vio_from_cam, say, warn)
        cases = load_cases(folders, tolerance_s=tolerance_s, reader=reader, skip=skip, tick=tick)
    if offline:
        say(f"after the walk: {say_smoothed(chosen)}")
    parts = [cases] if known is None else list(group_by_pair(cases).values())
    with progress("fusing", sum(count_ticks(part, chosen) for part in parts)) as tick:
        if known is None:
            results, groups = tabulate(cases, chosen, view=view, offline=offline, tick=tick)
        else:
            results, groups = tabulate_calibrated(
                cases, chosen, known, view=view, offline=offline, tick=tick, strict=strict
            )
    print_tables(groups, form)
    if json_out is not None:
        write_text(json_out, encode(to_records(groups), indent=1), overwrite=overwrite)
    if csv_out is not None:
        write_text(csv_out, to_csv(results), overwrite=overwrite)
    if report is not None:
        publish(
            groups,
            report,
            title="Localization report",
            params_of_method=chosen,
            view=view,
            overwrite=overwrite,
        )


def say_smoothed(methods: Collection[str]) -> str:
    """Which methods use the future, and which cannot.

    Raises:
        ParameterError: None can.
    """
    able = [name for name in methods if name in SMOOTHERS]
    if not able:
        raise ParameterError(f"--offline: no method of --methods can: add {' or '.join(SMOOTHERS)}")
    others = [name for name in methods if name not in SMOOTHERS]
    return ", ".join(able) + (f"; as it happened: {', '.join(others)}" if others else "")


def warn_of_skipped(error: VioAprError) -> None:
    """Say what is left out, and why."""
    warn(f"skipped: {error}")


def refuse(error: VioAprError) -> None:
    """Leave nothing out."""
    raise error


def check_report(folder: Path | None, *, overwrite: bool) -> None:
    """See, before the work, that a report would replace no file of the user's.

    Raises:
        AlreadyExistsError: It would.
    """
    if folder is not None:
        ResultFolder(folder, overwrite=overwrite).check(REPORT_PATTERNS)


def publish(
    groups: Sequence[Group],
    folder: Path,
    *,
    title: str,
    params_of_method: Mapping[str, Any],
    view: View,
    overwrite: bool = False,
) -> None:
    """Write the report and say where it is."""
    with (
        ResultFolder(folder, overwrite=overwrite).adding(all_of=REPORT_PATTERNS) as partial,
        progress("drawing figures", count_report_ticks(groups)) as tick,
    ):
        page = write_report(
            groups,
            partial,
            title=title,
            command=shlex.join(["vioapr", *sys.argv[1:]]),
            params_of_method=params_of_method,
            view=view,
            date=date.today().isoformat(),
            tick=tick,
        )
    say(f"report: {(folder / page.name).resolve()}")


def print_tables(groups: Sequence[Group], form: str = "table") -> None:
    """Print the tables of all groups, and how to read them."""
    tables = [table_of(group) for group in groups]
    tables += [reliability_table_of(group) for group in groups]
    show(tables, form, to_records(groups), [_HOW_TO_READ, _HOW_TO_READ_RELIABILITY])


def table_of(group: Group) -> Table:
    """Lay out a group: a row a method and subset, raw figures beside the fused ones.

    For programs, rows of all frames also have the figures of the second table.
    """
    sections: list[list[Row]] = []
    previous = ""
    figures_of = {row.method: row.figures._asdict() for row in group.reliability}
    for row in group.rows:
        if row.method != previous:
            sections.append([])
        cells = [row.method if row.method != previous else "", row.subset, format_share(row.fused)]
        for figures in (format_median, format_p95, format_levels):
            cells += [figures(row.fused), figures(row.raw)]
        values: dict[str, Value] = {
            "set": group.set_name,
            "vio": group.vio,
            "apr": group.apr,
            "method": row.method,
            "frames": row.subset,
            "walks": row.walks,
            **{name: float(value) for name, value in row.fused._asdict().items()},
            **{f"raw_{name}": float(value) for name, value in row.raw._asdict().items()},
        }
        is_whole = row.subset == "all frames"
        values |= {k: v if is_whole else None for k, v in figures_of[row.method].items()}
        sections[-1].append(Row(tuple(cells), values))
        previous = row.method
    columns = [Column("method", is_figure=False), Column("frames", is_figure=False)]
    columns.append(Column("share"))
    for header in ("median", "p95", "levels %"):
        columns += [Column(header), Column("raw", stays_with_last=True)]
    title = f"{group.title}: {format_walks(group)}"
    return Table(title, tuple(columns), sections)


def reliability_table_of(group: Group) -> Table:
    """Lay out whether content stays put and whether sigmas can be believed: a row a method."""
    # For programs, the figures stand in the first table's rows.
    rows = [Row((row.method, *format_reliability(row.figures)), {}) for row in group.reliability]
    columns = (Column("method", is_figure=False), *map(Column, RELIABILITY_HEADERS))
    return Table(f"{group.title}: content jumps and stated sigmas", columns, [rows])
