"""A calibration from walks, and each walk judged with what the others say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date

import numpy as np
from msgspec.structs import asdict

import vioapr
from vioapr.errors import ParameterError
from vioapr.evaluation.calibration.choice import (
    UNCALIBRATED,
    Choice,
    choose_settings,
    learned,
)
from vioapr.evaluation.calibration.regressor import measure_regressor
from vioapr.evaluation.calibration.sigmas import coverage_of, to_coverage
from vioapr.evaluation.calibration.thinning import thin
from vioapr.evaluation.calibration.tracker import walked_m
from vioapr.evaluation.calibration.trials import Trial, Trials, mean_ratios
from vioapr.evaluation.cases import Case
from vioapr.schemas.calibration import (
    Calibration,
    ChainSetting,
    LeftOut,
    MadeFrom,
    PairCalibration,
    Ratios,
)
from vioapr.work.progress import Progress, silent

_LEAST_FRAMES = 10
_MOST_LOSS = 0.02
"""As a logarithm, of errors on walks left out by a calibration that is still taken."""


def calibrate(cases: Sequence[Case], *, progress: Progress = silent) -> Calibration:
    """Find what walks with ground truth say of their trackers and regressors.

    Args:
        cases: From `load_cases`; every kind of tracker is calibrated with every regressor that
            shares walks with it.
        progress: See `vioapr.work.progress`.

    Raises:
        ParameterError: There are no cases, or the walks of a pair are too short.
    """
    if not cases:
        raise ParameterError("walks: expected at least one walk with ground truth, got none")
    cases = [thin(case) for case in cases]
    trials = Trials(progress)
    pairs = [calibrate_pair(of_pair, trials) for of_pair in group_by_pair(cases).values()]
    return Calibration(
        made_by=f"vioapr {vioapr.__version__}", date=date.today().isoformat(), pairs=tuple(pairs)
    )


def group_by_pair(cases: Sequence[Case]) -> Mapping[tuple[str, str], list[Case]]:
    """Cases by kind of tracker and regressor, in their order."""
    grouped: dict[tuple[str, str], list[Case]] = {}
    for case in cases:
        grouped.setdefault(case.group[1:], []).append(case)
    return grouped


def calibrate_pair(cases: Sequence[Case], trials: Trials) -> PairCalibration:
    """Calibrate one tracker with one regressor.

    Raises:
        ParameterError: The walks are too short, or have too few predictions.
    """
    _, tracker, regressor = cases[0].group
    counts = [int((c.has_gt & c.frames.inputs.has_apr).sum()) for c in cases]
    if max(counts) < _LEAST_FRAMES:
        raise ParameterError(
            f"walks: expected one with at least {_LEAST_FRAMES} frames that have both a prediction "
            f"of {regressor!r} and ground truth, got {max(counts)}"
        )
    cases = [case for case, n in zip(cases, counts, strict=True) if n >= _LEAST_FRAMES]
    walks = by_walk(cases)
    folds = [[c for c in cases if walk_of(c) != name] for name in walks] if len(walks) > 1 else []
    choices = choose_settings([cases, *folds], trials)
    left_out = None
    if folds:
        held = list(walks.values())
        left_out = judge_left_out(held, choices[1:], trials)
        if loss_by(left_out) > _MOST_LOSS:  # what walks say of each other is worse than nothing
            parts = zip([cases, *folds], choices, strict=True)
            choices = [learned(part, choice, trials) for part, choice in parts]
            left_out = judge_left_out(held, choices[1:], trials)
    whole = choices[0]
    return PairCalibration(
        tracker=tracker,
        regressor=regressor,
        made_from=describe_walks(walks),
        setting=whole.setting,
        disagreement=whole.disagreement,
        drift=whole.drift,
        errors=measure_regressor(cases),
        left_out=left_out,
    )


def loss_by(left_out: LeftOut) -> float:
    """Logarithm of calibrated over uncalibrated errors, a mean of the four figures."""
    own, other = (
        np.log(np.maximum(list(asdict(ratios).values()), 1e-12))
        for ratios in (left_out.calibrated, left_out.uncalibrated)
    )
    return float(np.mean(own - other))


def walk_of(case: Case) -> str:
    """The walk's name within all sets; draws of a simulated tracker share it."""
    return f"{case.set_name}/{case.walk}"


def by_walk(cases: Sequence[Case]) -> dict[str, list[Case]]:
    """Cases by walk, in their order."""
    grouped: dict[str, list[Case]] = {}
    for case in cases:
        grouped.setdefault(walk_of(case), []).append(case)
    return grouped


def describe_walks(walks: Mapping[str, Sequence[Case]]) -> MadeFrom:
    """Sum walks up, each once."""
    firsts = [cases[0] for cases in walks.values()]
    return MadeFrom(
        walks=tuple(walks),
        metres=sum(walked_m(case.gt_world_from_cam.at(case.has_gt)) for case in firsts),
        seconds=sum(float(np.ptp(case.frames.timestamp_s[case.has_gt])) for case in firsts),
        frames=sum(int(case.has_gt.sum()) for case in firsts),
    )


def judge_left_out(
    held: Sequence[Sequence[Case]], choices: Sequence[Choice], trials: Trials
) -> LeftOut:
    """Judge groups of cases, each with what others say.

    Args:
        held: The groups.
        choices: What the others say, for each.
        trials: Where to run them.
    """
    plain = [_without_sigmas(choice.setting) for choice in choices]
    pairs = zip(held, plain, strict=True)
    wanted = [(case, setting) for cases, own in pairs for case in cases for setting in
              (own, UNCALIBRATED)]  # fmt: skip
    trials.run("walks left out", wanted)
    calibrated: list[Trial] = []
    uncalibrated: list[Trial] = []
    for cases, setting, choice in zip(held, plain, choices, strict=True):
        factors = choice.setting.sigma_position_factor, choice.setting.sigma_orientation_factor
        for case in cases:
            trial = trials.of(case, setting)
            in_sigmas = trial.in_sigmas / np.array(factors)[:, None]
            calibrated.append(trial._replace(in_sigmas=in_sigmas))
            uncalibrated.append(trials.of(case, UNCALIBRATED))
    return LeftOut(
        walks=len(held),
        calibrated=_ratios(calibrated),
        uncalibrated=_ratios(uncalibrated),
        position=to_coverage(coverage_of([t.in_sigmas[0] for t in calibrated])),
        orientation=to_coverage(coverage_of([t.in_sigmas[1] for t in calibrated])),
    )


def _without_sigmas(setting: ChainSetting) -> ChainSetting:
    return ChainSetting(
        gravity=setting.gravity,
        tilt_drift_rad2_per_m=setting.tilt_drift_rad2_per_m,
        heading_drift_rad2_per_m=setting.heading_drift_rad2_per_m,
        position_drift_m2_per_m=setting.position_drift_m2_per_m,
        scale_error=setting.scale_error,
    )


def _ratios(trials: Sequence[Trial]) -> Ratios:
    median_m, median_deg, p95_m, p95_deg = mean_ratios(trials).tolist()
    return Ratios(median_m, median_deg, p95_m, p95_deg)
