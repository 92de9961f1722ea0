"""`build.json`: what `vioapr build` made of a scene, how good it is, and what is missing."""

from __future__ import annotations

from typing import ClassVar

from vioapr.schemas.base import Document, Record
from vioapr.schemas.calibration import LeftOut
from vioapr.schemas.results import MethodReliabilityRecord, RowRecord, SummaryRecord


class CheckedScene(Record, frozen=True, kw_only=True):
    """What checking the scene found.

    Attributes:
        recordings: How many there are.
        frames: In all.
        images: In all.
        notes: What is not wrong and worth knowing.
    """

    recordings: int
    frames: int
    images: int
    notes: tuple[str, ...] = ()


class MappedScene(Record, frozen=True, kw_only=True):
    """Where the poses of the recordings come from.

    Attributes:
        is_mapped: Whether a map was made; else ground truth was there.
        registered: Images that the map knows.
        images: Images that were to be mapped.
        points: Of the map.
    """

    is_mapped: bool
    registered: int = 0
    images: int = 0
    points: int = 0


class AccuracyRecord(Record, frozen=True, kw_only=True):
    """Methods on the test recordings of one kind of tracker.

    Attributes:
        vio: The tracker's name.
        walks: How many test recordings.
        raw: The raw regressor on all its predictions.
        rows: A row a method and subset of the frames.
        reliability: A row a method.
    """

    vio: str
    walks: int
    raw: SummaryRecord
    rows: tuple[RowRecord, ...]
    reliability: tuple[MethodReliabilityRecord, ...]


class SupportRecord(Record, frozen=True, kw_only=True):
    """Test frames with about as many training images from near in the same direction.

    Attributes:
        least: Fewest such images.
        most: Most such images; null for any number above.
        frames: How many test frames.
        raw_median_m: Median position error of the raw predictions there; null without any.
        fused_median_m: The same of method chain.
        raw_median_deg: Median orientation error of the raw predictions.
        fused_median_deg: The same of method chain.
    """

    least: int
    most: int | None
    frames: int
    raw_median_m: float | None
    fused_median_m: float | None
    raw_median_deg: float | None
    fused_median_deg: float | None


class BuiltLocalizer(Record, frozen=True, kw_only=True):
    """A regressor with all that was found of it, and the file that phones run.

    Attributes:
        model: The regressor's name.
        file: The exported localizer, in the build's folder.
        bytes: Its size.
        accuracy: Of the test recordings, one a kind of tracker; empty if there are none.
        support: Errors by the number of training images from near, most at the end.
        left_out: How the calibration does on walks left out; null from fewer than two walks.
        is_calibrated: Whether the file carries the calibration.
        why_not: What kept tracker and regressor from being calibrated; "" if nothing did.
    """

    model: str
    file: str
    bytes: int
    accuracy: tuple[AccuracyRecord, ...] = ()
    support: tuple[SupportRecord, ...] = ()
    left_out: LeftOut | None = None
    is_calibrated: bool = False
    why_not: str = ""


class GapRecord(Record, frozen=True, kw_only=True):
    """An area of the place that lacks views.

    Attributes:
        position_m: Its middle, x and y of the world.
        radius_m: About how far it reaches.
        headings_deg: Directions in which few looked, counterclockwise from x.
        asked: Test images that looked there in vain.
    """

    position_m: tuple[float, float]
    radius_m: float
    headings_deg: tuple[float, ...]
    asked: int


class CoverageRecord(Record, frozen=True, kw_only=True):
    """From where, and in which directions, the place was recorded.

    Attributes:
        cell_m: Side of the cells that the ground is divided into.
        cells: How many somebody walked on.
        all_round: Share of the cells from which people looked all round.
        one_way: Share of the cells that were passed through one way only.
        one_walk: Share of the directions with images that are of one recording alone.
        gaps: The areas that lack views most, the worst first.
    """

    cell_m: float
    cells: int
    all_round: float
    one_way: float
    one_walk: float
    gaps: tuple[GapRecord, ...]


class BuildSummary(Document, frozen=True, kw_only=True):
    """The members of `build.json`.

    Attributes:
        scene: Name of the scene.
        vioapr: The version that built it.
        checked: What checking found.
        mapped: Where poses come from.
        localizers: The best first, which is in `localizer.onnx`.
        coverage: Of the training images.
        advice: What to record next, a sentence each.
        areas: Where in the place to record it, a sentence for each gap of the coverage.
        seconds: How long every step took, over all its runs, by its name and its localizer's.
    """

    FORMAT: ClassVar[str] = "vioapr build"
    VERSION: ClassVar[int] = 1

    scene: str
    vioapr: str
    checked: CheckedScene
    mapped: MappedScene
    localizers: tuple[BuiltLocalizer, ...]
    coverage: CoverageRecord
    advice: tuple[str, ...]
    areas: tuple[str, ...]
    seconds: dict[str, float]
