"""How good a regressor is on recordings that it has not learned: predicted, fused, measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vioapr.errors import ParameterError
from vioapr.evaluation.calibration.calibrate import calibrate, loss_by
from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.evaluate import Result, count_ticks
from vioapr.evaluation.tables import Group, tabulate
from vioapr.evaluation.view_coverage import Views, count_support, views_of
from vioapr.files.digests import digest_of
from vioapr.fusion.calibrated import write_calibration
from vioapr.fusion.chain.method import METHOD as CHAIN
from vioapr.fusion.methods import default_params
from vioapr.scene.scene import Scene
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import Record
from vioapr.schemas.build import SupportRecord
from vioapr.schemas.calibration import LeftOut
from vioapr.schemas.regressor import REGRESSOR_FILE
from vioapr.work.progress import Progress

COMPARED = ("apr", "vio", "vio-apr", "chain")
SUPPORT_BOUNDS = (0, 1, 3, 10)
"""Fewest training images from near of each class of test frames."""


def predict_tests(
    scene: Scene, regressor: Path, name: str, folder: Path, progress: Progress
) -> list[str]:
    """Predict the test recordings, and put ground truth and VIO beside.

    Returns:
        Ids of those that can be evaluated.
    """
    from vioapr.regression.prediction import load_predictor, predict_walks

    ids = list(scene.splits.get("test", ()))
    images = sum(int(scene.recording(id_).frames.has_image.sum()) for id_ in ids)
    with progress("predicting test recordings", images) as tick:
        walks = predict_walks(
            load_predictor(regressor), scene, ids, folder, name,
            digest=digest_of(regressor / REGRESSOR_FILE), overwrite=True, tick=tick,
        )  # fmt: skip
        return [walk.id for walk in walks if walk.can_be_evaluated]


def load_tests(folder: Path, ids: Sequence[str], name: str, progress: Progress) -> list[Case]:
    """Read test recordings with their predictions of a name."""
    with progress("reading predictions", len(ids)) as tick:
        cases = load_cases(find_walks([folder / id_ for id_ in ids]), tick=tick)
    return [case for case in cases if case.apr == name]


class Calibrated(Record, frozen=True):
    """What came of calibrating.

    Attributes:
        left_out: How it does on walks left out; None where nothing was calibrated.
        why_not: What kept it from that, or "".
    """

    left_out: LeftOut | None = None
    why_not: str = ""


def calibrate_tests(cases: Sequence[Case], out: Path, progress: Progress) -> Calibrated:
    """Calibrate tracker and regressor, and write it, where two walks or more speak for it."""
    if len({case.walk for case in cases}) < 2:
        return Calibrated(why_not="it takes two test walks or more")
    if len({case.group[1] for case in cases}) > 1:
        return Calibrated(why_not="the test walks are of several trackers")
    try:
        calibration = calibrate(cases, progress=progress)
    except ParameterError as error:  # walks that are too short for it are no fault
        return Calibrated(why_not=str(error).removeprefix("walks: "))
    (pair,) = calibration.pairs
    write_calibration(out, calibration)
    return Calibrated(pair.left_out, "" if pair.left_out else "too few walks are long enough")


def is_worth_it(left_out: LeftOut | None) -> bool:
    """Whether a calibration does better on walks left out than none."""
    return left_out is not None and loss_by(left_out) < 0


def evaluate_tests(cases: Sequence[Case], progress: Progress) -> list[Group]:
    """Compare the raw regressor, VIO, the paper's method and chain, as frames arrive."""
    params = default_params(COMPARED)
    with progress("fusing test recordings", count_ticks(cases, params)) as tick:
        return tabulate(cases, params, view="live", tick=tick).groups


def measure_support(
    groups: Sequence[Group], train: Mapping[str, Views], within_m: float
) -> list[SupportRecord]:
    """Divide test frames by how many training images from near look the same way.

    Args:
        groups: Of `evaluate_tests`.
        train: Of the training recordings.
        within_m: How far near is, see `vioapr.evaluation.view_coverage.count_support`.
    """
    results = [
        one for group in groups for one in group.results if one.method == CHAIN.name
    ]  # fmt: skip
    if not results:
        return []
    counts = [
        count_support([*train.values()], views_of(one.gt_world_from_cam), within_m)
        for one in results
    ]
    support = np.concatenate(counts)
    records: list[SupportRecord] = []
    for k, least in enumerate(SUPPORT_BOUNDS):
        most = SUPPORT_BOUNDS[k + 1] - 1 if k + 1 < len(SUPPORT_BOUNDS) else None
        rows = (support >= least) & (support <= (np.inf if most is None else most))
        records.append(
            SupportRecord(
                least=least,
                most=most,
                frames=int(rows.sum()),
                raw_median_m=_median(results, "raw_errors", "position_m", rows),
                fused_median_m=_median(results, "errors", "position_m", rows),
                raw_median_deg=_median(results, "raw_errors", "orientation_deg", rows),
                fused_median_deg=_median(results, "errors", "orientation_deg", rows),
            )
        )
    return records


def _median(results: Sequence[Result], errors: str, member: str, rows: np.ndarray) -> float | None:
    """The median of an error over some frames of all results; None without any."""
    values = np.concatenate([getattr(getattr(one, errors), member) for one in results])[rows]
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
