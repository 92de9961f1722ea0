"""The paper's Tables 2-5, grouped by set, odometry and regressor."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.metrics import Summary, summarize
from vioapr.fusion.types import Status

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
class Group:
    """One table: a set of walks with one kind of odometry and one regressor.

    Attributes:
        set_name: Name of the set.
        vio: Kind of odometry, without the number of the draw.
        apr: Name of the regressor.
        cases: Number of walks times draws of odometry.
        raw: The raw regressor's figures on all frames that have a prediction.
        rows: One a method and subset.
        results: What it was made from.
    """

    set_name: str
    vio: str
    apr: str
    cases: int
    raw: Summary
    rows: list[Row]
    results: list[Result]

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.set_name}, VIO {self.vio}, regressor {self.apr}"


def group_results(results: Sequence[Result]) -> list[Group]:
    """The tables of all groups, in the order in which the groups first appear."""
    grouped: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        grouped.setdefault(result.case.group, []).append(result)
    return [_make_group(key, members) for key, members in grouped.items()]


def _make_group(key: tuple[str, str, str], results: list[Result]) -> Group:
    methods = list(dict.fromkeys(result.method for result in results))
    first = [result for result in results if result.method == methods[0]]
    rows = [
        row
        for method in methods
        for row in _method_rows(method, [r for r in results if r.method == method])
    ]
    raw = mean_summary([summarize(result.raw_errors) for result in first])
    return Group(*key, len(first), raw, rows, results)


def _method_rows(method: str, results: list[Result]) -> Iterator[Row]:
    """All four rows for a method that picks keyframes, else the one over all frames."""
    picks_keyframes = any(result.has_status(Status.KEYFRAME).any() for result in results)
    for subset in SUBSETS if picks_keyframes else ("all frames",):
        yield make_row(method, subset, results)


def make_row(method: str, subset: str, results: Sequence[Result]) -> Row:
    """A method's figures over a subset of the frames, as means over the results."""
    fused, raw = [], []
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


def to_json(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Tables as plain data: groups with rows and with every walk's own figures."""
    return [
        {
            "set": group.set_name,
            "vio": group.vio,
            "apr": group.apr,
            "cases": group.cases,
            "raw": _plain(group.raw),
            "rows": [
                asdict(row) | {"fused": _plain(row.fused), "raw": _plain(row.raw)}
                for row in group.rows
            ],
            "walks": [_walk_json(result) for result in group.results],
        }
        for group in groups
    ]


def _walk_json(result: Result) -> dict[str, Any]:
    return {
        "walk": result.case.walk,
        "vio": result.case.vio,
        "method": result.method,
        "frames": len(result.status),
        "statuses": {s.label: int((result.status == s).sum()) for s in Status},
        "fused": _plain(summarize(result.errors)),
        "raw": _plain(summarize(result.raw_errors)),
    }


def _plain(summary: Summary) -> dict[str, float | None]:
    """JSON has no NaN: unknown figures become null."""
    values = {name: float(value) for name, value in summary._asdict().items()}
    return {name: value if np.isfinite(value) else None for name, value in values.items()}


CSV_COLUMNS = (
    "set,walk,vio,apr,method,timestamp_s,status,x,y,z,qx,qy,qz,qw,"
    "position_error_m,orientation_error_deg"
)


def to_csv(results: Sequence[Result]) -> str:
    """A row a frame with ground truth; unlocalized frames have `nan` as pose and errors."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS.split(","))
    for result in results:
        case = result.case
        labels = [case.set_name, case.walk, case.vio, case.apr, result.method]
        numbers = np.column_stack([*result.world_from_cam, *result.errors]).tolist()
        for time, status, row in zip(
            result.timestamp_s.tolist(), result.status.tolist(), numbers, strict=True
        ):
            writer.writerow([*labels, time, Status(status).label, *row])
    return text.getvalue()
