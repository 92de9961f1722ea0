"""`vioapr scene check` and `vioapr scene info`: what is in a scene, and whether it is whole."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.table import Table
from rich.text import Text

from vioapr.cli.console import console, progress
from vioapr.errors import VioAprError
from vioapr.files.text import write_bytes, write_text
from vioapr.report.figures.speed import speed_bins, speed_figure
from vioapr.report.style import render
from vioapr.scene.check import check_scene, count_frames
from vioapr.scene.scene import SPLITS, Scene
from vioapr.scene.summary import RecordingSummary, SceneSummary, summarize_scene
from vioapr.schemas.base import to_plain

_BAR_WIDTH = 40
_MAX_NAMED = 3


def scene_check(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    decode: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Verify a scene: every file, every line, every image; exit code 2 if anything is wrong.

    Args:
        folder: The scene.
        decode: Decode every image whole: slow, and finds damage within an image too. Without
            it, missing, truncated and foreign images are found by their head and end.

    Raises:
        VioAprError: There are problems; they have been printed.
    """
    total = count_frames(folder) if folder.is_dir() else 0
    with progress(f"checking {folder.name}", total) as tick:
        report = check_scene(folder, decode=decode, tick=tick)
    for problem in report.problems:
        prefix, style = ("", "red") if problem.is_error else ("note: ", "")
        console.print(Text(f"{prefix}{problem}", style=style), soft_wrap=True)
    counts = f"{report.recordings} recordings, {report.frames} frames, {report.images} images"
    if report.errors:
        raise VioAprError(f"{folder}: {len(report.errors)} problems in {counts}")
    console.print(Text(f"{folder}: {counts}: nothing is wrong", style="green"), soft_wrap=True)


def scene_info(
    folders: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[SCENE ...]")
    ],
    figure: Path | None = None,
    json_out: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Print what scenes hold: the paper's Table 1, their recordings, and walking speeds.

    Args:
        folders: Scenes.
        figure: Histograms of speeds to write, outdoor and indoor scenes apart: .png or .svg.
        json_out: JSON to write, with all figures of all recordings.

    Raises:
        VioAprError: A scene cannot be read.
    """
    if not folders:
        raise VioAprError("nothing to look at: name at least one scene's folder")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg"):
        raise VioAprError(f"--figure: expected a name ending in .png or .svg, got {figure}")
    summaries = []
    for folder in folders:
        scene = Scene.open(folder)
        with progress(f"reading {folder.name}", count_frames(folder)) as tick:
            summaries.append(summarize_scene(scene, tick))
    _print_table(summaries)
    for summary in summaries:
        _print_recordings(summary)
        _print_speeds(summary)
    console.print(
        "tracked: share of frames with a tracker's pose. s: duration, ~ where it is counted from "
        "a frame rate. m: way walked. m/s: median speed. Speeds are of recordings in a split.",
        soft_wrap=True,
    )
    if figure is not None:
        png, svg = render(speed_figure(_panels(summaries)))
        write_bytes(figure, svg if figure.suffix.lower() == ".svg" else png)
        console.print(f"{figure}: walking speeds", soft_wrap=True)
    if json_out is not None:
        records = [to_plain(summary.to_record()) for summary in summaries]
        write_text(json_out, json.dumps(records, indent=1) + "\n")


def _print_table(summaries: Sequence[SceneSummary]) -> None:
    table = Table(title="Scenes (the paper's Table 1)", title_justify="left")
    table.add_column("")
    table.add_column("scene")
    for header in ("train images", "test images", "recordings", "extent (m)"):
        table.add_column(header, justify="right")
    for summary in sorted(summaries, key=lambda s: not s.is_outdoor):
        table.add_row(
            "outdoor" if summary.is_outdoor else "indoor",
            Text(summary.name),
            *(str(summary.images(split)) for split in SPLITS),
            str(len(summary.recordings)),
            _extent(summary),
        )
    console.print(table)


def _extent(summary: SceneSummary) -> str:
    """Width x depth x height of where the cameras were."""
    extent = summary.extent_m
    if extent is None:
        return "not known"
    size, of = extent
    text = " x ".join(f"{value:.1f}" for value in size)
    return text if of == "gt" else f"{text} (one tracker's)"


def _print_recordings(summary: SceneSummary) -> None:
    table = Table(title=Text(summary.name), title_justify="left")
    for header in ("recording", "split", "device"):
        table.add_column(header, overflow="fold")
    for header in ("frames", "images", "tracked", "resets", "ground truth", "s", "m", "m/s"):
        table.add_column(header, justify="right", no_wrap=True)
    for recording in summary.recordings:
        table.add_row(*map(Text, _row(recording)))
    console.print(table)
    for recording in summary.recordings:
        if recording.problem:
            text = f"WARNING {recording.id}: {recording.problem}"
            console.print(Text(text, style="yellow"), soft_wrap=True)


def _row(recording: RecordingSummary) -> list[str]:
    lost = recording.tracking.get("lost", 0)
    share = (recording.frames - lost) / max(recording.frames, 1)
    has_speed = len(recording.speeds_m_s) > 0
    return [
        recording.id,
        recording.split or "none",
        recording.device,
        str(recording.frames),
        str(recording.images),
        f"{share:.0%}",
        str(recording.tracking.get("reset", 0)),
        f"{recording.gt_frames / max(recording.frames, 1):.0%}",
        f"{'' if recording.is_timed else '~'}{recording.duration_s:.0f}",
        f"{recording.path_m:.0f}" if has_speed else "-",
        f"{np.median(recording.speeds_m_s):.2f}" if has_speed else "-",
    ]


def _print_speeds(summary: SceneSummary) -> None:
    """A histogram in the terminal."""
    speeds = summary.speeds_m_s
    if not len(speeds):
        return
    edges = speed_bins(speeds)
    counts, _ = np.histogram(np.minimum(speeds, edges[-1] - 1e-9), edges)
    table = Table(title=Text(f"{summary.name}: walking speed over 1 s"), title_justify="left",
                  box=None, show_header=False)  # fmt: skip
    for low, count in zip(edges, counts, strict=False):
        bar = "█" * round(_BAR_WIDTH * count / counts.max())
        table.add_row(f"{low:.1f} m/s", Text(bar, style="blue"), f"{count / len(speeds):.0%}")
    console.print(table)


def _panels(summaries: Sequence[SceneSummary]) -> dict[str, dict[str, Any]]:
    """Speeds by split, of outdoor and of indoor scenes."""
    panels = {}
    for title, is_outdoor in (("Outdoor", True), ("Indoor", False)):
        chosen = [summary for summary in summaries if summary.is_outdoor == is_outdoor]
        if chosen:
            names = ", ".join(summary.name for summary in chosen[:_MAX_NAMED])
            names = names if len(chosen) <= _MAX_NAMED else f"{len(chosen)} scenes"
            panels[f"{title}: {names}"] = {
                split: np.concatenate(
                    [np.zeros(0)]
                    + [r.speeds_m_s for s in chosen for r in s.recordings if r.split == split]
                )
                for split in SPLITS
            }
    return panels
