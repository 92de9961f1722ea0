"""What `vioapr scene info --json` writes of every scene."""

from __future__ import annotations

from typing import Literal

from vioapr.schemas.base import Record

Extent = tuple[float, float, float]
"""Along the world's axes, m; the last is height."""

TrackName = Literal["gt", "vio", ""]
"""Ground truth, the tracker, or neither."""


class RecordingSummaryRecord(Record, frozen=True, kw_only=True):
    """What a recording holds.

    Attributes:
        id: Its id.
        split: "train", "test", "excluded" or "".
        device: The phone and its tracker, for people.
        frames: Number of frames.
        images: Number of frames with an image.
        tracking: Number of frames by state.
        duration_s: From the first frame to the last, s.
        is_timed: Whether times were measured.
        path_m: Length of the way walked, m; 0 if not known.
        gt_frames: Number of frames with ground truth.
        speeds_of: The track that path and speed are of.
        extent_of: The track that the extent is of.
        problem: Why it could not be read whole, or "".
        extent_m: Lowest and highest position: of ground truth in the world, else of the tracker
            in its own; None without either.
        median_speed_m_s: Over stretches of about a second; None if not known.
    """

    id: str
    split: str
    device: str
    frames: int
    images: int
    tracking: dict[str, int]
    duration_s: float
    is_timed: bool
    path_m: float
    gt_frames: int
    speeds_of: TrackName
    extent_of: TrackName
    problem: str
    extent_m: tuple[Extent, Extent] | None
    median_speed_m_s: float | None


class SceneSummaryRecord(Record, frozen=True, kw_only=True):
    """What a scene holds.

    Attributes:
        name: The scene's, for people.
        is_outdoor: Outdoors or indoors.
        images: Number of images by split.
        extent_m: Width, depth and height of where the cameras of recordings in a split were.
        extent_of: The track that the extent is of; None without one.
        recordings: In order of id.
    """

    name: str
    is_outdoor: bool
    images: dict[str, int]
    extent_m: Extent | None
    extent_of: TrackName | None
    recordings: tuple[RecordingSummaryRecord, ...]
