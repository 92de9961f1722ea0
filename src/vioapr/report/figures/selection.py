"""What the figures show: results, their colours and labels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.tables import Group
from vioapr.report.style import RAW, Array1, method_colors

_NAME_LENGTH = 24
AXIS_LABELS = ("position error (m)", "orientation error (deg)")
"""Of the fields of `PoseErrors`."""


def representative_case(group: Group) -> Case:
    """The case whose raw median position error is the median of the group's.

    Chosen by the raw regressor alone, so that no method is flattered. Of an even number, the
    lower of the two in the middle; a case without predictions only where no other has any.
    """
    first = [result for result in group.results if result.method == group.results[0].method]
    medians = [finite_median(result.raw_errors.position_m) for result in first]
    order = np.argsort(medians, kind="stable")  # unknown ones last
    known = int(np.isfinite(medians).sum())
    return first[order[max(known - 1, 0) // 2]].case


def results_of(group: Group, case: Case) -> list[Result]:
    """What each method made of a case."""
    return [result for result in group.results if result.case is case]


def without_raw(results: Sequence[Result]) -> list[Result]:
    """Results of methods that are not the raw predictions, which are drawn anyway."""
    return [result for result in results if result.method != RAW]


def staged_method(results: Sequence[Result]) -> Result | None:
    """The result to draw with its stages: `vio-apr`, else the first that is not a baseline."""
    others = [result for result in without_raw(results) if result.method != "vio"]
    named = [result for result in others if result.method == "vio-apr"]
    return next(iter(named + others), None)


def colors_of(results: Sequence[Result]) -> dict[str, str]:
    """The colour of each method, the same in all figures."""
    return method_colors([RAW, *(result.method for result in results)])


def raw_label(results: Sequence[Result]) -> str:
    """Begins with a word of ours: Matplotlib's legends leave out what begins with "_"."""
    name = results[0].case.apr
    return f"raw {name if len(name) <= _NAME_LENGTH else name[: _NAME_LENGTH - 1] + '…'}"


def errors_by_method(results: Sequence[Result], field: int) -> dict[str, Array1]:
    """All cases' errors together: the raw predictions' first, then each method's."""
    errors = {RAW: [r.raw_errors[field] for r in results if r.method == results[0].method]}
    for result in without_raw(results):
        errors.setdefault(result.method, []).append(result.errors[field])
    return {method: np.concatenate(values) for method, values in errors.items()}


def finite_median(values: Array1) -> float:
    """The median of the finite values, NaN where there are none."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")
