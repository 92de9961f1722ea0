"""`calibration.toml`: what walks with ground truth say of a tracker and a regressor."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec

from vioapr.schemas.base import Document, Record

Gravity = Literal["auto", "known", "estimate", "none"]
Positive = Annotated[float, msgspec.Meta(gt=0, le=1e9)]
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=1e9)]
Finite = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Count = Annotated[int, msgspec.Meta(ge=0)]


class MadeFrom(Record, frozen=True):
    """The walks that a pair was measured on.

    Attributes:
        walks: Their names, `set/walk`.
        metres: Walked in all.
        seconds: They took in all.
        frames: With ground truth, in all.
    """

    walks: tuple[str, ...]
    metres: NotNegative
    seconds: NotNegative
    frames: Count


class TrackerDrift(Record, frozen=True):
    """What the tracker errs by, as measured against ground truth over stretches of 5 m.

    Attributes:
        tilt_rad2_per_m: Variance that each of two axes of tilt gains in a metre.
        heading_rad2_per_m: The same of heading.
        position_m2_per_m: The same of each axis of position, beside a wrong scale.
        scale: True metres per metre of the tracker.
        scale_spread: Standard deviation of the scale between walks and stretches.
        tilt_deg: Between the map's up and the tracker's.
        shares_up: Whether they agree in it.
    """

    tilt_rad2_per_m: NotNegative
    heading_rad2_per_m: NotNegative
    position_m2_per_m: NotNegative
    scale: Positive
    scale_spread: NotNegative
    tilt_deg: NotNegative
    shares_up: bool


class PredictionErrors(Record, frozen=True):
    """What the regressor errs by.

    Attributes:
        position_axes_m: Along the camera's x, y and z: robust standard deviations.
        orientation_axes_rad: About them.
        position_tail: 95th percentile of the distance over its median; 1.8 for Gaussian errors.
        orientation_tail: The same of the angle.
        view_length_m: Motion after which errors have lost most of what they had in common.
        look_at_m: Distance of the point about which predictions err as if turned; 0 for none.
    """

    position_axes_m: tuple[NotNegative, NotNegative, NotNegative]
    orientation_axes_rad: tuple[NotNegative, NotNegative, NotNegative]
    position_tail: NotNegative
    orientation_tail: NotNegative
    view_length_m: NotNegative
    look_at_m: NotNegative


class ChainSetting(Record, frozen=True):
    """What method `chain` is to assume: the setting that did best on these walks.

    Attributes:
        gravity: As the method's parameter.
        tilt_drift_rad2_per_m: As the method's parameter; -1 to learn the drift while walking.
        heading_drift_rad2_per_m: The same.
        position_drift_m2_per_m: The same.
        scale_error: As the method's parameter.
        sigma_position_factor: As the method's parameter.
        sigma_orientation_factor: As the method's parameter.
    """

    gravity: Gravity
    tilt_drift_rad2_per_m: Finite
    heading_drift_rad2_per_m: Finite
    position_drift_m2_per_m: Finite
    scale_error: NotNegative
    sigma_position_factor: Positive = 1.0
    sigma_orientation_factor: Positive = 1.0


class Disagreement(Record, frozen=True):
    """How far predictions lie from the method's answers, as seen on these walks.

    What is far from it elsewhere tells of another tracker, regressor or place.

    Attributes:
        position_m: Median distance.
        orientation_deg: Median angle.
        spread: Factor by which walks differ from these, either way; at least 1.
    """

    position_m: NotNegative
    orientation_deg: NotNegative
    spread: Annotated[float, msgspec.Meta(ge=1, le=1e9)]


class Ratios(Record, frozen=True):
    """Errors over those of the raw regressor, geometric means over walks.

    Attributes:
        median_m: Of the median position error.
        median_deg: Of the median orientation error.
        p95_m: Of the 95th percentile of the position error.
        p95_deg: Of the 95th percentile of the orientation error.
    """

    median_m: NotNegative
    median_deg: NotNegative
    p95_m: NotNegative
    p95_deg: NotNegative


class Coverage(Record, frozen=True):
    """Share of frames whose error lies within 1, 2 and 3 stated sigmas, 0 to 1."""

    one: Share
    two: Share
    three: Share


class LeftOut(Record, frozen=True):
    """Each walk judged with what the others say.

    Attributes:
        walks: How many.
        calibrated: With that.
        uncalibrated: With nothing given.
        position: Coverage of calibrated sigmas of position.
        orientation: The same of orientation.
    """

    walks: Count
    calibrated: Ratios
    uncalibrated: Ratios
    position: Coverage
    orientation: Coverage


class PairCalibration(Record, frozen=True):
    """Of one tracker with one regressor.

    Attributes:
        tracker: Its name.
        regressor: Its name.
        made_from: The walks.
        setting: What method `chain` is to assume.
        disagreement: By which a use elsewhere is checked.
        drift: Of the tracker.
        errors: Of the regressor.
        left_out: Figures, or None of a single walk.
    """

    tracker: str
    regressor: str
    made_from: MadeFrom
    setting: ChainSetting
    disagreement: Disagreement
    drift: TrackerDrift
    errors: PredictionErrors
    left_out: LeftOut | None = None


class Calibration(Document, frozen=True, kw_only=True):
    """The members of `calibration.toml`.

    Attributes:
        made_by: Program and version.
        date: When, ISO 8601.
        pairs: Every tracker with every regressor.
    """

    FORMAT: ClassVar[str] = "vioapr calibration"
    VERSION: ClassVar[int] = 1

    made_by: str = ""
    date: str = ""
    pairs: Annotated[tuple[PairCalibration, ...], msgspec.Meta(min_length=1)]
