"""`vioapr inspect`: what a trajectory file is, and what looks wrong with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table
from rich.text import Text

from vioapr.cli.console import console, say, say_notes, with_flags
from vioapr.errors import ParameterError
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.inspection import inspect_file
from vioapr.formats.registry import read_with_notes
from vioapr.schemas.base import to_plain
from vioapr.schemas.inspection import Inspection

_MAX_FITS = 4


def inspect(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[FILE ...]")],
    format_name: Annotated[str | None, tyro.conf.arg(name="from", metavar="FORMAT")] = None,
    against: Path | None = None,
    rate_hz: float | None = None,
    sequence: str | None = None,
    time_unit: TimeUnit | None = None,
    against_format: Annotated[
        str | None, tyro.conf.arg(name="against-from", metavar="FORMAT")
    ] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Say what trajectory files are, how sure that is, and what looks wrong with them.

    Args:
        files: Files, or folders of formats that are one.
        format_name: Format of the files; by default the one each looks like.
        against: Another track of the same walk whose convention is known, as the VIO's: tells
            inverted, mirrored, OpenGL and misordered poses apart.
        rate_hz: Frames per second of image names' numbers, for formats without timestamps.
        sequence: Folder part of the image names to look at.
        time_unit: Unit of the files' times; by default found from their values.
        against_format: Format of the other track; by default the one it looks like.
        json_: Print JSON, a list with an object for each file.

    Example:
        vioapr inspect apr.tum vio.csv
        vioapr inspect apr.tum --against vio.csv

    Raises:
        VioAprError: A file cannot be read.
    """
    if not files:
        raise ParameterError("files: expected at least one to inspect, got none")
    options = ReadOptions(rate_hz, sequence, time_unit)
    reference = None
    if against is not None:
        other = read_with_notes(against, against_format, options, parameter="against_format")
        reference = other.trajectory
        if not json_:
            say_notes(against, other.notes)
    found = []
    for file in files:
        inspection = inspect_file(file, format_name, options, reference)
        found.append(to_plain(inspection))
        if not json_:
            print_inspection(inspection)
    if json_:
        say(json.dumps(found, indent=2))


def print_inspection(inspection: Inspection) -> None:
    """Print what was found out of a file as a table, and below it what looks wrong."""
    best, *others = inspection.candidates
    rest = ", ".join(f"{other.name} {other.confidence:.0%}" for other in others)
    times = "timed" if inspection.is_timed else "no timestamps"
    names = f"{'with' if inspection.has_names else 'no'} image names"
    low_high = zip("xyz", inspection.extent_m, strict=True)
    rows = [
        ("format", f"{best.name}, {best.confidence:.0%} sure" + (f" (or {rest})" if rest else "")),
        ("convention", inspection.convention),
        ("read as", f"{inspection.frames}, {inspection.poses} poses, {times}, {names}"),
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
        held = ", held in portrait" if up.is_portrait else ""
        guess = f"(a guess, from the camera's up-vector{held})"
        off = f"{up.off_axis_deg:.0f} deg off it, spread {up.spread_deg:.0f} deg"
        rows.append(("up", f"{up.axis}, {off} {guess}"))
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
    table = Table(show_header=False, box=None, pad_edge=False)
    for title, value in rows:
        table.add_row(title, Text(value))
    say(inspection.path, "bold")
    console.print(table)
    for warning in inspection.warnings:
        say(f"WARNING {with_flags(warning)}", "yellow")
    if not inspection.warnings:
        say("nothing looks wrong", "green")
