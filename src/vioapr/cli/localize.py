"""`vioapr localize`: a recorded walk through an exported localizer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast

import tyro

from vioapr.cli.calibrated import pick_pair, require_chain, warn_of_misfit
from vioapr.cli.console import progress, say, warn, warn_of_tracks
from vioapr.cli.evaluate import check_report, print_tables, publish
from vioapr.cli.streams import InputFile, OutputFile
from vioapr.cli.tracks import read_track
from vioapr.errors import FormatError, ParameterError
from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import count_ticks
from vioapr.evaluation.tables import COMPARED, compare_methods
from vioapr.files.outputs import check_outputs
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.body_from_cam import (
    AUTO,
    describe_mount,
    describe_transform,
    read_body_from_cam,
)
from vioapr.fusion.calibrated import params_from_calibration, read_calibration
from vioapr.fusion.chain.method import METHOD as CHAIN
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.fused_walk import FusedWalk, write_fused_csv
from vioapr.fusion.methods import default_params
from vioapr.fusion.offline import fuse_walk
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import ImportOptions
from vioapr.plurals import count_of
from vioapr.report.formatting import format_statuses
from vioapr.runtime import viewing
from vioapr.runtime.localizer import Located, OnnxLocalizer
from vioapr.runtime.walk import (
    LocalizedWalk,
    WalkFrames,
    frames_of_images,
    frames_of_recording,
    localize,
)
from vioapr.runtime.walk_checks import check_camera, check_localized, estimate_mount, mount_frames
from vioapr.schemas.calibration import PairCalibration
from vioapr.schemas.contract import Contract
from vioapr.trajectory import Trajectory
from vioapr.work.results import replacing_output


def localize_(
    model: Path,
    out: OutputFile,
    recording: Path | None = None,
    images: str | None = None,
    vio: InputFile | None = None,
    gt: InputFile | None = None,
    vio_format: str | None = None,
    gt_format: str | None = None,
    vio_from_cam: Annotated[str | None, tyro.conf.arg(metavar="auto|FILE")] = None,
    time_unit: TimeUnit | None = None,
    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    calibration: Path | None = None,
    predictions: OutputFile | None = None,
    report: Path | None = None,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    threads: int | None = None,
    view: bool = False,
    rrd: Path | None = None,
) -> None:
    r"""Localize a recorded walk from its images and the tracker's poses, as a phone would.

    Needs onnxruntime only (pip install 'vioapr[runtime]'). The poses are those known when each
    frame arrived.

    Args:
        model: What `vioapr export` wrote.
        out: CSV to write, a row a frame, as `vioapr fuse` does.
        recording: Folder of a recording; its scene's ground truth is used, if there is any.
        images: Instead of a recording: a folder of images, or a pattern of their names in
            quotes.
        vio: With --images: the tracker's poses, vio_from_cam, in any trajectory format.
        gt: Ground truth, world_from_cam, in any trajectory format.
        vio_format: Format of the tracker's poses, if it is not recognized.
        gt_format: Format of the ground truth, if it is not recognized.
        vio_from_cam: For a tracker that gives poses of an IMU's body: how the camera is mounted on
            it. auto estimates it by the file's predictions of up to 300 frames; FILE holds the
            constant transform body_from_cam, see `vioapr fuse --help`.
        time_unit: Unit of the times of --vio and --gt; by default found from their values.
        strict: Refuse what is otherwise localized with a warning, and write nothing.
        calibration: What `vioapr calibrate` found, in place of the one that a file with method
            chain carries: its predictions are fused by the same method with this. What --view and
            --rrd show are the file's own answers.
        predictions: TUM file to write too, with the raw predictions, world_from_cam.
        report: Folder to write an HTML page with tables and figures to; needs ground truth;
            an earlier report in it is replaced, other files stay.
        overwrite: Replace files that exist, also those that vioapr did not write; never one that is
            read.
        threads: For every operator of the network; by default, all cores.
        view: Show the walk in a browser while it runs (pip install 'vioapr[viser]').
        rrd: Rerun file to write (pip install 'vioapr[rerun]').

    Example:
        vioapr localize --model courtyard.onnx --out fused.csv \
            --recording courtyard/recordings/test-01
    """
    if threads is not None and threads < 1:
        raise ParameterError(f"threads: expected at least 1, got {threads}")
    options = ImportOptions(poses=vio, poses_format=vio_format, time_unit=time_unit, strict=strict)
    frames = _read_frames(recording, images, options)
    if gt is not None:
        read_options = ReadOptions(time_unit=time_unit, strict=strict)
        frames = replace(frames, gt=read_track(gt, gt_format, read_options, "gt_format"))
    if report is not None and frames.gt is None:
        raise ParameterError("`report` needs ground truth: give `gt`")
    read = [model, vio, gt, calibration, *frames.files]
    if vio_from_cam not in (None, AUTO):
        read.append(Path(vio_from_cam))
    check_outputs([out, predictions, rrd], read, overwrite=overwrite)
    check_report(report, overwrite=overwrite)
    if vio_from_cam is not None:
        body_from_cam = _find_mount(vio_from_cam, model, threads, frames)
        if images is None:
            frames = replace(frames, vio_from_cam=frames.vio_from_cam @ body_from_cam)
        else:  # which way is up in the tracker's world is found by the camera's poses
            turned = frames_of_images(images, replace(options, vio_from_cam=body_from_cam))
            frames = replace(turned, gt=frames.gt)
    localizer = OnnxLocalizer(model, threads=threads)
    pair = (
        None if calibration is None else _find_pair(calibration, localizer.contract, strict=strict)
    )
    watchers: list[viewing.BrowserView | viewing.RerunFile] = []
    if rrd is not None:
        watchers.append(viewing.RerunFile(frames, rrd, overwrite=overwrite))
    if view:
        watchers.append(viewing.BrowserView(frames, say))
    with progress("localizing", len(frames)) as tick:

        def step(located: Located) -> None:
            for watch in watchers:
                watch.add(located)
            tick()

        walk = localize(localizer, frames, step)
    given = str(vio or recording or images), str(gt) if gt else ""
    found = check_camera(frames, localizer.contract)
    found += check_localized(walk, *given, is_file=images is not None)
    warn_of_tracks(found, strict=strict)
    fused = walk.fused
    if pair is not None:
        fused = _fuse_as_calibrated(pair, localizer.contract, walk, strict=strict)
    write_fused_csv(out, fused, overwrite=overwrite)
    say(f"{out}: {format_statuses(fused)}")
    if predictions is not None:
        write_predictions(predictions, walk.predictions, overwrite=overwrite)
    if frames.gt is not None:
        compare(walk, fused, localizer, model.name, frames.gt, report, overwrite=overwrite)
    for watch in watchers:
        watch.finish()


def _read_frames(recording: Path | None, images: str | None, options: ImportOptions) -> WalkFrames:
    vio = options.poses
    if recording is not None and images is None:
        if vio is not None:
            raise ParameterError("`vio` goes with `images`: a recording has poses of its own")
        return frames_of_recording(recording)
    if images is None or recording is not None:
        raise ParameterError("expected either `recording` or `images` with `vio`")
    if vio is None:
        raise ParameterError("`images` needs the tracker's poses: give `vio`")
    try:
        frames = frames_of_images(images, options)
    except FormatError as error:  # an import calls the same parameter otherwise
        problem = error.problem.replace("`poses_format`", "`vio_format`")
        raise FormatError(error.path, problem, error.line) from None
    for finding in frames.findings:
        warn(finding.text)
    return frames


def _find_mount(vio_from_cam: str, model: Path, threads: int | None, frames: WalkFrames) -> Rigid3:
    """Read or estimate body_from_cam, and say it."""
    if vio_from_cam != AUTO:
        body_from_cam = read_body_from_cam(Path(vio_from_cam))
        say(f"{frames.name}: {describe_transform(body_from_cam)}")
        return body_from_cam
    some = mount_frames(frames)
    localizer = OnnxLocalizer(model, threads=threads)
    with progress("finding how the camera is mounted", len(some)) as tick:
        found = estimate_mount(localizer, some, lambda _: tick())
    say(f"{frames.name}: {describe_mount(found)}")
    return found.body_from_cam


def _find_pair(path: Path, contract: Contract, *, strict: bool) -> PairCalibration:
    """Read the calibration for a file's regressor."""
    require_chain([contract.method or "none"])
    model = contract.regressor.model.replace(":", "-")
    return pick_pair(read_calibration(path), None, model or None, strict=strict)


def _fuse_as_calibrated(
    pair: PairCalibration, contract: Contract, walk: LocalizedWalk, *, strict: bool
) -> FusedWalk:
    """Fuse a file's predictions by its method with other parameters; warns of a misfit."""
    own = cast("dict[str, Any]", contract.fixed_params)
    known = {name: own[name] for name in ChainParams.__dataclass_fields__ if name in own}
    params = params_from_calibration(pair.setting, ChainParams(**known))
    frames = walk.paired
    fused = fuse_walk(CHAIN, params, frames, view="live")
    warn_of_misfit(pair, frames.inputs, fused.world_from_cam, fused.status, strict=strict)
    return fused


def write_predictions(
    path: Path, predictions: Trajectory | None, *, overwrite: bool = False
) -> None:
    """Write what the regressor said, if it said anything, and say so."""
    if predictions is None:
        say(f"{path}: not written, no frame has a prediction")
        return
    with replacing_output(path, overwrite=overwrite) as partial:
        tum.write(partial, predictions)
    say(f"{path}: {count_of(len(predictions), 'prediction')}")


def compare(
    walk: LocalizedWalk,
    fused: FusedWalk,
    localizer: OnnxLocalizer,
    name: str,
    gt: Trajectory,
    report: Path | None,
    *,
    overwrite: bool = False,
) -> None:
    """Print the file's accuracy beside that of other methods on the same predictions.

    Args:
        walk: Frames and answers.
        fused: The answers as they were written.
        localizer: The file.
        name: Of the file.
        gt: Ground truth, world_from_cam.
        report: Folder to write a page with tables and figures to, or None.
        overwrite: Whether files in it may be replaced that vioapr did not write.
    """
    method = localizer.contract.method
    assert method is not None  # only whole localizers are opened
    regressor = localizer.contract.regressor.model or "regressor"
    gt_poses = walk.gt_world_from_cam(gt)
    case = Case(name, walk.frames.name, "tracker", regressor, walk.paired, gt_poses)
    others = [name for name in COMPARED if name != method]
    with progress("fusing by other methods", count_ticks([case], others)) as tick:
        groups = compare_methods(case, method, fused, tick=tick)
    print_tables(groups)
    if report is not None:
        title = f"Localized from images by one file ({method})"
        params = default_params(dict.fromkeys(result.method for result in groups[0].results))
        publish(
            groups, report, title=title, params_of_method=params, view="live", overwrite=overwrite
        )
