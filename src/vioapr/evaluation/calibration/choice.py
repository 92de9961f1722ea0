"""Which setting of method `chain` suits walks: measured drift, times the factors that do best.

What a tracker drifts by over a few metres says little of how it errs over longer ways, and nothing
of how smoothing fares with it. So what was measured is the unit only, and the walks themselves
say how many times of it to assume: first for orientation, with what is known of up, then for
position.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.evaluation.calibration.sigmas import fit_factor
from vioapr.evaluation.calibration.tracker import LEAST_WAY_M, measure_tracker
from vioapr.evaluation.calibration.trials import Trials, figures, log_ratios
from vioapr.evaluation.cases import Case
from vioapr.schemas.calibration import ChainSetting, Disagreement, Gravity, TrackerDrift

FACTORS = (1.0, 10.0, 100.0, 1000.0)
"""Times the measured variances. The largest believe the tracker in nothing."""

_HOPELESS_FACTORS = (100.0, 1000.0)
"""Of a tracker that loses itself, in all that it says."""

_USUAL_FACTOR = 10.0
"""Suits most trackers: less drift has to earn it."""

_DECADE_COSTS = 0.04
"""How much better, as a logarithm, a factor ten times below the usual has to do."""

_UPRIGHT_DEG = 15.0
"""Map and tracker whose ups are further apart do not both know it."""

_STEPS_A_DECADE = 2
_SCALE_LIMITS = (0.003, 0.3)

UNCALIBRATED = ChainSetting(
    gravity="auto",
    tilt_drift_rad2_per_m=-1.0,
    heading_drift_rad2_per_m=-1.0,
    position_drift_m2_per_m=-1.0,
    scale_error=0.01,
)
"""With nothing given."""


class Choice(NamedTuple):
    """What was found.

    Attributes:
        drift: Of the tracker, as measured.
        setting: The best.
        disagreement: Of predictions and answers under it.
    """

    drift: TrackerDrift
    setting: ChainSetting
    disagreement: Disagreement


def choose_settings(folds: Sequence[Sequence[Case]], trials: Trials) -> list[Choice]:
    """Choose for each of several groups of cases; all run together, and no run twice.

    Args:
        folds: Cases of one kind of tracker and one regressor.
        trials: Where to run them.

    Raises:
        ParameterError: The walks are too short to measure a drift.
    """
    drifts = [require_drift(cases) for cases in folds]
    first = [list(candidates(drift)) for drift in drifts]
    runs = zip(folds, first, strict=True)
    trials.run("orientation", ((c, s) for cases, settings in runs for s in settings for c in cases))
    turned = [best(*pair, trials) for pair in zip(folds, drifts, first, strict=True)]
    second = [list(with_positions(s, d)) for s, d in zip(turned, drifts, strict=True)]
    runs = zip(folds, second, strict=True)
    trials.run("position", ((c, s) for cases, settings in runs for s in settings for c in cases))
    chosen = [best(*pair, trials) for pair in zip(folds, drifts, second, strict=True)]
    return [
        Choice(drift, with_sigmas(setting, cases, trials), disagreement(setting, cases, trials))
        for cases, drift, setting in zip(folds, drifts, chosen, strict=True)
    ]


def learned(cases: Sequence[Case], choice: Choice, trials: Trials) -> Choice:
    """The choice, but with drift that is learned while walking, and sigmas to go with it."""
    setting = with_sigmas(UNCALIBRATED, cases, trials)
    return Choice(choice.drift, setting, disagreement(UNCALIBRATED, cases, trials))


def require_drift(cases: Sequence[Case]) -> TrackerDrift:
    """The tracker's drift.

    Raises:
        ParameterError: The walks are too short to measure it.
    """
    drift = measure_tracker(cases)
    if drift is None:
        names = ", ".join(sorted({case.walk for case in cases}))
        raise ParameterError(
            f"walks: {names}: expected walks of at least {LEAST_WAY_M:g} m with ground truth at "
            f"most frames, to measure the drift of {cases[0].vio!r}; walk longer, or give others"
        )
    return drift


def candidates(drift: TrackerDrift) -> Iterator[ChainSetting]:
    """Settings that differ in what is known of up, and in the drift of orientation."""
    is_upright = drift.tilt_deg < _UPRIGHT_DEG
    turns: dict[Gravity, list[tuple[float, float]]] = {"none": [(f, f) for f in FACTORS]}
    if is_upright:
        turns["known"] = turns["none"]
        # A tilt between two worlds that both know up may change with the place: ground truth's.
        turns["estimate"] = [(t, h) for t in FACTORS[:-1] for h in FACTORS if h <= t]
    for gravity, factors in turns.items():
        for tilts, turned in factors:
            tilt, heading, position = rates(drift, tilts, turned, _USUAL_FACTOR)
            yield ChainSetting(gravity, tilt, heading, position, _scale_error(drift))
        yield msgspec.structs.replace(UNCALIBRATED, gravity=gravity)
    for factor in _HOPELESS_FACTORS:  # with little drift of position, they would not be seen
        yield ChainSetting("none", *rates(drift, factor, factor, factor), _scale_error(drift))
    yield UNCALIBRATED


def with_positions(setting: ChainSetting, drift: TrackerDrift) -> Iterator[ChainSetting]:
    """The setting with any drift of position; as it is, if the drift is learned."""
    yield setting
    if setting.position_drift_m2_per_m < 0:
        return
    for factor in FACTORS:
        *_, position = rates(drift, 1.0, 1.0, factor)
        yield msgspec.structs.replace(setting, position_drift_m2_per_m=position)


def rates(
    drift: TrackerDrift, tilts: float, turned: float, moved: float
) -> tuple[float, float, float]:
    """Times the measured ones of tilt, heading and position.

    Rounded to half a decade: finer steps change little, and groups that are alike share runs.
    """
    raw = (
        tilts * drift.tilt_rad2_per_m,
        turned * drift.heading_rad2_per_m,
        moved * drift.position_m2_per_m,
    )
    tilt, heading, position = (_rounded(value) for value in raw)
    return tilt, heading, position


def _rounded(value: float) -> float:
    exponent = round(_STEPS_A_DECADE * math.log10(value)) / _STEPS_A_DECADE
    return float(f"{10**exponent:.3g}")


def _scale_error(drift: TrackerDrift) -> float:
    wrong = math.hypot(drift.scale - 1, drift.scale_spread)
    return _rounded(min(max(wrong, _SCALE_LIMITS[0]), _SCALE_LIMITS[1]))


def best(
    cases: Sequence[Case], drift: TrackerDrift, settings: Sequence[ChainSetting], trials: Trials
) -> ChainSetting:
    """The setting with the smallest errors beside the raw regressor's.

    Its cost is the mean over walks plus their standard deviation: a tracker that is good on one
    walk and loses itself on the next is not to be believed for the first. Figures that are worse
    than the raw regressor's count twice.
    """

    def cost(setting: ChainSetting) -> float:
        logs: NDArray[np.float64] = np.array(
            [log_ratios(trials.of(case, setting)) for case in cases]
        )
        figure: NDArray[np.float64] = logs.mean(axis=0)
        spread = float(np.std(np.mean(logs, axis=1)))
        losses = float(np.sum(np.maximum(figure, 0.0)))
        doubt = _DECADE_COSTS * _decades_below(setting, drift)
        return float(np.mean(figure)) + spread + losses + doubt

    return min(settings, key=cost)


def _decades_below(setting: ChainSetting, drift: TrackerDrift) -> float:
    """By how many decades a setting's drift is below the usual one; of a learned one, half of one.

    To believe a tracker too much costs more than too little.
    """
    if setting.position_drift_m2_per_m < 0:
        return 0.5
    _, heading, position = rates(drift, 1.0, _USUAL_FACTOR, _USUAL_FACTOR)
    return max(
        math.log10(heading / setting.heading_drift_rad2_per_m),
        math.log10(position / setting.position_drift_m2_per_m),
        0.0,
    )


def with_sigmas(setting: ChainSetting, cases: Sequence[Case], trials: Trials) -> ChainSetting:
    """The setting, with the factors that make its sigmas true on these cases."""
    in_sigmas = [trials.of(case, setting).in_sigmas for case in cases]
    position, orientation = (fit_factor([both[row] for both in in_sigmas]) for row in (0, 1))
    return msgspec.structs.replace(
        setting, sigma_position_factor=position, sigma_orientation_factor=orientation
    )


def disagreement(setting: ChainSetting, cases: Sequence[Case], trials: Trials) -> Disagreement:
    """How far predictions lie from answers, and by how much walks differ in it."""
    medians = np.array([figures(trials.of(c, setting).disagreement)[:2] for c in cases])
    medians = medians[np.isfinite(medians).all(axis=-1)]
    if not len(medians):
        return Disagreement(0.0, 0.0, 1.0)
    typical = np.maximum(np.median(medians, axis=0), 1e-6)
    spread = np.exp(np.max(np.abs(np.log(np.maximum(medians, 1e-6) / typical))))
    return Disagreement(float(typical[0]), float(typical[1]), float(spread))
