"""The tables' figures as text, the same in the terminal's tables and in the report."""

from __future__ import annotations

import math

from vioapr.evaluation.metrics import Summary
from vioapr.evaluation.reliability import Reliability
from vioapr.evaluation.tables import Group
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.types import Status
from vioapr.plurals import count_of

UNKNOWN = "–"
"""Stands for a figure over no frames."""


def format_median(summary: Summary) -> str:
    """Median position (m) and orientation error (deg), as in the paper's Tables 2 and 3."""
    return _format_errors(float(summary.median_m), float(summary.median_deg))


def format_p95(summary: Summary) -> str:
    """95th percentiles of position (m) and orientation error (deg)."""
    return _format_errors(float(summary.p95_m), float(summary.p95_deg))


def format_levels(summary: Summary) -> str:
    """Shares (%) of the counted frames within each precision level, as in Tables 4 and 5."""
    levels = [float(level) for level in (summary.high, summary.medium, summary.low)]
    if not any(math.isfinite(level) for level in levels):
        return UNKNOWN
    return "/".join(format_number(100 * level, 1) for level in levels)


def format_share(summary: Summary) -> str:
    """Share (%) of all frames that the summary counts."""
    share = float(summary.share)
    return f"{format_number(100 * share, 1)} %" if math.isfinite(share) else UNKNOWN


RELIABILITY_HEADERS = (
    "jumps/min",
    "largest m",
    "wrong and sure",
    "mean",
    "risk area",
    "surest 50 %",
    "surest 80 %",
    "surest 95 %",
)
"""Of the texts that `format_reliability` gives."""


def format_reliability(figures: Reliability) -> list[str]:
    """Content jumps, the share (%) that is wrong and sure, and mean errors (m / deg)."""
    jumps, largest, wrong, *errors = map(float, figures)
    pairs = zip(errors[::2], errors[1::2], strict=True)
    return [
        format_number(jumps, 1),
        format_error(largest),
        f"{format_number(100 * wrong, 1)} %" if math.isfinite(wrong) else UNKNOWN,
        *(_format_errors(*pair) for pair in pairs),
    ]


def format_walks(group: Group) -> str:
    """How many walks a group has, and how many runs with several draws of odometry."""
    walks = len({result.case.walk for result in group.results})
    text = count_of(walks, "walk")
    return text if walks == group.cases else f"{text} ({group.cases} with every draw of odometry)"


def format_statuses(fused: FusedWalk) -> str:
    """How many frames a walk has, and how many of each status."""
    counts = {status.label: int((fused.status == status).sum()) for status in Status}
    parts = [f"{count} {label}" for label, count in counts.items() if count]
    return f"{count_of(len(fused), 'frame')}: {', '.join(parts)}"


def format_number(value: float, digits: int = 2) -> str:
    """A number with `digits` digits after the point, or a dash where it is unknown."""
    return f"{value:.{digits}f}" if math.isfinite(value) else UNKNOWN


def format_error(error: float) -> str:
    """An error in m or deg: two digits, three below 1, where two would tell little."""
    return format_number(error, 3 if 0 < error < 1 else 2)


def _format_errors(error_m: float, error_deg: float) -> str:
    if not (math.isfinite(error_m) or math.isfinite(error_deg)):
        return UNKNOWN
    return f"{format_error(error_m)} / {format_error(error_deg)}"
