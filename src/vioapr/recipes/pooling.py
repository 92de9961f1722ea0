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
from vioapr.evaluation.evaluate import evaluate_cases
from vioapr.evaluation.metrics import PoseErrors, Summary, pose_errors, summarize
from vioapr.evaluation.tables import SUBSETS
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.fusion.methods import default_params
from vioapr.fusion.types import Status
from vioapr.geometry.tree import tree_map
from vioapr.scene.walks import find_walks
from vioapr.trajectory import associate

METHODS = ("vio-apr", "chain")


@dataclass(frozen=True, eq=False)
class PooledErrors:
    """The errors of n test frames: those that have a prediction and ground truth.

    Attributes:
        raw: The regressor's errors, shape (n,).
        fused: Each method's, shape (n,); NaN where it has no pose.
        status: Each method's of the frames, shape (n,), integers of `Status`.
    """

    raw: PoseErrors
    fused: dict[str, PoseErrors]
    status: dict[str, NDArray[np.integer]]

    def raw_summary(self, method: str | None = None, subset: str = "all frames") -> Summary:
        """Summarize the raw regressor over all test frames, or over those of a method's subset."""
        return summarize(self.raw, None if method is None else self._counted(method, subset))

    def fused_summary(self, method: str, subset: str) -> Summary:
        """Summarize a method over a subset of the test frames, a key of `SUBSETS`."""
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
    parts = [raw_errors(folder, model) for folder in folders if folder not in tracked]
    if tracked:
        cases = load_cases(find_walks(tracked))
        results = evaluate_cases(
            cases, default_params(METHODS)
        )  # all cases by the first method, and so on
        for number in range(len(cases)):
            walk = results[number :: len(cases)]
            # Frames without image are no test frames.
            is_test = np.isfinite(walk[0].raw_errors.position_m)
            parts.append(
                PooledErrors(
                    walk[0].raw_errors.at(is_test),
                    {result.method: result.errors.at(is_test) for result in walk},
                    {result.method: result.status[is_test] for result in walk},
                )
            )

    def joined(*columns: NDArray) -> NDArray:
        return np.concatenate(columns)

    return PooledErrors(
        tree_map(joined, *(part.raw for part in parts)),
        {name: tree_map(joined, *(part.fused[name] for part in parts)) for name in METHODS},
        {name: joined(*(part.status[name] for part in parts)) for name in METHODS},
    )


def raw_errors(folder: Path, model: str) -> PooledErrors:
    """Collect the errors of a recording without a tracker, where nothing can be fused.

    Args:
        folder: With `gt.tum` and `apr_<model>.tum`.
        model: The regressor's name.

    Raises:
        FileError: A file is missing or wrong.
        AssociationError: No prediction has ground truth.
    """
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
