"""Errors of a regressor over a scene's test frames, raw and fused, all recordings together.

The paper's medians and percentages are over all test frames of a scene, where `vioapr evaluate`
says means over walks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import Result, evaluate_cases
from vioapr.evaluation.metrics import PoseErrors, Summary, pose_errors, summarize
from vioapr.evaluation.tables import SUBSETS
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.fusion.methods import default_params
from vioapr.fusion.types import Status
from vioapr.scene.walks import find_walks
from vioapr.trajectory import associate

METHODS = ("vio-apr", "consensus")


@dataclass(frozen=True, eq=False)
class PooledErrors:
    """Of n test frames: those that have a prediction and ground truth.

    Attributes:
        raw: The regressor's errors, shape (n,).
        fused: Each method's, shape (n,); NaN where it has no pose.
        status: What each method says of the frames, shape (n,), integers of `Status`.
    """

    raw: PoseErrors
    fused: dict[str, PoseErrors]
    status: dict[str, NDArray[np.integer]]

    def raw_summary(self, method: str | None = None, subset: str = "all frames") -> Summary:
        """The raw regressor over all test frames, or over those of a method's subset."""
        return summarize(self.raw, None if method is None else self._counted(method, subset))

    def fused_summary(self, method: str, subset: str) -> Summary:
        """A method over a subset of the test frames, a key of `SUBSETS`."""
        return summarize(self.fused[method], self._counted(method, subset))

    def _counted(self, method: str, subset: str) -> NDArray[np.bool_]:
        return np.isin(self.status[method], SUBSETS[subset])


def pool_errors(folders: Sequence[Path], model: str) -> PooledErrors:
    """Fuse a scene's recordings with the paper's parameters, and collect the errors.

    Args:
        folders: Of the recordings, with `gt.tum`, `apr_<model>.tum` and, if there was a
            tracker, `vio_<name>.tum`.
        model: The regressor's name.

    Raises:
        VioAprError: A file is wrong.
    """
    tracked = [folder for folder in folders if any(folder.glob("vio_*.tum"))]
    parts = [_raw_only(folder, model) for folder in folders if folder not in tracked]
    if tracked:
        cases = load_cases(find_walks(tracked))
        results = evaluate_cases(cases, default_params(METHODS))
        parts += [
            _pool_results(walk) for walk in zip(*_by_method(results, len(cases)), strict=True)
        ]
    return _join(parts)


def _by_method(results: list[Result], cases: int) -> list[list[Result]]:
    return [results[start : start + cases] for start in range(0, len(results), cases)]


def _pool_results(walk: Sequence[Result]) -> PooledErrors:
    """One walk's results by all methods; frames without image are no test frames."""
    is_test = np.isfinite(walk[0].raw_errors.position_m)
    return PooledErrors(
        walk[0].raw_errors.at(is_test),
        {result.method: result.errors.at(is_test) for result in walk},
        {result.method: result.status[is_test] for result in walk},
    )


def _raw_only(folder: Path, model: str) -> PooledErrors:
    """Of a recording without a tracker: nothing can be fused."""
    gt = tum.read(folder / "gt.tum", ReadOptions())
    apr = tum.read(folder / f"apr_{model}.tum", ReadOptions())
    pairs = associate(gt, apr)
    if not len(pairs):
        raise AssociationError(f"{folder}: no prediction has ground truth: no common times")
    raw = pose_errors(
        gt.target_from_source.at(pairs.left_rows), apr.target_from_source.at(pairs.right_rows)
    )
    unknown = PoseErrors(np.full(len(pairs), np.nan), np.full(len(pairs), np.nan))
    status = np.full(len(pairs), int(Status.UNLOCALIZED))
    return PooledErrors(raw, dict.fromkeys(METHODS, unknown), dict.fromkeys(METHODS, status))


def _join(parts: Sequence[PooledErrors]) -> PooledErrors:
    def errors(columns: Sequence[PoseErrors]) -> PoseErrors:
        return PoseErrors(*(np.concatenate(column) for column in zip(*columns, strict=True)))

    return PooledErrors(
        errors([part.raw for part in parts]),
        {name: errors([part.fused[name] for part in parts]) for name in METHODS},
        {name: np.concatenate([part.status[name] for part in parts]) for name in METHODS},
    )
