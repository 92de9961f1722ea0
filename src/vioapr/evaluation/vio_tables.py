"""VIO quality of several walks together, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.metrics import PoseErrors, cumulative_distribution, summarize
from vioapr.evaluation.vio_quality import VioQuality


def share_within(qualities: list[VioQuality]) -> float:
    """Share of all their pairs below the limits of their parameters; NaN without pairs."""
    counts = [len(q.pair_rows) for q in qualities]
    good = [q.share_within * n for q, n in zip(qualities, counts, strict=True) if n]
    return sum(good) / sum(counts) if good else float("nan")


def group_tracks(qualities: list[VioQuality]) -> dict[str, list[VioQuality]]:
    """By set and tracker, in order of appearance."""
    groups: dict[str, list[VioQuality]] = {}
    for quality in qualities:
        groups.setdefault(f"{quality.track.set_name} {quality.track.vio}", []).append(quality)
    return groups


def steady(qualities: list[VioQuality]) -> list[VioQuality]:
    """Those that do not diverge."""
    return [quality for quality in qualities if quality.diverges_at_s is None]


def to_json(qualities: list[VioQuality]) -> dict[str, Any]:
    """Plain data: the definition, every track, and every group without its diverging tracks."""
    groups = {
        name: {
            "tracks": len(members),
            "diverging": [q.track.walk for q in members if q.diverges_at_s is not None],
            "pairs": sum(len(q.pair_rows) for q in steady(members)),
            "share_within": _plain(share_within(steady(members))),
            **_distributions(steady(members)),
        }
        for name, members in group_tracks(qualities).items()
    }
    params = vars(qualities[0].params) if qualities else {}
    return {
        "definition": (
            "RPE and ROE: absolute difference between the lengths, and between the angles, of "
            "the tracker's and the true motion between two frames one period apart (the paper's "
            "equations 10 and 11). APE, AOE: after rigid alignment on the first seconds. "
            "ATE: root mean square after rigid alignment of the whole track."
        ),
        "params": params,
        "groups": groups,
        "tracks": [_track_json(quality) for quality in qualities],
    }


def _track_json(quality: VioQuality) -> dict[str, Any]:
    track, gaps = quality.track, quality.gaps
    absolute, relative = summarize(quality.errors), summarize(PoseErrors(*gaps))
    minute_s, hundred_m = 60.0, 100.0
    time, distance = quality.per_time, quality.per_distance
    values = {
        "ate_m": quality.ate_m,
        "ate_percent_of_path": 100 * quality.ate_m / quality.path_m if quality.path_m else np.nan,
        "scale": quality.scale,
        "ape_median_m": absolute.median_m,
        "ape_p95_m": absolute.p95_m,
        "aoe_median_deg": absolute.median_deg,
        "aoe_p95_deg": absolute.p95_deg,
        "rpe_median_m": relative.median_m,
        "rpe_p95_m": relative.p95_m,
        "roe_median_deg": relative.median_deg,
        "roe_p95_deg": relative.p95_deg,
        "share_within": quality.share_within,
        "drift_stretch_m": distance.stretch,
        "drift_m_per_100m": distance.position_m * hundred_m / (distance.stretch or np.nan),
        "drift_deg_per_100m": distance.orientation_deg * hundred_m / (distance.stretch or np.nan),
        "drift_stretch_s": time.stretch,
        "drift_m_per_min": time.position_m * minute_s / (time.stretch or np.nan),
        "drift_deg_per_min": time.orientation_deg * minute_s / (time.stretch or np.nan),
    }
    return {
        "set": track.set_name,
        "walk": track.walk,
        "vio": track.vio,
        "frames": len(track),
        "frames_without_gt": track.frames_without_gt,
        "frames_lost": track.frames_lost,
        "tracking_worlds": len(np.unique(track.tracking_world)),
        "has_clock": track.is_timed,
        "duration_s": quality.duration_s,
        "path_m": quality.path_m,
        "pairs": len(quality.pair_rows),
        "diverges": quality.diverges_at_s is not None,
        "diverges_at_s": quality.diverges_at_s,
        **{name: _plain(value) for name, value in values.items()},
    }


def _distributions(qualities: list[VioQuality]) -> dict[str, Any]:
    """Errors that so many per cent of the frames or pairs do not exceed, of all together."""
    percents = [5, 10, 25, 50, 75, 90, 95, 99]
    curves: dict[str, list[float]] = {"percent": [float(p) for p in percents]}
    for name, values in pooled_errors(qualities).items():
        ordered, _ = cumulative_distribution(values)
        rows = [max(int(np.ceil(p / 100 * len(ordered))) - 1, 0) for p in percents]
        curves[name] = [float(ordered[row]) for row in rows] if len(ordered) else []
    return {"distribution": curves}


def pooled_errors(qualities: list[VioQuality]) -> dict[str, NDArray[np.float64]]:
    """All frames' APE and AOE and all pairs' RPE and ROE of several tracks together."""
    arrays = {
        "ape_m": [q.errors.position_m for q in qualities],
        "aoe_deg": [q.errors.orientation_deg for q in qualities],
        "rpe_m": [q.gaps.distance_m for q in qualities],
        "roe_deg": [q.gaps.angle_deg for q in qualities],
    }
    return {name: np.concatenate([np.zeros(0), *values]) for name, values in arrays.items()}


def _plain(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
