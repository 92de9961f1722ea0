"""`vioapr calibrate`: what walks with ground truth say of a tracker and a regressor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import progress, say, send_messages_aside, warn
from vioapr.cli.evaluate import refuse, warn_of_skipped
from vioapr.cli.flags import split_names
from vioapr.cli.predict import predict_split
from vioapr.cli.streams import OutputFile
from vioapr.cli.tables import Column, Format, Row, Table, show
from vioapr.errors import ParameterError
from vioapr.evaluation.calibration.calibrate import calibrate as calibrate_cases
from vioapr.evaluation.calibration.sigmas import PROMISED
from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.walk_tracks import WalkReader
from vioapr.files.outputs import check_outputs
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.body_from_cam import AUTO
from vioapr.fusion.calibrated import write_calibration
from vioapr.plurals import count_of
from vioapr.report.formatting import format_error, format_number
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.runtime.walk import frames_of_recording, localize
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import to_plain
from vioapr.schemas.calibration import Calibration, Coverage, PairCalibration, Ratios
from vioapr.trajectory import DEFAULT_TOLERANCE_S

_ENOUGH_WALKS = 2
_COVERAGE_OFF = 0.12
_SCALE_OFF = 0.1
_HOW_TO_READ = (
    "Every walk is judged with what the others say. Errors are those of method chain over the raw "
    "regressor's: median m, deg, p95 m, deg; geometric means over walks. Sigmas: % of frames "
    "within 1 / 2 / 3 of them; "
    f"{' / '.join(f'{100 * share:.0f}' for share in PROMISED)} are promised."
)


def calibrate(
    paths: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="[SCENE|WALKS ...]")
    ],
    out: OutputFile,
    model: Path | None = None,
    split: Annotated[str, tyro.conf.arg(metavar="train|test|all")] = "test",
    trackers: str | None = None,
    regressors: str | None = None,
    form: Format = "table",
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    vio_from_cam: Annotated[str | None, tyro.conf.arg(metavar="auto|FILE")] = None,
    time_unit: TimeUnit | None = None,
    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Measure a tracker and a regressor on walks with ground truth, for method chain to use.

    Found are the tracker's drift and scale, whether it and the map share up, the regressor's
    errors, and the factors that make stated sigmas true. One or two walks of a minute are enough,
    more are better; best are walks through the place where the calibration is used. The file goes
    to `vioapr fuse`, evaluate, localize and export as --calibration.

    Args:
        paths: Folders with walks (gt.*, vio_<name>.*, apr_<name>.*), as `vioapr evaluate` takes
            them; or, with --model, one scene with ground truth.
        out: File to write, e.g. calibration.toml.
        model: A regressor's file, or the folder that `vioapr train` left it in: the scene's images
            are predicted first, as `vioapr predict` does. Or the word map, as there. Or what
            `vioapr export` wrote, to predict without PyTorch.
        split: With --model: which recordings. Errors on those that the regressor was trained with
            are too small.
        trackers: Only these, separated by commas; by default all.
        regressors: Only these, separated by commas; by default all.
        form: How to print the table.
        overwrite: Replace the file if it exists; never one that is read.
        tolerance_s: Largest difference of timestamps within a frame, s.
        vio_from_cam: For trackers that give poses of an IMU's body: how the camera is mounted on
            it; see `vioapr evaluate --help`.
        time_unit: Unit of all files' times; by default found from their values.
        strict: Refuse what is otherwise used or left out with a warning.

    Example:
        vioapr calibrate walks --out calibration.toml
    """
    if form in ("csv", "json"):
        send_messages_aside()
    read = [] if model is None else [model]
    if vio_from_cam not in (None, AUTO):
        read.append(Path(vio_from_cam))
    check_outputs([out], read, overwrite=overwrite)
    if model is not None:
        scene = _open_scene(paths, regressors, split)
    if model is not None and model.suffix == ".onnx":
        cases = predict_cases(scene, model, split)
    else:
        if model is not None:
            done = predict_split(paths[0], model, split)
            paths, regressors = (done.folder,), done.name
        folders = find_walks(paths, refuse if strict else warn_of_skipped)
        files = [path for walk in folders for path in walk.paths]
        check_outputs([out], [*read, *files], overwrite=overwrite)
        reader = WalkReader(
            ReadOptions(time_unit=time_unit, strict=strict), vio_from_cam, say, warn
        )
        skip = None if strict else warn_of_skipped
        with progress("reading walks", len(folders)) as tick:
            cases = load_cases(
                folders, tolerance_s=tolerance_s, reader=reader, skip=skip, tick=tick
            )
    cases = select(cases, trackers, regressors)
    calibration = calibrate_cases(cases, progress=progress)
    report(calibration, form)
    write_calibration(out, calibration)
    say(f"{out}: {count_of(len(calibration.pairs), 'pair')} of a tracker and a regressor")


def report(calibration: Calibration, form: str) -> None:
    """Print how each pair fares on walks left out, what was found, and what is in doubt."""
    pairs = calibration.pairs
    tables, notes = [table_of(pairs)], [_HOW_TO_READ]
    if form == "table" and not any(pair.left_out for pair in pairs):
        tables, notes = [], []
    show(tables, form, calibration, notes)
    for pair in pairs:
        for line in describe(pair):
            say(line)
        for text in doubts(pair):
            warn(f"{pair.tracker} with {pair.regressor}: {text}")


def _open_scene(paths: Sequence[Path], regressors: str | None, split: str) -> Scene:
    """Open the one scene whose images are to be predicted."""
    if len(paths) != 1 or not (paths[0] / SCENE_FILE).is_file():
        raise ParameterError("paths: expected one scene, as `model` predicts its images")
    if regressors is not None:
        raise ParameterError("`regressors` and `model` do not go together: it is the model's")
    if split not in ("train", "test", "all"):
        raise ParameterError(f"split: expected train, test or all, got {split!r}")
    if split != "test":
        warn(
            "recordings that the regressor was trained with are used: it errs less on them than "
            "elsewhere, so give others where you can"
        )
    return Scene.open(paths[0])


def predict_cases(scene: Scene, model: Path, split: str) -> list[Case]:
    """Predict the images of a scene's recordings by an exported file.

    Args:
        scene: Recordings without ground truth are left out.
        model: What `vioapr export` wrote.
        split: Which recordings.

    Raises:
        ParameterError: None of them has ground truth.
        FileError: The model or a recording cannot be read.
    """
    ids = scene.recording_ids if split == "all" else list(scene.splits.get(split, ()))
    known = {id_: gt for id_ in ids if (gt := scene.gt(id_)) is not None}
    if not known:
        raise ParameterError(
            f"{scene.folder}: expected recordings with ground truth in the split {split!r}, found "
            "none: make it with vioapr map"
        )
    localizer = OnnxLocalizer(model)
    regressor = (localizer.contract.regressor.model or "regressor").replace(":", "-")
    walks = {id_: frames_of_recording(scene.recording_folder(id_)) for id_ in known}
    cases: list[Case] = []
    with progress("predicting", sum(map(len, walks.values()))) as tick:
        for id_, frames in walks.items():
            localizer.reset()
            walk = localize(localizer, frames, lambda _: tick())
            tracker = (scene.recording(id_).info.tracker or "vio").lower()
            gt = walk.gt_world_from_cam(known[id_])
            cases.append(Case(scene.name, id_, tracker, regressor, walk.paired, gt))
    return cases


def select(cases: Sequence[Case], trackers: str | None, regressors: str | None) -> list[Case]:
    """Cases of some trackers and regressors.

    Raises:
        ParameterError: None is of one that is named.
    """
    selected = list(cases)
    for flag, names, member in (("trackers", trackers, 1), ("regressors", regressors, 2)):
        if names is None:
            continue
        known = sorted({case.group[member] for case in cases})
        for name in split_names(names):
            if name not in known:
                raise ParameterError(f"{flag}: expected names from {', '.join(known)}, got {name}")
        selected = [case for case in selected if case.group[member] in split_names(names)]
    return selected


def table_of(pairs: Sequence[PairCalibration]) -> Table:
    """Lay out how each pair fares on walks left out."""
    names = ("tracker", "regressor", "walks")
    figures = ("calibrated", "without", "position %", "orientation %")
    columns = (*(Column(name, is_figure=name == "walks") for name in names), *map(Column, figures))
    rows: list[Row] = []
    for pair in pairs:
        walks, left_out = len(pair.made_from.walks), pair.left_out
        cells = (pair.tracker, pair.regressor, str(walks))
        if left_out is None:
            cells += ("-",) * len(figures)
        else:
            cells += tuple(map(_ratios, (left_out.calibrated, left_out.uncalibrated)))
            cells += tuple(map(_shares, (left_out.position, left_out.orientation)))
        values = {"tracker": pair.tracker, "regressor": pair.regressor, "walks": walks}
        plain = to_plain(left_out) if left_out is not None else {}
        for part in ("calibrated", "uncalibrated", "position", "orientation"):
            values |= {f"{part}_{key}": value for key, value in plain.get(part, {}).items()}
        rows.append(Row(cells, values))
    return Table("Walks left out, each judged with what the others say", columns, [rows])


def _ratios(ratios: Ratios) -> str:
    return " ".join(f"{value:.2f}" for value in to_plain(ratios).values())


def _shares(coverage: Coverage) -> str:
    return " / ".join(f"{100 * value:.0f}" for value in to_plain(coverage).values())


def describe(pair: PairCalibration) -> list[str]:
    """Say what was found of a pair, a line each."""
    made, drift, errors, setting = pair.made_from, pair.drift, pair.errors, pair.setting
    ups = "share up" if drift.shares_up else f"differ in up by {drift.tilt_deg:.1f} deg"
    position = "/".join(map(format_error, errors.position_axes_m))
    turn = "/".join(format_error(math.degrees(value)) for value in errors.orientation_axes_rad)
    tilt, heading = (
        format_error(math.degrees(math.sqrt(rate)))
        for rate in (drift.tilt_rad2_per_m, drift.heading_rad2_per_m)
    )
    if setting.position_drift_m2_per_m < 0:
        assumed = "learned while walking"
    else:
        rates = (setting.heading_drift_rad2_per_m, setting.position_drift_m2_per_m)
        turned, moved = (math.sqrt(rate) for rate in rates)
        assumed = f"{format_error(math.degrees(turned))} deg and {format_error(moved)} m per root m"
    return [
        f"{pair.tracker} with {pair.regressor}: {count_of(len(made.walks), 'walk')}, "
        f"{format_number(made.metres, 0)} m, {format_number(made.seconds / 60, 1)} min, "
        f"{made.frames} frames with ground truth",
        f"  the tracker drifts by {tilt} deg of tilt, {heading} deg of heading and "
        f"{format_error(math.sqrt(drift.position_m2_per_m))} m per root metre; a metre of it is "
        f"{drift.scale:.3f} m (+- {drift.scale_spread:.3f}); map and tracker {ups}",
        f"  the regressor errs by {position} m along and {turn} deg about the camera's axes; "
        f"95 % are within {errors.position_tail:.1f} and {errors.orientation_tail:.1f} times the "
        f"median; errors differ after {format_error(errors.view_length_m)} m",
        f"  method chain: gravity {setting.gravity}, drift {assumed}, sigmas times "
        f"{setting.sigma_position_factor:.2f} (position), "
        f"{setting.sigma_orientation_factor:.2f} (orientation)",
    ]


def doubts(pair: PairCalibration) -> list[str]:
    """What makes a calibration less sure, a sentence each, with a remedy."""
    texts: list[str] = []
    if abs(pair.drift.scale - 1) > _SCALE_OFF:
        texts.append(
            f"a metre of the tracker is {pair.drift.scale:.2f} m of ground truth: scale its poses, "
            "or mend the map's scale"
        )
    left_out = pair.left_out
    if left_out is None:
        texts.append(
            "made from one walk, so nothing tells how it does on another: give "
            f"{_ENOUGH_WALKS} or more, of 1 to 5 minutes"
        )
        return texts
    if pair.setting.position_drift_m2_per_m < 0:
        texts.append(
            "drift is learned while walking, as on walks left out that does as well as what the "
            "others say: the walks are unlike each other, so give more of them"
        )
    for name, coverage in (("position", left_out.position), ("orientation", left_out.orientation)):
        shares = list(to_plain(coverage).values())
        if max(abs(a - b) for a, b in zip(shares, PROMISED, strict=True)) > _COVERAGE_OFF:
            texts.append(
                f"on walks left out, sigmas of {name} hold for {_shares(coverage)} % of frames: "
                "give more walks, through the place where it is used"
            )
    return texts
