"""`vioapr scene check` and `vioapr scene info`: what is in a scene, and whether it is whole."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from vioapr.cli.console import progress, say, warn
from vioapr.cli.streams import OutputFile
from vioapr.cli.tables import Column, Format, Row, Table, Value, show
from vioapr.errors import ParameterError, VioAprError
from vioapr.files.outputs import check_outputs
from vioapr.files.text import write_bytes, write_text
from vioapr.plurals import count_of
from vioapr.report.figures.speed import speed_bins, speed_figure, speed_panels
from vioapr.report.style import render
from vioapr.scene.anonymize import anonymize_recording, count_images
from vioapr.scene.check import check_scene, count_frames
from vioapr.scene.faces import FaceDetector
from vioapr.scene.scene import SPLITS, Scene
from vioapr.scene.summary import SceneSummary, summarize_scene
from vioapr.schemas.base import encode

_BAR_WIDTH = 40
_HOW_TO_READ = (
    "tracked: share of frames with a tracker's pose. s: duration, ~ where it is counted from "
    "a frame rate. m: way walked. m/s: median speed. Speeds are of recordings in a split."
)


def scene_check(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    decode: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Verify a scene: every file, every line, every image; exit code 2 if anything is wrong.

    Args:
        folder: The scene.
        decode: Decode every image whole: slow, and finds damage within an image too. Without
            it, missing, truncated and foreign images are found by their head and end.

    Example:
        vioapr scene check courtyard

    Raises:
        VioAprError: There are problems; they have been printed.
    """
    total = count_frames(folder) if folder.is_dir() else 0
    with progress(f"checking {folder.name}", total) as tick:
        report = check_scene(folder, decode=decode, tick=tick)
    for problem in report.problems:
        prefix, style = ("", "red") if problem.is_error else ("note: ", "")
        say(f"{prefix}{problem}", style)
    counted = ("recording", report.recordings), ("frame", report.frames), ("image", report.images)
    counts = ", ".join(count_of(count, noun) for noun, count in counted)
    if report.errors:
        raise VioAprError(f"{folder}: {count_of(len(report.errors), 'problem')} in {counts}")
    say(f"{folder}: {counts}: nothing is wrong", "green")


def scene_info(
    folders: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[SCENE ...]")
    ],
    figure: Path | None = None,
    json_out: Annotated[OutputFile | None, tyro.conf.arg(name="json")] = None,
    form: Format = "table",
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Print what scenes hold: the paper's Table 1, their recordings, and walking speeds.

    Args:
        folders: The scenes' folders.
        figure: Histograms of speeds to write, outdoor and indoor scenes apart: .png or .svg.
        json_out: JSON to write, with all figures of all recordings.
        form: How to print the tables; csv: those of recordings.
        overwrite: Replace the files to write if they exist; never one that is read.

    Example:
        vioapr scene info courtyard hall --figure speeds.png

    Raises:
        VioAprError: A scene cannot be read.
    """
    if not folders:
        raise ParameterError("folders: expected at least one scene's folder, got none")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg"):
        raise ParameterError(f"figure: expected a name ending in .png or .svg, got {figure}")
    scenes = [Scene.open(folder) for folder in folders]
    inputs = [path for scene in scenes for path in scene.tables()]
    check_outputs([figure, json_out], inputs, overwrite=overwrite)
    summaries = []
    for scene in scenes:
        with progress(f"reading {scene.folder.name}", count_frames(scene.folder)) as tick:
            summaries.append(summarize_scene(scene, tick))
    records = [summary.to_record() for summary in summaries]
    tables = [recordings_table(summary) for summary in summaries]
    if form in ("table", "markdown"):
        speeds = [table for summary in summaries if (table := speeds_table(summary)) is not None]
        tables = [scenes_table(summaries), *tables, *speeds]
    show(tables, form, records, [_HOW_TO_READ])
    for summary in summaries:
        for recording in summary.recordings:
            if recording.problem:
                warn(f"{summary.name}, {recording.id}: {recording.problem}")
    if figure is not None:
        png, svg = render(speed_figure(speed_panels(summaries)))
        content = svg if figure.suffix.lower() == ".svg" else png
        write_bytes(figure, content, overwrite=overwrite)
        say(f"{figure}: walking speeds")
    if json_out is not None:
        write_text(json_out, encode(records, indent=1), overwrite=overwrite)


def scene_anonymize(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    keep_originals: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Blur the faces in all images of a scene, so that it can be shown and passed on.

    Images with faces are replaced; their originals are gone, unless they are to be kept. Stopped,
    it goes on where it was; run again, it looks at new images only. Small, turned or covered faces
    may be missed, and what is behind a person tells who it is, too: look at the images before you
    publish them.

    Args:
        folder: The scene.
        keep_originals: Copy images with faces to SCENE/originals first; keep that folder safe.

    Example:
        vioapr scene anonymize courtyard
    """
    scene = Scene.open(folder)
    anonymize(scene, scene.recording_ids, keep_originals=keep_originals)


def anonymize(scene: Scene, ids: Sequence[str], *, keep_originals: bool = False) -> None:
    """Blur the faces in recordings, and say how many there were.

    Args:
        scene: The scene.
        ids: Of the recordings.
        keep_originals: Copy images with faces first.
    """
    detector = FaceDetector()
    for id_ in ids:
        with progress(f"looking for faces in {id_}", count_images(scene, id_)) as tick:
            done = anonymize_recording(
                scene, id_, detector, keep_originals=keep_originals, tick=tick
            )
        faces = f"{count_of(done.faces, 'face')} in {count_of(done.with_faces, 'image')}"
        say(f"{id_}: {faces} of {done.images} blurred")


def scenes_table(summaries: Sequence[SceneSummary]) -> Table:
    """Lay out a row a scene: the paper's Table 1."""
    rows: list[Row] = []
    for summary in sorted(summaries, key=lambda s: not s.is_outdoor):
        extent = "not known"
        if summary.extent_m is not None:
            size_m, of = summary.extent_m  # width, depth and height of where the cameras were
            extent = " x ".join(f"{value:.1f}" for value in size_m)
            extent += "" if of == "gt" else " (one tracker's)"
        cells = (
            "outdoor" if summary.is_outdoor else "indoor",
            summary.name,
            *(str(summary.images(split)) for split in SPLITS),
            str(len(summary.recordings)),
            extent,
        )
        rows.append(Row(cells, {}))
    headers = ("train images", "test images", "recordings", "extent (m)")
    names = (Column("place", is_figure=False), Column("scene", is_figure=False))
    return Table("Scenes (the paper's Table 1)", (*names, *map(Column, headers)), [rows])


def recordings_table(summary: SceneSummary) -> Table:
    """Lay out a row a recording."""
    rows: list[Row] = []
    for recording in summary.recordings:
        frames = max(recording.frames, 1)
        tracked = (recording.frames - recording.tracking.get("lost", 0)) / frames
        has_speed = len(recording.speeds_m_s) > 0
        speed = float(np.median(recording.speeds_m_s)) if has_speed else None
        cells = (
            recording.id,
            recording.split or "none",
            recording.device,
            str(recording.frames),
            str(recording.images),
            f"{tracked:.0%}",
            str(recording.tracking.get("reset", 0)),
            f"{recording.gt_frames / frames:.0%}",
            f"{'' if recording.is_timed else '~'}{recording.duration_s:.0f}",
            f"{recording.path_m:.0f}" if has_speed else "-",
            "-" if speed is None else f"{speed:.2f}",
        )
        values: dict[str, Value] = {
            "scene": summary.name,
            "recording": recording.id,
            "split": recording.split or "none",
            "device": recording.device,
            "frames": recording.frames,
            "images": recording.images,
            "tracked_share": tracked,
            "resets": recording.tracking.get("reset", 0),
            "gt_share": recording.gt_frames / frames,
            "duration_s": recording.duration_s,
            "is_timed": recording.is_timed,
            "path_m": recording.path_m if has_speed else None,
            "median_speed_m_s": speed,
            "problem": recording.problem,
        }
        rows.append(Row(cells, values))
    headers = ("frames", "images", "tracked", "resets", "ground truth", "s", "m", "m/s")
    names = (Column(header, is_figure=False) for header in ("recording", "split", "device"))
    return Table(summary.name, (*names, *map(Column, headers)), [rows])


def speeds_table(summary: SceneSummary) -> Table | None:
    """Lay out a histogram of walking speeds, if they are known."""
    speeds = summary.speeds_m_s
    if not len(speeds):
        return None
    edges = speed_bins(speeds)
    counts, _ = np.histogram(np.minimum(speeds, edges[-1] - 1e-9), edges)
    rows = [
        Row(
            (
                f"{low:.1f} m/s",
                f"{count / len(speeds):.0%}",
                "█" * round(_BAR_WIDTH * count / counts.max()),
            ),
            {},
        )
        for low, count in zip(edges, counts, strict=False)
    ]
    columns = (Column(""), Column(""), Column("", is_figure=False))
    return Table(f"{summary.name}: walking speed over 1 s", columns, [rows])
