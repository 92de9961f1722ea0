"""`vioapr bench`: how long an exported localizer takes on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import progress
from vioapr.cli.streams import OutputFile
from vioapr.cli.tables import Column, Format, Row, Table, show
from vioapr.errors import ParameterError
from vioapr.files.outputs import check_outputs
from vioapr.files.text import write_text
from vioapr.report.formatting import UNKNOWN
from vioapr.runtime.bench import bench
from vioapr.schemas.base import encode
from vioapr.schemas.bench import BenchResult

_SHARES = (
    "share: of the whole, or of the parts' sum where they take longer alone than together; the "
    "parts' shares, with what is between them, make 100 %."
)
_LABELS = {
    "whole": "whole localizer",
    "preprocess": "image to network input",
    "network": "regressor",
    "fusion": "fusion",
    "between": "between the parts",
}


def bench_(
    model: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")],
    threads: int | None = None,
    height: int = 480,
    width: int = 640,
    repeats: int = 100,
    json_out: Annotated[OutputFile | None, tyro.conf.arg(name="json")] = None,
    form: Format = "table",
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
        form: How to print the figures.
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
    show([table_of(found)], form, found, notes_of(found))
    if json_out is not None:
        write_text(json_out, encode(found, indent=1), overwrite=overwrite)


def table_of(found: BenchResult) -> Table:
    """Lay out the durations of the parts, and their shares of the whole, which make 100 %.

    The parts are timed alone, and their medians need not add up to that of the whole: a row says
    what is between, such as passing values from one part to the next.
    """
    title = (
        f"{found.file}: {found.regressor.model} {found.precision}, {found.method}; "
        f"images {found.image_px[1]}x{found.image_px[0]}, {found.threads} threads"
    )
    shares = shares_of(found)
    rows: list[Row] = []
    for name, share in shares.items():
        ms = found.ms.get(name)
        figures = [None] * 3 if ms is None else [ms.p50, ms.p95, ms.p99]
        cells = [UNKNOWN if value is None else f"{value:.2f}" for value in figures]
        names = ("median_ms", "p95_ms", "p99_ms")
        rows.append(
            Row(
                (_LABELS[name], *cells, f"{share} %"),
                {"part": name, **dict(zip(names, figures, strict=True)), "share_percent": share},
            )
        )
    headers = ("median", "p95", "p99", "share")
    columns = (Column("ms a frame", is_figure=False), *map(Column, headers))
    return Table(title, columns, [rows])


def shares_of(found: BenchResult) -> dict[str, int]:
    """Share of each part in the whole, whole percents that add up to 100 over all parts.

    Where the parts alone take longer than the whole, the shares are of their sum.
    """
    shares = {"whole": 100}
    parts = {name: ms.p50 for name, ms in found.ms.items() if name != "whole"}
    if not parts:
        return shares
    rest = found.ms["whole"].p50 - sum(parts.values())
    if rest > 0:
        parts["between"] = rest
    total = sum(parts.values())
    exact = {name: 100 * value / total for name, value in parts.items()}
    floors = {name: int(value) for name, value in exact.items()}
    # What rounding down leaves goes to those that lost most by it.
    by_loss = sorted(exact, key=lambda name: floors[name] - exact[name])
    for name in by_loss[: 100 - sum(floors.values())]:
        floors[name] += 1
    return shares | floors


def notes_of(found: BenchResult) -> list[str]:
    """Size, memory, energy and machine, and why figures are missing."""
    memory, energy = found.memory_mb, found.energy_j
    facts = [
        f"file {found.file_mb:.1f} MB",
        f"memory {'unknown' if memory is None else f'{memory:.0f} MB'}",
        "energy "
        + ("not exposed by this machine" if energy is None else f"{1e3 * energy:.1f} mJ a frame"),
        found.machine,
    ]
    shares = [_SHARES] if len(found.ms) > 1 else []
    return ["; ".join(facts), *shares, *([found.note] if found.note else [])]
