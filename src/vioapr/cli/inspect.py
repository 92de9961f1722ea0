"""`vioapr inspect`: what a trajectory file is, and what looks wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import say, say_notes, send_messages_aside, warn, with_flags
from vioapr.cli.streams import InputFile
from vioapr.cli.tables import Column, Format, Row, Table, Value, show
from vioapr.errors import FileError, FormatError, ParameterError, VioAprError
from vioapr.files.text import is_folder
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.inspection import inspect_file
from vioapr.formats.registry import read_with_notes
from vioapr.importers.registry import find_importer
from vioapr.plurals import count_of
from vioapr.schemas.inspection import Inspection

_MAX_FITS = 4


def inspect(
    files: Annotated[
        tyro.conf.Positional[tuple[InputFile, ...]], tyro.conf.arg(metavar="[FILE ...]")
    ],
    format_name: Annotated[str | None, tyro.conf.arg(name="from", metavar="FORMAT")] = None,
    against: InputFile | None = None,
    rate_hz: float | None = None,
    sequence: str | None = None,
    time_unit: TimeUnit | None = None,
    against_format: Annotated[
        str | None, tyro.conf.arg(name="against-from", metavar="FORMAT")
    ] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
    form: Format = "table",
) -> None:
    """Say what trajectory files are, how sure that is, and what looks wrong with them.

    Of several files, those that cannot be read are named and left out; the exit code is 2 then.

    Args:
        files: Files, or folders of formats that are one; - is standard input.
        format_name: Format of the files; by default the one each looks like.
        against: Another track of the same walk whose convention is known, as the VIO's: tells
            inverted, mirrored, OpenGL and misordered poses apart.
        rate_hz: Frames per second of image names' numbers, for formats without timestamps.
        sequence: Folder part of the image names to look at; or the device (kapture), chunk
            (Metashape) or track (Spectacular AI), where a file holds several.
        time_unit: Unit of the files' times; by default found from their values.
        against_format: Format of the other track; by default the one it looks like.
        json_: As --format json.
        form: table; csv: a row a file; json: a list with an object for each file; markdown.

    Example:
        vioapr inspect apr.tum vio.csv
        vioapr inspect apr.tum --against vio.csv

    Raises:
        VioAprError: A file cannot be read.
    """
    if not files:
        raise ParameterError("files: expected at least one to inspect, got none")
    options = ReadOptions(rate_hz, sequence, time_unit)
    form = "json" if json_ else form
    if form in ("csv", "json"):
        send_messages_aside()
    reference = None
    if against is not None:
        other = read_with_notes(against, against_format, options, parameter="against_format")
        reference = other.trajectory
        say_notes(against, other.notes)
    found: list[Inspection] = []
    for file in files:
        try:
            found.append(inspect_file(file, format_name, options, reference, against))
        except FileError as error:
            error = _name_importer(error, file)
            if len(files) == 1:
                raise error from None
            warn(f"skipped: {error}")
            continue
        if form not in ("csv", "json"):
            show_inspection(found[-1], form)
    if form in ("csv", "json"):
        show([table_of(inspection) for inspection in found], form, found)
    if len(found) < len(files):
        raise VioAprError(f"{len(files) - len(found)} of {len(files)} files cannot be read")


def _name_importer(error: FileError, path: Path) -> FileError:
    """Say of a folder that is no trajectory which command imports it, if one does."""
    if not isinstance(error, FormatError) or error.path != str(path) or not is_folder(path):
        return error
    importer = find_importer(path)
    if importer is None:
        return error
    poses = " --poses FILE" if importer.name == "images" else ""
    command = f"vioapr import {importer.name} {path}{poses} --out SCENE"
    return FormatError(path, f"{error.problem}; to import its images as well: {command}")


def show_inspection(inspection: Inspection, form: str) -> None:
    """Print what was found out of a file as a table, and below it what looks wrong."""
    say(inspection.path, "bold")
    show([table_of(inspection)], form, [inspection])
    for warning in inspection.warnings:
        say(f"WARNING {with_flags(warning)}", "yellow")
    if not inspection.warnings:
        say("nothing looks wrong", "green")


def values_of(inspection: Inspection) -> dict[str, Value]:
    """What was found out of a file, for programs, as one flat row."""
    best, speed, up = inspection.candidates[0], inspection.speed, inspection.up
    extent = dict(zip("xyz", inspection.extent_m, strict=True))
    return {
        "path": inspection.path,
        "format": best.name,
        "confidence": best.confidence,
        "frames": inspection.frames,
        "poses": inspection.poses,
        "start_s": inspection.start_s,
        "duration_s": inspection.duration_s,
        "rate_hz": inspection.rate_hz,
        "path_length_m": inspection.path_length_m,
        **{f"{axis}_min_m": low for axis, (low, _) in extent.items()},
        **{f"{axis}_max_m": high for axis, (_, high) in extent.items()},
        "median_speed_m_s": None if speed is None else speed.median_m_s,
        "p95_speed_m_s": None if speed is None else speed.p95_m_s,
        "max_speed_m_s": None if speed is None else speed.max_m_s,
        "up": None if up is None else up.axis,
        "fit": inspection.fits[0].title if inspection.fits else None,
        "warnings": " | ".join(with_flags(warning) for warning in inspection.warnings),
    }


def table_of(inspection: Inspection) -> Table:
    """Lay out what was found out of a file: a line a fact."""
    best, *others = inspection.candidates
    rest = ", ".join(f"{other.name} {other.confidence:.0%}" for other in others)
    times = "timed" if inspection.is_timed else "no timestamps"
    names = f"{'with' if inspection.has_names else 'no'} image names"
    low_high = zip("xyz", inspection.extent_m, strict=True)
    rows = [
        ("format", f"{best.name}, {best.confidence:.0%} sure" + (f" (or {rest})" if rest else "")),
        ("convention", inspection.convention),
        ("read as", f"{inspection.frames}, {count_of(inspection.poses, 'pose')}, {times}, {names}"),
        ("extent", ", ".join(f"{n} {low:.3f} to {high:.3f} m" for n, (low, high) in low_high)),
        ("path", f"{inspection.path_length_m:.3f} m"),
    ]
    if inspection.duration_s is not None and inspection.start_s is not None:
        rate = "" if inspection.rate_hz is None else f" at {inspection.rate_hz:.3g} Hz (median)"
        span = f"{inspection.duration_s:.3f} s{rate}, from {inspection.start_s:.6f} s"
        rows.append(("time", span))
    if (speed := inspection.speed) is not None:
        speeds = f"median {speed.median_m_s:.3f}, 95 % below {speed.p95_m_s:.3f}, "
        rows.append(("speed", f"{speeds}max {speed.max_m_s:.3f} m/s"))
    if (up := inspection.up) is not None:
        held = "in portrait" if up.is_portrait else "upright"
        why = "by definition" if up.by == "definition" else "a guess"
        off = f"{up.off_axis_deg:.0f} deg off it, spread {up.spread_deg:.0f} deg"
        rows.append(("up", f"{up.axis}, {why}; the camera's up, held {held}, is {off}"))
    elif inspection.frames.endswith("_cam"):
        rows.append(("up", "unknown: the format does not say, and the camera was not held level"))
    for rank, fit in enumerate(inspection.fits[:_MAX_FITS]):
        errors = f"rotations {fit.rotation_deg:.2f} deg, directions {fit.direction_deg:.1f} deg"
        rows.append(("" if rank else "fit", f"{fit.title}: {errors}"))
    if (device := inspection.device) is not None:
        axis = ", ".join(f"{each:.3f}" for each in device.axis)
        rows.append(
            ("device", f"body_from_cam {device.angle_deg:.1f} deg about ({axis}), "
             f"± {device.rotation_sigma_deg:.1f} deg")
        )  # fmt: skip
        if device.lever_arm_m is None:
            rows.append(("", "lever arm not observable: the motion does not tell it"))
        else:
            arm = zip(device.lever_arm_m, device.lever_arm_sigma_m, strict=True)
            rows.append(("", f"lever arm {', '.join(f'{a:.3f} ± {s:.3f}' for a, s in arm)} m"))
    for rank, note in enumerate(inspection.notes):
        rows.append(("" if rank else "note", with_flags(note)))
    values: list[dict[str, Value]] = [values_of(inspection), *({} for _ in rows[1:])]
    columns = (Column("", is_figure=False), Column("", is_figure=False))
    return Table("", columns, [[Row(*pair) for pair in zip(rows, values, strict=True)]])
