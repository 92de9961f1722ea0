"""`vioapr inspect`: what a trajectory file is, and what looks wrong with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table
from rich.text import Text

from vioapr.cli.console import console
from vioapr.errors import ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.inspection import Inspection, inspect_file
from vioapr.formats.registry import read_trajectory

_MAX_FITS = 4


def inspect(
    files: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[FILE ...]")],
    from_: Annotated[str | None, tyro.conf.arg(name="from", metavar="FORMAT")] = None,
    against: Path | None = None,
    rate_hz: float | None = None,
    sequence: str | None = None,
    json_: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Say what trajectory files are, how sure that is, and what looks wrong with them.

    Args:
        files: Files, or folders of formats that are one.
        from_: Format of the files; by default the one each looks like.
        against: Another track of the same walk whose convention is known, as the VIO's: tells
            inverted, mirrored, OpenGL and misordered poses apart.
        rate_hz: Frames per second of image names' numbers, for formats without timestamps.
        sequence: Folder part of the image names to look at.
        json_: Print JSON, a list with an object for each file.

    Raises:
        VioAprError: A file cannot be read.
    """
    if not files:
        raise ParameterError("nothing to inspect: name at least one file")
    options = ReadOptions(rate_hz, sequence)
    reference = None if against is None else read_trajectory(against, options=options)
    found = []
    for file in files:
        inspection = inspect_file(file, from_, options, reference)
        found.append(inspection.to_json())
        if not json_:
            _print(inspection)
    if json_:
        console.print(json.dumps(found, indent=2), markup=False, soft_wrap=True)


def _print(inspection: Inspection) -> None:
    table = Table(show_header=False, box=None, pad_edge=False)
    for title, value in _facts(inspection):
        table.add_row(title, Text(value))
    console.print(Text(inspection.path, style="bold"))
    console.print(table)
    for warning in inspection.warnings:
        console.print(Text(f"WARNING {warning}", style="yellow"), soft_wrap=True)
    if not inspection.warnings:
        console.print(Text("nothing looks wrong", style="green"))


def _facts(inspection: Inspection) -> list[tuple[str, str]]:
    best, *others = inspection.candidates
    rest = ", ".join(f"{other.name} {other.confidence:.0%}" for other in others)
    low_high = zip("xyz", inspection.extent_m, strict=True)
    facts = [
        ("format", f"{best.name}, {best.confidence:.0%} sure" + (f" (or {rest})" if rest else "")),
        ("convention", inspection.convention),
        ("read as", f"{inspection.frames}, {inspection.poses} poses{_labels(inspection)}"),
        ("extent", ", ".join(f"{n} {low:.3f} to {high:.3f} m" for n, (low, high) in low_high)),
        ("path", f"{inspection.path_length_m:.3f} m"),
    ]
    facts += _motion_facts(inspection)
    facts += [
        (
            "fit" if rank == 0 else "",
            f"{fit.title}: rotations {fit.rotation_deg:.2f} deg, directions "
            f"{fit.direction_deg:.1f} deg",
        )
        for rank, fit in enumerate(inspection.fits[:_MAX_FITS])
    ]
    return facts


def _labels(inspection: Inspection) -> str:
    times = "timed" if inspection.is_timed else "no timestamps"
    return f", {times}, {'with' if inspection.has_names else 'no'} image names"


def _motion_facts(inspection: Inspection) -> list[tuple[str, str]]:
    facts = []
    if inspection.duration_s is not None and inspection.start_s is not None:
        rate = "" if inspection.rate_hz is None else f" at {inspection.rate_hz:.3g} Hz (median)"
        facts.append(
            ("time", f"{inspection.duration_s:.3f} s{rate}, from {inspection.start_s:.6f} s")
        )
    if (speed := inspection.speed) is not None:
        facts.append(
            (
                "speed",
                f"median {speed.median_m_s:.3f}, 95 % below {speed.p95_m_s:.3f}, "
                f"max {speed.max_m_s:.3f} m/s",
            )
        )
    if (up := inspection.up) is not None:
        held = ", held in portrait" if up.is_portrait else ""
        facts.append(
            (
                "up",
                f"{up.axis}, {up.off_axis_deg:.0f} deg off it, spread {up.spread_deg:.0f} deg"
                f" (a guess, from the camera's up-vector{held})",
            )
        )
    return facts
