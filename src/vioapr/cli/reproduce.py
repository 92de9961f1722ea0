"""`vioapr reproduce`: published results, from a published data set, in one command."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.box import SIMPLE_HEAD
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from vioapr.cli.console import console, error_console, progress, say
from vioapr.cli.flags import split_names
from vioapr.cli.torch_extra import require_torch
from vioapr.recipes.datasets import DATA_SETS
from vioapr.recipes.paper import MODELS, changed
from vioapr.recipes.report import Report, write_report
from vioapr.recipes.reproduce import Request, reproduce
from vioapr.recipes.trainings import TRAININGS_FOLDER


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
    weights_ms_transformer: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Pretrained weights of EfficientNet-B0, with torchvision's names."""


_Options = tyro.conf.OmitArgPrefixes[Options]


def reproduce_marvin(data: Path, out: Path, options: _Options = Options()) -> None:
    """The paper's Tables 2-5 on MARViN, ours beside the printed figures.

    Imports the data set, trains PoseNet for every scene and MS-Transformer for all scenes
    outdoors and all indoors, predicts the test recordings, fuses. Stopped, it goes on where it
    was. The tables also go to OUT/reproduction.md and .json.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        options: What may be otherwise.

    Example:
        vioapr reproduce marvin --data MARViN --out out
    """
    _reproduce("marvin", data, out, options)


def reproduce_7scenes(data: Path, out: Path, options: _Options = Options()) -> None:
    """Raw medians on 7-Scenes beside published ones.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        options: What may be otherwise.

    Example:
        vioapr reproduce 7scenes --data 7scenes --out out --scenes chess
    """
    _reproduce("7scenes", data, out, options)


def reproduce_cambridge(data: Path, out: Path, options: _Options = Options()) -> None:
    """Raw medians on Cambridge Landmarks beside published ones.

    Args:
        data: Folder that holds the scenes' folders.
        out: Folder for everything that is made.
        options: What may be otherwise.

    Example:
        vioapr reproduce cambridge --data Cambridge --out out
    """
    _reproduce("cambridge", data, out, options)


def _reproduce(name: str, data: Path, out: Path, options: Options) -> None:
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
    report = reproduce(
        request, progress, lambda text: error_console.print(Text(text), soft_wrap=True)
    )
    print_report(report)
    for path in write_report(report, out):
        say(f"written: {path}")
    if DATA_SETS[name].has_tracker:
        say(f"figures: vioapr evaluate {out / TRAININGS_FOLDER} --report {out / 'report'}")


def print_report(report: Report) -> None:
    """Print differences first, as nobody may miss them; then notes and tables."""
    if report.content.differences:
        listed = Text("\n".join(f"- {text}" for text in report.content.differences))
        console.print(Panel(listed, title=report.warning, border_style="yellow"))
    for note in report.content.notes:
        say(note)
    for table in report.tables:
        drawn = Table(title=table.title, title_justify="left", box=SIMPLE_HEAD, show_edge=False)
        for header in table.header:
            justify = "left" if header in ("frames", "scene") else "right"
            # A figure that is cut off would be another figure.
            drawn.add_column(header, justify=justify, overflow="fold")
        for section in table.sections:
            for row in section:
                drawn.add_row(*row)
            drawn.add_section()
        console.print(drawn)
