"""`vioapr reproduce`: published results, from a published data set, in one command."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import explain, log, progress, say, send_messages_aside
from vioapr.cli.flags import split_names
from vioapr.cli.tables import Column, Format, Row, Table, show
from vioapr.cli.torch_extra import require_torch
from vioapr.recipes.datasets import DATA_SETS
from vioapr.recipes.paper import MODELS, changed
from vioapr.recipes.report import JSON_FILE, MARKDOWN_FILE, Report, TextTable, write_report
from vioapr.recipes.reproduce import Request, reproduce
from vioapr.recipes.trainings import TRAININGS_FOLDER
from vioapr.work.results import ResultFolder


@dataclass(frozen=True)
class Options:
    """What may be otherwise than published; what is not given is as published."""

    scenes: str = ""
    """Only these scenes, separated by commas."""
    models: str = ",".join(MODELS)
    """Networks to train, separated by commas."""
    epochs: int | None = None
    """Times that every image is seen, of both networks."""
    batch_size: int | None = None
    """Images a step, of both networks."""
    resize: int | None = None
    """Size to which images are resized, pixels."""
    crop: int | None = None
    """Size of the part that the networks see, pixels."""
    lr: float | None = None
    """Learning rate at the start, of both networks."""
    seed: int | None = None
    """Of everything random."""
    weights_posenet: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Pretrained weights of ResNet-34, with torchvision's names."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace a reproduction.md and reproduction.json that were not written here, or were changed
    since."""
    weights_ms_transformer: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Pretrained weights of EfficientNet-B0, with torchvision's names."""


_Options = tyro.conf.OmitArgPrefixes[Options]


def reproduce_marvin(
    data: Path, out: Path, form: Format = "table", options: _Options = Options()
) -> None:
    """The paper's Tables 2-5 on MARViN, ours beside the printed figures.

    Imports the data set, trains PoseNet for every scene and MS-Transformer for all scenes
    outdoors and all indoors, predicts the test recordings, fuses. Stopped, it goes on where it
    was. The tables also go to OUT/reproduction.md and .json.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        form: How to print the tables.
        options: What may be otherwise.

    Example:
        vioapr reproduce marvin --data MARViN --out out
    """
    _reproduce("marvin", data, out, form, options)


def reproduce_7scenes(
    data: Path, out: Path, form: Format = "table", options: _Options = Options()
) -> None:
    """Raw medians on 7-Scenes beside published ones.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        form: How to print the tables.
        options: What may be otherwise.

    Example:
        vioapr reproduce 7scenes --data 7scenes --out out --scenes chess
    """
    _reproduce("7scenes", data, out, form, options)


def reproduce_cambridge(
    data: Path, out: Path, form: Format = "table", options: _Options = Options()
) -> None:
    """Raw medians on Cambridge Landmarks beside published ones.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        form: How to print the tables.
        options: What may be otherwise.

    Example:
        vioapr reproduce cambridge --data Cambridge --out out
    """
    _reproduce("cambridge", data, out, form, options)


def _reproduce(name: str, data: Path, out: Path, form: str, options: Options) -> None:
    require_torch("vioapr reproduce")
    change = partial(
        changed, epochs=options.epochs, batch_size=options.batch_size, resize=options.resize,
        crop=options.crop, lr=options.lr, seed=options.seed,
    )  # fmt: skip
    weights = {
        "posenet": options.weights_posenet,
        "ms-transformer": options.weights_ms_transformer,
    }
    request = Request(
        DATA_SETS[name], data, out, tuple(split_names(options.scenes)),
        tuple(split_names(options.models)), change,
        weights,
    )  # fmt: skip
    results = ResultFolder(out, overwrite=options.overwrite)
    results.check([MARKDOWN_FILE, JSON_FILE])
    report = reproduce(request, progress, log)
    print_report(report, form)
    with results.adding() as new:
        written = write_report(report, new)
    for path in written:
        say(f"written: {out / path.name}")
    if DATA_SETS[name].has_tracker:
        say(f"figures: vioapr evaluate {out / TRAININGS_FOLDER} --report {out / 'report'}")


def print_report(report: Report, form: str = "table") -> None:
    """Print differences first, as nobody may miss them; then notes and tables."""
    if form in ("csv", "json"):
        send_messages_aside()
    if report.content.differences:
        say(f"{report.warning}:", "bold yellow")
        for text in report.content.differences:
            explain(f"- {text}", "yellow")
    for text in report.content.notes:
        explain(text)
    show([layout(table) for table in report.tables], form, report.content)


def layout(table: TextTable) -> Table:
    """Lay out a table of a report; its texts are also what programs get."""
    header = [Column(name, name not in ("frames", "scene")) for name in table.header]
    # Several columns have one header: programs get them numbered.
    names = [
        name if table.header.count(name) == 1 else f"{name} {table.header[: i + 1].count(name)}"
        for i, name in enumerate(table.header)
    ]
    sections: list[list[Row]] = []
    for section in table.sections:
        sections.append([])
        label = section[0][0] if section else ""
        for cells in section:
            values = dict(zip(names, cells, strict=True)) | {names[0]: cells[0] or label}
            sections[-1].append(Row(cells, {"table": table.title, **values}))
    return Table(table.title, tuple(header), sections)
