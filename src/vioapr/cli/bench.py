"""`vioapr bench`: how long an exported localizer takes on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from vioapr.cli.console import console, progress, say
from vioapr.errors import ParameterError
from vioapr.files.outputs import check_outputs
from vioapr.files.text import write_text
from vioapr.runtime.bench import bench
from vioapr.schemas.base import encode
from vioapr.schemas.bench import BenchResult

_LABELS = {
    "whole": "whole localizer",
    "preprocess": "image to network input",
    "network": "regressor",
    "fusion": "fusion",
}


def bench_(
    model: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")],
    threads: int | None = None,
    height: int = 480,
    width: int = 640,
    repeats: int = 100,
    json_out: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Measure an exported localizer: latency by part, memory, size and energy.

    Args:
        model: What `vioapr export` wrote.
        threads: For every operator; by default, all cores.
        height: Of the images, pixels.
        width: Of the images, pixels.
        repeats: How often every part is run, in turns.
        json_out: JSON to write the figures to.
        overwrite: Replace the JSON if it exists; never the file that is measured.

    Example:
        vioapr bench courtyard.onnx --threads 1
    """
    given = {"height": height, "width": width, "repeats": repeats, "threads": threads}
    for name, value in given.items():
        if value is not None and value < 1:
            raise ParameterError(f"{name}: expected at least 1, got {value}")
    check_outputs([json_out], [model], overwrite=overwrite)
    with progress("measuring", repeats) as tick:
        found = bench(model, size=(height, width), repeats=repeats, threads=threads, tick=tick)
    print_figures(found)
    if json_out is not None:
        write_text(json_out, encode(found, indent=1))


def print_figures(found: BenchResult) -> None:
    """Print durations by part as a table, and below it size, memory, energy and machine."""
    title = (
        f"{found.file}: {found.regressor.model} {found.precision}, "
        f"{found.method}; images {found.image_px[1]}x{found.image_px[0]}, "
        f"{found.threads} threads"
    )
    table = Table(title=title, title_justify="left")
    table.add_column("ms a frame")
    for header in ("median", "p95", "p99", "of the whole"):
        table.add_column(header, justify="right")
    whole = found.ms["whole"].p50
    for name, ms in found.ms.items():
        values = (f"{value:.2f}" for value in (ms.p50, ms.p95, ms.p99))
        table.add_row(_LABELS[name], *values, f"{100 * ms.p50 / whole:.0f} %")
    console.print(table)
    memory, energy = found.memory_mb, found.energy_j
    facts = [
        f"file {found.file_mb:.1f} MB",
        f"memory {'unknown' if memory is None else f'{memory:.0f} MB'}",
        "energy "
        + ("not exposed by this machine" if energy is None else f"{1e3 * energy:.1f} mJ a frame"),
        found.machine,
    ]
    say("; ".join(facts))
    if found.note:
        say(found.note)
