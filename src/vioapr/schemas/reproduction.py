"""The files of a reproduction: printed figures, notes of what is done, and the results."""

from __future__ import annotations

from typing import Literal

import msgspec

from vioapr.schemas.base import Record

Kind = Literal["median", "levels"]
Place = Literal["outdoor", "indoor"]
Figures = tuple[float, ...]
"""Of kind median: m, deg. Of kind levels: % within the high, medium and low level."""


class Levels(Record, frozen=True):
    """Percentages of a scene's frames within three levels of accuracy.

    Attributes:
        levels: % within the high, medium and low level.
        share: % of the test frames that are counted; None for all of them.
    """

    levels: Figures
    share: float | None = None


class PrintedCell(Record, frozen=True):
    """The printed figures of a regressor in a scene.

    Attributes:
        raw: The regressor alone.
        fused: With VIO-APR.
    """

    raw: Figures | Levels
    fused: Figures | Levels = msgspec.field(name="vio-apr")


class PrintedTable(Record, frozen=True):
    """One of the paper's tables.

    Attributes:
        number: The table's.
        group: Where its scenes are.
        kind: Of its figures.
        rows: By subset of frames, scene and model.
    """

    number: int
    group: Place
    kind: Kind
    rows: dict[str, dict[str, dict[str, PrintedCell]]]


class ImageCounts(Record, frozen=True):
    """Images of a scene.

    Attributes:
        train: To learn from.
        test: To test with.
    """

    train: int
    test: int


class PaperTables(Record, frozen=True):
    """`paper_tables.json`: the paper's Tables 1 (images) and 2-5, as printed.

    Attributes:
        source: The paper's title.
        images: By scene.
        tables: Tables 2-5.
    """

    source: str
    images: dict[str, ImageCounts]
    tables: tuple[PrintedTable, ...]


class ReferenceMedians(Record, frozen=True):
    """`reference_medians.json`: published raw medians, by scene and model.

    Attributes:
        source: Where they were published.
        sevenscenes: On 7-Scenes.
        cambridge: On Cambridge Landmarks.
    """

    source: str
    sevenscenes: dict[str, dict[str, Figures]] = msgspec.field(name="7scenes")
    cambridge: dict[str, dict[str, Figures]]


class TrainingSettings(Record, frozen=True, kw_only=True):
    """`settings.json`: all that decides the result of a training, besides the images.

    The members with defaults may be newer than a note; without them, it was trained so.

    Attributes:
        scenes: Names of the scenes that it learns, in order.
        weights: Name of the file of the backbone's first weights, or None.
        epochs: Of the first stage.
        position_epochs: Of the second stage, which learns positions alone.
        position_jitter: As jitter, in the second stage.
        position_hue: As hue, in the second stage.

    All others are as in `RegressorSpec`, `TrainingParams` and what they hold.
    """

    scenes: tuple[str, ...]
    weights: str | None = None
    epochs: int = 400
    batch_size: int = 32
    resize: int = 256
    crop: int = 224
    lr: float = 1e-4
    weight_decay: float = 5e-4
    schedule: str = "constant"
    loss: str = "learnable"
    position_weight: float = 0.0
    rotation_weight: float = -3.0
    rotation: str = "log-quat"
    orientation_layers: int = 6
    jitter: float = 0.5
    hue: float = 0.1
    seed: int = 0
    eps: float = 1e-8
    position_epochs: int = 0
    position_jitter: float = 0.5
    position_hue: float = 0.2


class ImportNote(Record, frozen=True):
    """`imported.json`: a scene is imported, all of it.

    Attributes:
        source: The folder that it is from.
    """

    source: str


class PredictionNote(Record, frozen=True):
    """`predicted.json`: the test recordings of a scene are predicted, all of them.

    Attributes:
        regressor: SHA-256 of the regressor's file.
        images: How many were predicted.
        right_scene: In how many the network saw the right scene.
    """

    regressor: str
    images: int
    right_scene: int


class Pair(Record, frozen=True):
    """A figure of ours and the paper's; None where there is none."""

    ours: Figures | None
    paper: Figures | None

    @property
    def difference(self) -> Figures | None:
        """Ours minus the paper's."""
        if self.ours is None or self.paper is None:
            return None
        return tuple(a - b for a, b in zip(self.ours, self.paper, strict=True))


class PublishedPair(Pair, frozen=True):
    """A figure of ours and a published one of other authors."""

    paper: Figures | None = msgspec.field(name="published")


class Line(Record, frozen=True):
    """A scene over a subset of its test frames.

    Attributes:
        subset: A key of `SUBSETS`.
        method: Whose subset, and whose poses are `fused`.
        scene: Its name, or `AVERAGE`, the mean over the group's scenes.
        raw: The regressor alone: on all test frames, but for "only optimized", where the paper
            counts these frames.
        fused: The method's.
        share: Of the test frames, %, that `fused` counts.
        raw_same: The regressor alone on the very frames that `fused` counts, ours.
    """

    subset: str
    method: str
    scene: str
    raw: Pair
    fused: Pair
    share: Pair
    raw_same: Figures | None


class Comparison(Record, frozen=True):
    """One of the paper's tables for one regressor.

    Attributes:
        number: The table's.
        place: Where its scenes are.
        kind: Of its figures.
        model: The regressor's name.
        lines: The paper's, then those over all frames, which the paper does not have.
    """

    number: int
    place: Place
    kind: Kind
    model: str
    lines: tuple[Line, ...]


class ReferenceLine(Record, frozen=True):
    """A scene's raw medians, m and deg, over all its test frames.

    Attributes:
        scene: Its name.
        medians: By model.
        dfnet: DFNet's in the published predictions, for scale; it is not trained here.
    """

    scene: str
    medians: dict[str, PublishedPair]
    dfnet: Figures | None


class ReproducedTraining(TrainingSettings, frozen=True, kw_only=True):
    """The settings of a network that was trained.

    Attributes:
        model: The network's name.
    """

    model: str


class Reproduction(Record, frozen=True, kw_only=True, omit_defaults=True):
    """`reproduction.json`: the results.

    Attributes:
        title: The data set's.
        differences: In what the trainings are not as published.
        notes: What else one must know to read the tables.
        trainings: All networks.
        tables: Beside the paper's, of a data set with trackers.
        scenes: Beside published medians, of other data sets.
    """

    title: str
    differences: tuple[str, ...]
    notes: tuple[str, ...]
    trainings: tuple[ReproducedTraining, ...]
    tables: tuple[Comparison, ...] | None = None
    scenes: tuple[ReferenceLine, ...] | None = None
