"""The paper's Tables 2-5, grouped by set, odometry and regressor."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import Result, compare_with_gt, evaluate_cases
from vioapr.evaluation.metrics import Summary, summarize
from vioapr.evaluation.reliability import Reliability, mean_reliability
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.methods import default_params
from vioapr.fusion.offline import View
from vioapr.fusion.types import Status
from vioapr.schemas.results import (
    GroupRecord,
    MethodReliabilityRecord,
    ReliabilityRecord,
    RowRecord,
    SummaryRecord,
    WalkRecord,
)
from vioapr.work.progress import Tick, ignore

SUBSETS: dict[str, tuple[Status, ...]] = {
    "only keyframes": (Status.KEYFRAME,),
    "only optimized": (Status.OPTIMIZED,),
    "keyframes + optimized": (Status.KEYFRAME, Status.OPTIMIZED),
    "all frames": tuple(status for status in Status if status != Status.UNLOCALIZED),
}
"""The frames that each row of the tables counts. "All frames" are all that have a pose; the
share says how many that is."""


@dataclass(frozen=True)
class Row:
    """One row: a method over a subset of the frames, beside the raw regressor on the same.

    Attributes:
        method: The method's name.
        subset: A key of `SUBSETS`.
        walks: How many cases have such frames.
        fused: The method's figures, the mean over walks of each walk's.
        raw: The raw regressor's figures on the same frames.
    """

    method: str
    subset: str
    walks: int
    fused: Summary
    raw: Summary


@dataclass(frozen=True)
class MethodReliability:
    """A row of the second table: a method over all frames.

    Attributes:
        method: The method's name.
        walks: How many cases there are.
        figures: Means over walks of each walk's; of the largest jump, the largest.
    """

    method: str
    walks: int
    figures: Reliability


@dataclass(frozen=True)
class Group:
    """One table: a set of walks with one kind of odometry and one regressor.

    Attributes:
        set_name: Name of the set.
        vio: Kind of odometry, without the number of the draw.
        apr: Name of the regressor.
        cases: Number of walks times draws of odometry.
        raw: The raw regressor's figures on all frames that have a prediction.
        rows: One a method and subset.
        results: Those that it is of.
        reliability: Rows of the second table, one a method.
    """

    set_name: str
    vio: str
    apr: str
    cases: int
    raw: Summary
    rows: list[Row]
    results: list[Result]
    reliability: list[MethodReliability]

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.set_name}, VIO {self.vio}, regressor {self.apr}"


class Evaluation(NamedTuple):
    """Methods on cases: for each method, in order, a result a case; and the tables of them."""

    results: list[Result]
    groups: list[Group]


def tabulate(
    cases: Sequence[Case],
    params_of_method: Mapping[str, Any],
    *,
    view: View = "retrospective",
    offline: bool = False,
    tick: Tick = ignore,
) -> Evaluation:
    """Fuse every case with every method, and group the results into tables.

    Args:
        cases: From `load_cases`.
        params_of_method: The methods' names, each with its parameters.
        view: See `vioapr.fusion.offline.View`.
        offline: Use the future too, by the methods that can.
        tick: Called as often as `vioapr.evaluation.evaluate.count_ticks` says, for progress.

    Raises:
        MissingExtraError: A method needs a package that is not installed.
    """
    results = evaluate_cases(cases, params_of_method, view=view, offline=offline, tick=tick)
    return Evaluation(results, group_results(results))


COMPARED = ("apr", "vio", "vio-apr", "chain")
"""The methods that a localizer is compared with, in the order of the tables."""


def compare_methods(
    case: Case, method: str, fused: FusedWalk, *, tick: Tick = ignore
) -> list[Group]:
    """Group a localizer's own results with those of the methods `COMPARED` on its inputs.

    Args:
        case: The walk, with the predictions that the localizer used.
        method: The localizer's method, which is not run again.
        fused: Its answers, as known when each frame arrived.
        tick: Called as often as `count_ticks([case], others)` says, for the methods `COMPARED`
            but its own.
    """
    others = default_params(name for name in COMPARED if name != method)
    results = evaluate_cases([case], others, view="live", tick=tick)
    of_method = {result.method: result for result in results}
    of_method[method] = compare_with_gt(case, method, fused)
    return group_results([of_method[name] for name in dict.fromkeys((*COMPARED, method))])


def group_results(results: Sequence[Result]) -> list[Group]:
    """The tables of all groups, in the order in which the groups first appear.

    A method that picks keyframes gets a row a subset, others the one over all frames.
    """
    grouped: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        grouped.setdefault(result.case.group, []).append(result)
    groups: list[Group] = []
    for key, members in grouped.items():
        of_method: dict[str, list[Result]] = {}
        for result in members:
            of_method.setdefault(result.method, []).append(result)
        rows: list[Row] = []
        for method, own in of_method.items():
            picks_keyframes = any(result.has_status(Status.KEYFRAME).any() for result in own)
            subsets = SUBSETS if picks_keyframes else ("all frames",)
            rows += [make_row(method, subset, own) for subset in subsets]
        first = next(iter(of_method.values()))
        raw = mean_summary([summarize(result.raw_errors) for result in first])
        reliability = [
            MethodReliability(method, len(own), mean_reliability([r.reliability for r in own]))
            for method, own in of_method.items()
        ]
        groups.append(Group(*key, len(first), raw, rows, members, reliability))
    return groups


def make_row(method: str, subset: str, results: Sequence[Result]) -> Row:
    """A method's figures over a subset of the frames, as means over the results."""
    fused: list[Summary] = []
    raw: list[Summary] = []
    for result in results:
        is_counted = result.has_status(*SUBSETS[subset])
        fused.append(summarize(result.errors, is_counted))
        raw.append(summarize(result.raw_errors, is_counted))
    walks = sum(bool(summary.share > 0) for summary in fused)
    return Row(method, subset, walks, mean_summary(fused), mean_summary(raw))


def mean_summary(summaries: Sequence[Summary]) -> Summary:
    """Means over walks; a walk without such frames counts in the share only."""
    values = np.array(summaries, dtype=np.float64)
    is_known = np.isfinite(values)
    count = is_known.sum(axis=0)
    total = np.where(is_known, values, 0.0).sum(axis=0)
    return Summary(*np.where(count > 0, total / np.maximum(count, 1), np.nan))


def to_records(groups: Sequence[Group]) -> list[GroupRecord]:
    """Tables for JSON: groups with rows and with every walk's own figures."""
    return [
        GroupRecord(
            set=group.set_name,
            vio=group.vio,
            apr=group.apr,
            cases=group.cases,
            raw=_summary_record(group.raw),
            rows=[
                RowRecord(
                    method=row.method,
                    subset=row.subset,
                    walks=row.walks,
                    fused=_summary_record(row.fused),
                    raw=_summary_record(row.raw),
                )
                for row in group.rows
            ],
            reliability=[
                MethodReliabilityRecord(
                    method=row.method, walks=row.walks, figures=_reliability_record(row.figures)
                )
                for row in group.reliability
            ],
            walks=[
                WalkRecord(
                    walk=result.case.walk,
                    vio=result.case.vio,
                    method=result.method,
                    frames=len(result.status),
                    statuses={s.label: int((result.status == s).sum()) for s in Status},
                    fused=_summary_record(summarize(result.errors)),
                    raw=_summary_record(summarize(result.raw_errors)),
                    reliability=_reliability_record(result.reliability),
                )
                for result in group.results
            ],
        )
        for group in groups
    ]


def _summary_record(summary: Summary) -> SummaryRecord:
    return SummaryRecord(**{name: float(value) for name, value in summary._asdict().items()})


def _reliability_record(figures: Reliability) -> ReliabilityRecord:
    return ReliabilityRecord(**figures._asdict())


CSV_COLUMNS = (
    "set,walk,vio,apr,method,timestamp_s,status,x,y,z,qx,qy,qz,qw,"
    "position_error_m,orientation_error_deg,sigma_position_m,sigma_orientation_deg,content_step_m"
)


def to_csv(results: Sequence[Result]) -> str:
    """A row a frame with ground truth; what is not known of it is `nan`.

    Unlocalized frames have neither pose nor errors; methods without uncertainty no sigmas; and
    content has not moved where it was not shown before.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS.split(","))
    for result in results:
        case = result.case
        labels = [case.set_name, case.walk, case.vio, case.apr, result.method]
        unknown = np.full(len(result.status), np.nan)
        steps = None if result.content is None else result.content.step_m[case.has_gt]
        columns = (result.sigma_position_m, result.sigma_orientation_deg, steps)
        more = [unknown if column is None else column for column in columns]
        numbers = np.column_stack([*result.world_from_cam, *result.errors, *more]).tolist()
        for time, status, row in zip(
            result.timestamp_s.tolist(), result.status.tolist(), numbers, strict=True
        ):
            writer.writerow([*labels, time, Status(status).label, *row])
    return text.getvalue()
