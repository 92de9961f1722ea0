"""`map.json`: the summary that `vioapr map` writes beside the model."""

from __future__ import annotations

from typing import Literal

import msgspec

from vioapr.schemas.base import Record
from vioapr.schemas.scene import GeodeticOrigin


class Georeference(Record, frozen=True):
    """The fit of a map to satellite positions.

    Attributes:
        enu_heading_deg: Angle by which the map is turned about z, so that x is east, y north.
        origin: Where the map's origin is.
        fixes: Number of satellite positions used.
        residual_m: Median horizontal distance between them and the map.
        heading_sigma_deg: Standard error of the heading.
        scale: Metres of the fixes per metre of the map; 1 if both are right. Not applied.
    """

    enu_heading_deg: float
    origin: GeodeticOrigin
    fixes: int
    residual_m: float
    heading_sigma_deg: float
    scale: float


class ScaleSummary(Record, frozen=True):
    """The scale of the model by one tracking world.

    Attributes:
        world: Its number.
        metres_per_unit: VIO metres per unit of the model, as structure from motion left it.
        sigma: Standard error of its logarithm, from the scatter of the distances.
        length_m: Path length, its weight.
        is_used: Whether it took part in the mean.
        recording: The recording that it is of.
        relative: Its scale by the map's.
    """

    world: int
    metres_per_unit: float
    sigma: float
    length_m: float
    is_used: bool
    recording: str
    relative: float


class GravityOffset(Record, frozen=True):
    """The angle between one tracking world's mean up and the map's.

    Attributes:
        world: The tracking world's number.
        recording: The recording that it is of.
        offset_deg: The angle.
    """

    world: int
    recording: str
    offset_deg: float


class WorldSummary(Record, frozen=True):
    """The map's world, and how well VIO and satellites agree on it.

    Attributes:
        is_metric: Whether lengths are metres.
        is_gravity_aligned: Whether z is up along gravity.
        scales: By every tracking world.
        metres_per_unit: Their mean, which was applied to the model.
        gravity_spread_deg: Median angle between the map's up and the single images' up.
        gravity_p95_deg: 95th percentile of that angle.
        gravity_offset_deg: By every tracking world.
        georeference: The fit to satellite positions, or why there is none; None where the
            recordings have no such positions.
    """

    is_metric: bool
    is_gravity_aligned: bool
    scales: list[ScaleSummary]
    metres_per_unit: float
    gravity_spread_deg: float
    gravity_p95_deg: float
    gravity_offset_deg: list[GravityOffset]
    georeference: Georeference | str | None


class Overlap(Record, frozen=True):
    """The views that two training recordings share.

    Attributes:
        recordings: Their ids.
        compared: Number of pairs of their images that were compared: those that look alike.
        good: Number of those that see the same things.
        best: Names of the two images with the most in common, none if there are no such.
    """

    recordings: list[str]
    compared: int
    good: int
    best: list[str]


class MatchSummary(Record, frozen=True):
    """The matches of the training images.

    Attributes:
        pairs: Number of pairs of images that were matched.
        good_pairs: Number of those that see the same things.
        pruned_pairs: Number of those that were taken out because they contradict VIO.
        islands: Ids of the recordings that share views, the largest group of images first.
        overlaps: Between every two training recordings.
    """

    pairs: int
    good_pairs: int
    pruned_pairs: int
    islands: list[list[str]]
    overlaps: list[Overlap] = msgspec.field(default_factory=list[Overlap])


class CameraSummary(Record, frozen=True):
    """A camera as COLMAP has it: its model's name and parameters."""

    model: str
    params: list[float]


class ModelSummary(Record, frozen=True):
    """The model of structure from motion.

    Attributes:
        images: Number of registered images.
        points: Number of points.
        mean_reprojection_error_px: Over all observations.
        mean_track_length: Observations of a point.
        observations_per_image: Mean over the registered images.
        other_models: Numbers of images of smaller models, which are left out.
        cameras: All cameras.
        mapper: Which mapper made it: vio, incremental or global.
        vio_fault: What spoke against a model from VIO where another was made; "" otherwise.
    """

    images: int
    points: int
    mean_reprojection_error_px: float
    mean_track_length: float
    observations_per_image: float
    other_models: list[int]
    cameras: list[CameraSummary]
    mapper: str = ""
    vio_fault: str = ""


class RecordingSummary(Record, frozen=True):
    """One recording: what is registered, what is not, and where VIO disagrees.

    Attributes:
        split: Its split.
        images: Number of its images that were to be mapped.
        registered: Number of those with a pose.
        unregistered: Names of images without a pose.
        unusable: Names of images that cannot be used, and why.
        misplaced: Names of registered images that contradict VIO; not in the ground truth.
        parts_from_vio_at_s: Times at which map and VIO move differently.
        median_inliers: Points that agree with a pose; None but for test recordings.
        median_error_px: Of their reprojection; None but for test recordings.
        tracking_worlds: Numbers of its tracking worlds.
        carried_by_vio: Number of frames between images whose ground truth is interpolated.
    """

    split: Literal["train", "test"]
    images: int
    registered: int
    unregistered: list[str]
    unusable: dict[str, str]
    misplaced: list[str]
    parts_from_vio_at_s: list[float]
    median_inliers: float | None
    median_error_px: float | None
    tracking_worlds: list[int]
    carried_by_vio: int


class MapSummary(Record, frozen=True):
    """All of `map.json`.

    Attributes:
        vioapr: Version of this program.
        params: The values of `MappingParams`.
        recordings: By id.
        model: The model.
        matches: The matches that it is made of.
        world: The world that it is in.
        seconds: How long every step took.
        reused_steps: Names of steps that an earlier run had finished.
        gt_folder: Where the ground truth of this map is in the scene.
        kept_gt: Ids of recordings whose ground truth in `gt/` is not mapping's, and was kept.
        gt_backup: Name of the folder in the scene that ground truth was copied to before this
            map's replaced it; "" if none was.
    """

    vioapr: str
    params: dict[str, str | bool | int | float]
    recordings: dict[str, RecordingSummary]
    model: ModelSummary
    matches: MatchSummary
    world: WorldSummary
    seconds: dict[str, float]
    reused_steps: list[str]
    gt_folder: str = "gt"
    kept_gt: list[str] = msgspec.field(default_factory=list[str])
    gt_backup: str = ""
