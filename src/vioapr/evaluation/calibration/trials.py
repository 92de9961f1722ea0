"""Method `chain` run on walks with any settings at once, each judged against ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.cases import Case
from vioapr.evaluation.metrics import PoseErrors, pose_errors
from vioapr.fusion.chain.method import METHOD
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.offline import run_steps, stack_walks
from vioapr.fusion.types import Estimate
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_at
from vioapr.schemas.calibration import ChainSetting
from vioapr.work.progress import Progress, Tick, silent

_TOGETHER = 48
"""Runs in one batch: more save no time, and shorter walks wait for longer ones."""

_BATCHED = (
    "tilt_drift_rad2_per_m",
    "heading_drift_rad2_per_m",
    "position_drift_m2_per_m",
    "scale_error",
)
"""What may differ within a batch."""


_LEAST_ERROR = 1e-9
"""In m and deg: of predictions that are exact, too, there are ratios."""


class Trial(NamedTuple):
    """One walk's answers under one setting, over its n frames with ground truth.

    Attributes:
        errors: Of the answers; of the prediction where there is no answer, else NaN.
        raw: Of the predictions; NaN where there is none.
        in_sigmas: Errors of position and orientation over the stated sigmas, with factors of 1;
            NaN where there is no answer, shape (2, n).
        disagreement: Distances of predictions from the answers, NaN without both.
    """

    errors: PoseErrors
    raw: PoseErrors
    in_sigmas: NDArray[np.float64]
    disagreement: PoseErrors


@dataclass
class Trials:
    """Runs cases under settings, and remembers what it has run.

    Attributes:
        known: By the case's identity and the setting.
    """

    progress: Progress = silent
    known: dict[tuple[int, ChainSetting], Trial] = field(default_factory=dict[Any, Any])

    def run(self, title: str, wanted: Iterable[tuple[Case, ChainSetting]]) -> None:
        """Run what has not been run yet, in as few batches as possible.

        Args:
            title: Of the work.
            wanted: Cases and settings.
        """
        missing: dict[tuple[int, ChainSetting], Case] = {}
        for case, setting in wanted:
            if (id(case), setting) not in self.known:
                missing[id(case), setting] = case
        by_gravity: dict[str, list[tuple[Case, ChainSetting]]] = {}
        for (_, setting), case in missing.items():
            by_gravity.setdefault(setting.gravity, []).append((case, setting))
        batches: list[tuple[str, Sequence[tuple[Case, ChainSetting]]]] = []
        for gravity, runs in by_gravity.items():
            runs.sort(key=lambda run: len(run[0].frames))
            firsts = range(0, len(runs), _TOGETHER)
            batches += [(gravity, runs[first : first + _TOGETHER]) for first in firsts]
        steps = sum(len(batch[-1][0].frames) for _, batch in batches)
        with self.progress(title, steps) as advance:
            for gravity, batch in batches:
                self._run_batch(gravity, batch, advance)

    def of(self, case: Case, setting: ChainSetting) -> Trial:
        """What a case that was run made of a setting."""
        return self.known[id(case), setting]

    def _run_batch(
        self, gravity: str, runs: Sequence[tuple[Case, ChainSetting]], tick: Tick
    ) -> None:
        values = {
            name: np.array([float(getattr(setting, name)) for _, setting in runs])
            for name in _BATCHED
        }
        params = SimpleNamespace(**(_plain(ChainParams()) | {"gravity": gravity} | values))
        frames = stack_walks([case.frames for case, _ in runs])
        estimates = run_steps(METHOD, params, frames, tick=tick)
        for column, (case, setting) in enumerate(runs):
            own = tree_at(estimates, (slice(0, len(case.frames)), column))
            self.known[id(case), setting] = judge(case, own)


def _plain(params: ChainParams) -> dict[str, Any]:
    return {name: getattr(params, name) for name in ChainParams.__dataclass_fields__}


def judge(case: Case, estimates: Estimate) -> Trial:
    """Compare estimates of shape (n,), of all frames of a case, with its ground truth."""
    rows, inputs = case.has_gt, case.frames.inputs
    gt, found = case.gt_world_from_cam.at(rows), estimates.world_from_cam.at(rows)
    apr = inputs.apr_world_from_cam.at(rows)
    has_apr = np.asarray(inputs.has_apr)[rows]
    raw = PoseErrors(*(np.where(has_apr, e, np.nan) for e in pose_errors(gt, apr)))
    own = pose_errors(gt, found)
    sigmas = (estimates.sigma_position_m, estimates.sigma_orientation_deg)
    ratios = [e / np.asarray(s)[rows] for e, s in zip(own, sigmas, strict=True)]
    return Trial(
        PoseErrors(*(np.where(np.isfinite(e), e, r) for e, r in zip(own, raw, strict=True))),
        raw,
        np.stack(ratios),
        disagreement_of(apr, has_apr, found),
    )


def disagreement_of(
    apr_world_from_cam: Rigid3, has_apr: NDArray[np.bool_], world_from_cam: Rigid3
) -> PoseErrors:
    """How far answers lie from predictions, shape (n,); NaN for frames without both."""
    apart = pose_errors(apr_world_from_cam, world_from_cam)
    return PoseErrors(*(np.where(has_apr, gap, np.nan) for gap in apart))


def figures(errors: PoseErrors) -> NDArray[np.float64]:
    """Median and 95th percentile of position, then orientation: m, deg, m, deg; shape (4,)."""
    known = [e[np.isfinite(e)] for e in errors]
    if not all(len(e) for e in known):
        return np.full(4, np.nan)
    return np.array([np.percentile(e, q) for q in (50, 95) for e in known])


def log_ratios(trial: Trial) -> NDArray[np.float64]:
    """Logarithms of figures over those of the raw regressor, shape (4,)."""
    own, raw = (np.maximum(figures(errors), _LEAST_ERROR) for errors in (trial.errors, trial.raw))
    return np.log(own / raw)


def mean_ratios(trials: Sequence[Trial]) -> NDArray[np.float64]:
    """Figures over those of the raw regressor, geometric means over walks, shape (4,)."""
    return np.exp(np.mean([log_ratios(trial) for trial in trials], axis=0))
