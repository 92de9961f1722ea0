"""Results as they are written to JSON: the tables of `vioapr evaluate` and of `vio-quality`.

Figures over no frames are null. Errors are in metres and degrees, shares from 0 to 1.
"""

from __future__ import annotations

from vioapr.schemas.base import Record


class SummaryRecord(Record, frozen=True, kw_only=True):
    """Figures over the frames of a walk, or their means over walks."""

    median_m: float | None
    """Median position error."""
    median_deg: float | None
    """Median orientation error."""
    p95_m: float | None
    """95th percentile of the position error."""
    p95_deg: float | None
    """95th percentile of the orientation error."""
    high: float | None
    """Share within 0.25 m and 2 deg."""
    medium: float | None
    """Share within 0.5 m and 5 deg."""
    low: float | None
    """Share within 5 m and 10 deg."""
    share: float | None
    """Frames that were counted, as a share of all."""


class RowRecord(Record, frozen=True, kw_only=True):
    """A method over a subset of the frames, beside the raw regressor on the same frames."""

    method: str
    subset: str
    walks: int
    fused: SummaryRecord
    raw: SummaryRecord


class ReliabilityRecord(Record, frozen=True, kw_only=True):
    """Whether content stays put, and whether stated sigmas can be believed; null where unknown."""

    jumps_per_min: float | None
    """Steps of displayed content above 5 cm, a minute: how far `world_from_vio` moves, from one
    frame to the next, what is at the camera or 3 m ahead of it, the farther of the two."""
    largest_jump_m: float | None
    """The largest such step; over walks, the largest of all."""
    wrong_and_sure: float | None
    """Share of the frames with a sigma whose error is above 5 sigmas, in position or in
    orientation."""
    mean_m: float | None
    """Mean position error of the frames with a pose: the risk area of sigmas that say nothing."""
    mean_deg: float | None
    risk_area_m: float | None
    """Mean position error of the surest frames, by the stated sigma, averaged over all shares of
    the frames."""
    risk_area_deg: float | None
    risk_50_m: float | None
    """Mean position error of the surest 50 % of all frames; null if fewer have a pose."""
    risk_50_deg: float | None
    risk_80_m: float | None
    risk_80_deg: float | None
    risk_95_m: float | None
    risk_95_deg: float | None


class MethodReliabilityRecord(Record, frozen=True, kw_only=True):
    """A method over all frames of a set: means over walks."""

    method: str
    walks: int
    figures: ReliabilityRecord


class WalkRecord(Record, frozen=True, kw_only=True):
    """A method on one walk."""

    walk: str
    vio: str
    method: str
    frames: int
    statuses: dict[str, int]
    """Number of frames by status."""
    fused: SummaryRecord
    raw: SummaryRecord
    reliability: ReliabilityRecord


class GroupRecord(Record, frozen=True, kw_only=True):
    """A set of walks with one kind of odometry and one regressor."""

    set: str
    vio: str
    apr: str
    cases: int
    """Number of walks times draws of odometry."""
    raw: SummaryRecord
    """The raw regressor on all frames that have a prediction."""
    rows: list[RowRecord]
    reliability: list[MethodReliabilityRecord]
    walks: list[WalkRecord]


class DistributionRecord(Record, frozen=True, kw_only=True):
    """Errors that a given percentage of the frames or pairs does not exceed; empty without any."""

    percent: list[float]
    ape_m: list[float]
    aoe_deg: list[float]
    rpe_m: list[float]
    roe_deg: list[float]


class TrackerRecord(Record, frozen=True, kw_only=True):
    """A tracker on all walks of a set, without those on which it diverges."""

    tracks: int
    """Number of walks, with those on which it diverges."""
    diverging: list[str]
    """Names of the walks on which it diverges."""
    pairs: int
    share_within: float | None
    distribution: DistributionRecord


class TrackRecord(Record, frozen=True, kw_only=True):
    """A tracker on one walk."""

    set: str
    walk: str
    vio: str
    frames: int
    frames_without_gt: int
    frames_lost: int
    tracking_worlds: int
    has_clock: bool
    duration_s: float
    path_m: float
    pairs: int
    diverges: bool
    diverges_at_s: float | None
    ate_m: float | None
    ate_percent_of_path: float | None
    scale: float | None
    """True metres per metre of the tracker."""
    ape_median_m: float | None
    ape_p95_m: float | None
    aoe_median_deg: float | None
    aoe_p95_deg: float | None
    rpe_median_m: float | None
    rpe_p95_m: float | None
    roe_median_deg: float | None
    roe_p95_deg: float | None
    share_within: float | None
    drift_stretch_m: float | None
    drift_m_per_100m: float | None
    drift_deg_per_100m: float | None
    drift_stretch_s: float | None
    drift_m_per_min: float | None
    drift_deg_per_min: float | None


class VioQualityRecord(Record, frozen=True, kw_only=True):
    """The quality of trackers on several walks."""

    definition: str
    """What the figures mean."""
    params: dict[str, float]
    """Of the comparison; see `vioapr.evaluation.vio_quality.VioQualityParams`."""
    groups: dict[str, TrackerRecord]
    """By set and tracker."""
    tracks: list[TrackRecord]
