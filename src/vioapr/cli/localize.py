"""`vioapr localize`: a recorded walk through an exported localizer."""

from __future__ import annotations

import shlex
import sys
from collections import Counter
from dataclasses import replace
from datetime import date
from pathlib import Path

from vioapr.cli.console import console, progress
from vioapr.cli.evaluate import print_tables
from vioapr.errors import ParameterError
from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import count_ticks
from vioapr.evaluation.tables import COMPARED, Group, compare_methods
from vioapr.formats.registry import read_trajectory
from vioapr.fusion.fused_walk import write_fused_csv
from vioapr.fusion.methods import default_params
from vioapr.fusion.types import Status
from vioapr.report.evaluation_report import count_report_ticks, write_report
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.runtime.walk import (
    LocalizedWalk,
    WalkFrames,
    frames_of_images,
    frames_of_recording,
    localize,
)


def localize_(
    model: Path,
    out: Path,
    recording: Path | None = None,
    images: str | None = None,
    vio: Path | None = None,
    gt: Path | None = None,
    report: Path | None = None,
    threads: int | None = None,
    view: bool = False,
    rrd: Path | None = None,
) -> None:
    """Localize a recorded walk from its images and the tracker's poses, as a phone would.

    Needs onnxruntime only (pip install 'vioapr[runtime]'). The poses are those known when each
    frame arrived.

    Args:
        model: What `vioapr export` wrote.
        out: CSV to write, a row a frame, as `vioapr fuse` does.
        recording: Folder of a recording; its scene's ground truth is used, if there is any.
        images: Instead of a recording: images of one folder, as a pattern in quotes.
        vio: With --images: the tracker's poses, vio_from_cam, in any trajectory format.
        gt: Ground truth, world_from_cam, in any trajectory format.
        report: Folder to write an HTML page with tables and figures to; needs ground truth.
        threads: For every operator of the network; by default, all cores.
        view: Show the walk in a browser while it runs (pip install 'vioapr[viser]').
        rrd: Rerun file to write (pip install 'vioapr[rerun]').
    """
    frames = _open(recording, images, vio, gt)
    if report is not None and frames.gt is None:
        raise ParameterError("--report needs ground truth: give --gt FILE")
    localizer = OnnxLocalizer(model, threads=threads)
    watchers = _watchers(frames, view, rrd)
    with progress("localizing", len(frames)) as tick:

        def step(located) -> None:
            for watch in watchers:
                watch.add(located)
            tick()

        walk = localize(localizer, frames, step)
    fused = walk.fused
    write_fused_csv(out, fused)
    counts = Counter(Status(status).label for status in fused.status.tolist())
    what = ", ".join(f"{count} {label}" for label, count in counts.items())
    console.print(f"{out}: {len(fused)} frames: {what}", soft_wrap=True, markup=False)
    if frames.gt is not None:
        groups = _compare(walk, localizer, model)
        print_tables(groups)
        if report is not None:
            _publish(groups, report, localizer)
    for watch in watchers:
        watch.finish()


def _open(
    recording: Path | None, images: str | None, vio: Path | None, gt: Path | None
) -> WalkFrames:
    if (recording is None) == (images is None):
        raise ParameterError("expected either --recording DIR or --images GLOB --vio FILE")
    if images is not None and vio is None:
        raise ParameterError("--images needs the tracker's poses: give --vio FILE")
    if recording is not None and vio is not None:
        raise ParameterError("--vio goes with --images: a recording has poses of its own")
    if recording is not None:
        frames = frames_of_recording(recording)
    else:
        assert images is not None
        assert vio is not None
        frames = frames_of_images(images, vio)
    return frames if gt is None else replace(frames, gt=read_trajectory(gt))


def _watchers(frames: WalkFrames, view: bool, rrd: Path | None) -> list:
    from vioapr.runtime import viewing

    watchers: list = []
    if view:
        watchers.append(viewing.BrowserView(frames, lambda text: console.print(text, markup=False)))
    if rrd is not None:
        watchers.append(viewing.RerunFile(frames, rrd))
    return watchers


def _compare(walk: LocalizedWalk, localizer: OnnxLocalizer, model: Path) -> list[Group]:
    """The file's answers beside those of other methods on the same predictions."""
    assert walk.frames.gt is not None
    gt = walk.gt_world_from_cam(walk.frames.gt)
    regressor = localizer.contract.regressor.model or "regressor"
    case = Case(model.name, walk.frames.name, "tracker", regressor, walk.paired, gt)
    own = localizer.contract.method
    assert own is not None
    others = [name for name in COMPARED if name != own]
    with progress("fusing by other methods", count_ticks([case], others)) as tick:
        return compare_methods(case, own, walk.fused, tick=tick)


def _publish(groups: list[Group], folder: Path, localizer: OnnxLocalizer) -> None:
    own = localizer.contract.method
    methods = dict.fromkeys(result.method for result in groups[0].results)
    with progress("drawing figures", count_report_ticks(groups)) as tick:
        page = write_report(
            groups,
            folder,
            title=f"Localized from images by one file ({own})",
            command=shlex.join(["vioapr", *sys.argv[1:]]),
            params_of_method=default_params(methods),
            view="live",
            date=date.today().isoformat(),
            tick=tick,
        )
    console.print(f"report: {page.resolve()}", soft_wrap=True, markup=False)
