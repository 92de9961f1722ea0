"""VIO quality of several walks together, as plain data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.metrics import PoseErrors, cumulative_distribution, summarize
from vioapr.evaluation.vio_quality import VioQuality
from vioapr.schemas.results import (
    DistributionRecord,
    TrackerRecord,
    TrackRecord,
    VioQualityRecord,
)


def share_within(qualities: Sequence[VioQuality]) -> float:
    """Share of all their pairs below the limits of their parameters; NaN without pairs."""
    counts = [len(q.pair_rows) for q in qualities]
    good = [q.share_within * n for q, n in zip(qualities, counts, strict=True) if n]
    return sum(good) / sum(counts) if good else float("nan")


def group_tracks(qualities: Sequence[VioQuality]) -> dict[str, list[VioQuality]]:
    """By set and tracker, in order of appearance."""
    groups: dict[str, list[VioQuality]] = {}
    for quality in qualities:
        groups.setdefault(f"{quality.track.set_name} {quality.track.vio}", []).append(quality)
    return groups


def steady(qualities: Sequence[VioQuality]) -> list[VioQuality]:
    """Those that do not diverge."""
    return [quality for quality in qualities if quality.diverges_at_s is None]


DEFINITION = (
    "RPE and ROE: absolute difference between the lengths, and between the angles, of "
    "the tracker's and the true motion between two frames one period apart (the paper's "
    "equations 10 and 11). APE, AOE: after rigid alignment on the first seconds. "
    "ATE: root mean square after rigid alignment of the whole track."
)

PERCENTS = (5, 10, 25, 50, 75, 90, 95, 99)
"""Of the frames or pairs, at which the distributions of errors are given."""


def to_record(qualities: Sequence[VioQuality]) -> VioQualityRecord:
    """For JSON: the definition, every track, and every group without its diverging tracks."""
    return VioQualityRecord(
        definition=DEFINITION,
        params=dict(vars(qualities[0].params)) if qualities else {},
        groups={
            name: TrackerRecord(
                tracks=len(members),
                diverging=[q.track.walk for q in members if q.diverges_at_s is not None],
                pairs=sum(len(q.pair_rows) for q in steady(members)),
                share_within=share_within(steady(members)),
                distribution=error_distributions(steady(members)),
            )
            for name, members in group_tracks(qualities).items()
        },
        tracks=[_track_record(quality) for quality in qualities],
    )


def _track_record(quality: VioQuality) -> TrackRecord:
    track, time, distance = quality.track, quality.per_time, quality.per_distance
    absolute, relative = (
        summarize(quality.errors),
        summarize(PoseErrors(quality.gaps.distance_m, quality.gaps.angle_deg)),
    )
    stretch_m, stretch_s = distance.stretch or np.nan, time.stretch or np.nan
    return TrackRecord(
        set=track.set_name,
        walk=track.walk,
        vio=track.vio,
        frames=len(track),
        frames_without_gt=track.frames_without_gt,
        frames_lost=track.frames_lost,
        tracking_worlds=len(np.unique(track.tracking_world)),
        has_clock=track.is_timed,
        duration_s=quality.duration_s,
        path_m=quality.path_m,
        pairs=len(quality.pair_rows),
        diverges=quality.diverges_at_s is not None,
        diverges_at_s=quality.diverges_at_s,
        ate_m=quality.ate_m,
        ate_percent_of_path=100 * quality.ate_m / (quality.path_m or np.nan),
        scale=quality.scale,
        ape_median_m=float(absolute.median_m),
        ape_p95_m=float(absolute.p95_m),
        aoe_median_deg=float(absolute.median_deg),
        aoe_p95_deg=float(absolute.p95_deg),
        rpe_median_m=float(relative.median_m),
        rpe_p95_m=float(relative.p95_m),
        roe_median_deg=float(relative.median_deg),
        roe_p95_deg=float(relative.p95_deg),
        share_within=quality.share_within,
        drift_stretch_m=distance.stretch,
        drift_m_per_100m=distance.position_m * 100 / stretch_m,
        drift_deg_per_100m=distance.orientation_deg * 100 / stretch_m,
        drift_stretch_s=time.stretch,
        drift_m_per_min=time.position_m * 60 / stretch_s,
        drift_deg_per_min=time.orientation_deg * 60 / stretch_s,
    )


def error_distributions(qualities: Sequence[VioQuality]) -> DistributionRecord:
    """The errors that `PERCENTS` of all frames or pairs of several tracks do not exceed."""
    curves: dict[str, list[float]] = {}
    for name, values in pooled_errors(qualities).items():
        ordered, _ = cumulative_distribution(values)
        rows = [max(int(np.ceil(p / 100 * len(ordered))) - 1, 0) for p in PERCENTS]
        curves[name] = [float(ordered[row]) for row in rows] if len(ordered) else []
    return DistributionRecord(percent=[float(p) for p in PERCENTS], **curves)


def pooled_errors(qualities: Sequence[VioQuality]) -> dict[str, NDArray[np.float64]]:
    """All frames' APE and AOE and all pairs' RPE and ROE of several tracks together."""
    arrays = {
        "ape_m": [q.errors.position_m for q in qualities],
        "aoe_deg": [q.errors.orientation_deg for q in qualities],
        "rpe_m": [q.gaps.distance_m for q in qualities],
        "roe_deg": [q.gaps.angle_deg for q in qualities],
    }
    return {name: np.concatenate([np.zeros(0), *values]) for name, values in arrays.items()}
