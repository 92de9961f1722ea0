"""`vioapr vio-quality`: how far odometry drifts, and whether it diverges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import progress, say, warn
from vioapr.cli.streams import OutputFile
from vioapr.cli.tables import Column, Format, Row, Table, Value, show
from vioapr.errors import VioAprError
from vioapr.evaluation.metrics import PoseErrors, summarize
from vioapr.evaluation.vio_quality import VioQuality, VioQualityParams, analyze
from vioapr.evaluation.vio_tables import group_tracks, share_within, steady, to_record
from vioapr.evaluation.vio_tracks import find_vio_walks
from vioapr.files.outputs import check_outputs
from vioapr.files.text import write_text
from vioapr.report.figures.vio_quality import VIO_FIGURES
from vioapr.report.formatting import format_error, format_median, format_number
from vioapr.report.style import save_figure
from vioapr.schemas.base import encode, to_plain
from vioapr.trajectory import DEFAULT_TOLERANCE_S
from vioapr.work.results import ResultFolder


def vio_quality(
    paths: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[PATH ...]")],
    json_out: Annotated[OutputFile | None, tyro.conf.arg(name="json")] = None,
    form: Format = "table",
    figures: Path | None = None,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    params: tyro.conf.OmitArgPrefixes[VioQualityParams] = VioQualityParams(),  # noqa: B008
) -> None:
    """Compare a tracker's poses with ground truth: drift, relative errors, divergence.

    RPE and ROE are the paper's: the difference between the lengths, and between the angles, of
    the tracker's and the true motion between two frames. They need no alignment. APE and AOE
    are after rigid alignment on the first seconds; ATE after alignment of the whole track.

    Walks that cannot be compared are named, a line each, and left out.

    Args:
        paths: Scenes; folders with walks (gt.* beside vio_<name>.*, or <walk>_gt.* beside
            <walk>_<name>.*); or the common beginning of one walk's files.
        json_out: JSON to write: every walk's and every group's figures.
        form: How to print the figures.
        figures: Folder to write the figures to, as PNG and SVG; other files in it stay.
        overwrite: Replace files that exist, also those that vioapr did not write; never one that is
            read.
        tolerance_s: Largest difference of timestamps within a frame, s.
        params: What is compared.

    Example:
        vioapr vio-quality courtyard --figures figures
    """
    walks = find_vio_walks(paths)
    read = [file for walk in walks for file in walk.files]
    check_outputs([json_out], read, overwrite=overwrite)
    if figures is not None:
        ResultFolder(figures, overwrite=overwrite).check(f"{name}.*" for name in VIO_FIGURES)
    qualities: list[VioQuality] = []
    problems: list[VioAprError] = []
    with progress("comparing walks", len(walks)) as tick:
        for walk in walks:
            try:
                qualities += [analyze(track, params) for track in walk.read(tolerance_s)]
            except VioAprError as error:
                problems.append(error)
            tick()
    if not qualities:
        raise problems[0]
    for problem in problems:
        warn(f"skipped: {problem}")
    record = to_record(qualities)
    table = table_of(qualities, params, [to_plain(track) for track in record.tracks])
    show([table], form, record, notes_of(qualities, params))
    if json_out is not None:
        write_text(json_out, encode(record, indent=1), overwrite=overwrite)
    if figures is not None:
        with ResultFolder(figures, overwrite=overwrite).adding() as partial:
            for name, draw in VIO_FIGURES.items():
                save_figure(draw(qualities), partial / name)
        say(f"figures: {figures.resolve()}")


def table_of(
    qualities: Sequence[VioQuality],
    params: VioQualityParams,
    records: Sequence[Mapping[str, Value]],
) -> Table:
    """Lay out a row a track, and one for what those of a set that do not diverge make together.

    Args:
        qualities: Of the tracks.
        params: What was compared.
        records: Of the tracks too, for programs.
    """
    record_of = dict(zip(map(id, qualities), records, strict=True))
    sections: list[list[Row]] = []
    for name, members in group_tracks(qualities).items():
        rows = [
            Row((name if number == 0 else "", *_cells(one)), record_of[id(one)])
            for number, one in enumerate(members)
        ]
        if len(members) > 1:
            pairs = format_number(100 * share_within(steady(members)), 1)
            walks = f"all {len(steady(members))} that do not diverge"
            rows.append(Row(("", walks, *[""] * 4, pairs, *[""] * 4), {}))
        sections.append(rows)
    good = f"<{params.within_m:g} m, <{params.within_deg:g}° %"
    headers = ("path m", "ATE m", "APE m / AOE °", "RPE m / ROE °", good, "drift % of path",
               "m, ° a minute", "scale", "")  # fmt: skip
    names = (Column("set and tracker", is_figure=False), Column("walk", is_figure=False))
    title = f"pairs at {params.rate_hz:g} Hz; aligned on the first {params.align_s:g} s"
    return Table(title, (*names, *map(Column, headers)), sections)


def _cells(quality: VioQuality) -> tuple[str, ...]:
    """A track's cells, from the walk's name on."""
    distance, minute = quality.per_distance, quality.per_time
    a_minute = 60 / minute.stretch if minute.stretch else float("nan")
    percent = 100 / distance.stretch if distance.stretch else float("nan")
    gaps = PoseErrors(quality.gaps.distance_m, quality.gaps.angle_deg)
    return (
        quality.track.walk,
        format_number(quality.path_m, 1),
        format_error(quality.ate_m),
        format_median(summarize(quality.errors)),
        format_median(summarize(gaps)),
        format_number(100 * quality.share_within, 1),
        format_error(percent * distance.position_m),
        f"{format_error(minute.position_m * a_minute)}, "
        f"{format_error(minute.orientation_deg * a_minute)}",
        format_number(quality.scale, 3),
        "diverges" if quality.diverges_at_s is not None else "",
    )


def notes_of(qualities: Sequence[VioQuality], params: VioQualityParams) -> list[str]:
    """How to read the table, and what to know of single tracks."""
    notes = [
        "Medians over frames or pairs. Drift: error of relative poses over stretches of "
        f"{params.stretch_m:g} m and {params.stretch_s:g} s, or half the walk; it has the ground "
        "truth's own orientation noise in it. Scale: true metres per metre of the tracker."
    ]
    for quality in qualities:
        if quality.diverges_at_s is not None:
            notes.append(
                f"{quality.track.title}: the tracker diverges from ground truth, first at "
                f"{quality.diverges_at_s:.0f} s; the group's figures are without it."
            )
        if not len(quality.pair_rows):
            notes.append(
                f"{quality.track.title}: no two frames are {1 / params.rate_hz:g} s apart: "
                "choose another --rate-hz."
            )
    return notes
