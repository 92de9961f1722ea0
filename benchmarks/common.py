"""What the benchmarks share: the machine's name, fair timing, and results as JSON."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import shlex
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from vioapr.runtime.machine import cpu_model

RESULTS = Path(__file__).parents[1] / "docs" / "results"
"""Where tables go, one page a subject."""


def data_folder() -> Path:
    """The folder of real data; leaves the program where VIOAPR_DATA does not say it."""
    data = os.environ.get("VIOAPR_DATA")
    if not data:
        sys.exit("set VIOAPR_DATA to the folder of real data")
    return Path(data)


def describe_machine(packages: Sequence[str]) -> dict[str, str]:
    """Processor, system and the versions that the figures depend on."""
    versions = {name: _version(name) for name in packages}
    return {
        "cpu": cpu_model(),
        "cores": str(os.cpu_count()),
        "platform": platform.platform(),
        "python": platform.python_version(),
        **versions,
    }


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def time_interleaved(jobs: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, list[float]]:
    """Seconds of every job, run in turns (A B A B) so that a slow spell hits all alike.

    Every job runs once more at the start, which does not count.
    """
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for repeat in range(repeats + 1):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            if repeat > 0:
                seconds[name].append(time.perf_counter() - start)
    return seconds


def summarize_us(seconds: Sequence[float], frames: int) -> dict[str, float]:
    """Median, fastest and slowest repeat, as microseconds a frame."""
    per_frame = [1e6 * value / frames for value in seconds]
    return {
        "median_us": statistics.median(per_frame),
        "min_us": min(per_frame),
        "max_us": max(per_frame),
    }


def write_json(path: Path, results: Mapping[str, Any]) -> None:
    """Write results, readable by people too."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")


def replace_section(path: Path, name: str, text: str, settings: str = "") -> None:
    """Put a table between the markers `<!-- begin NAME -->` and `<!-- end NAME -->` of a file.

    Above it stands when, where and how it was measured.

    Args:
        path: One of docs/results/.
        name: The section's.
        text: Markdown, ending in a newline.
        settings: What cannot be seen from the command line.
    """
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->\n"
    whole = path.read_text(encoding="utf-8")
    head, tail = whole.split(begin)[0], whole.split(end)[1]
    path.write_text(head + begin + stamp(settings) + "\n" + text + end + tail, encoding="utf-8")


def publish(table: Table, page: str, section: str, *, update_docs: bool) -> None:
    """Print a table and, if asked to, put it into its section of a page of results.

    Args:
        table: Its title says what was measured, and goes above it.
        page: Name of a file in docs/results/.
        section: The section's name.
        update_docs: Whether to write.
    """
    Console(width=120).print(table)
    if update_docs:
        replace_section(RESULTS / page, section, to_markdown(table))


def to_markdown(table: Table) -> str:
    """A rich table as Markdown, its title above it."""
    plain = [[str(cell) for cell in (column.header, *column.cells)] for column in table.columns]
    rows = [f"| {' | '.join(cells)} |" for cells in zip(*plain, strict=True)]
    rule = "|" + "---|" * len(table.columns)
    title = [f"{table.title}:", ""] if table.title else []
    return "\n".join([*title, rows[0], rule, *rows[1:]]) + "\n"


def stamp(settings: str = "") -> str:
    """When, where and how: date, processor, versions, and the command without its folders."""
    machine = describe_machine(("numpy", "vioapr"))
    words = [word if "/" not in word else word.rsplit("/", 1)[-1] for word in sys.argv[1:]]
    command = shlex.join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *words])
    parts = [
        f"{date.today().isoformat()}, {machine['cpu']}, {machine['cores']} cores",
        f"Python {machine['python']}, NumPy {machine['numpy']}, vioapr {machine['vioapr']}",
        f"`{command}`",
        *([settings] if settings else []),
    ]
    return f"*{'; '.join(parts)}*\n"
