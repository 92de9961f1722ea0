"""The headers of regressors and of states of training, beside their tensors.

Both are safetensors with one of these documents in JSON as metadata, and a copy of it beside them
for people, and for a quick look without PyTorch.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import msgspec

from vioapr.errors import ParameterError
from vioapr.schemas.base import Document, Record

REGRESSOR_FILE, STATE_FILE = "regressor.safetensors", "state.safetensors"

IMAGE_MEAN, IMAGE_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's, RGB, of values from 0 to 1: networks take images less the mean, by the deviation."""

Setting = bool | int | float | str | None
Settings = dict[str, Setting | dict[str, Setting]]
"""A resolved configuration by name. It is plain: parameters come and go, and a file keeps those
that its network was trained with."""


def note_of(path: Path) -> Path:
    """The path of the copy of a file's header."""
    return path.with_suffix(".json")


LeftOutKind = Literal["recordings", "parts", "validation"]


class RetrievalShape(Record, frozen=True):
    """The size of an index of training images.

    Attributes:
        views: Images in it.
        components: Numbers that describe each.
        neighbours: Most similar images that a pose is interpolated from.
    """

    views: Annotated[int, msgspec.Meta(ge=1)]
    components: Annotated[int, msgspec.Meta(ge=1)]
    neighbours: Annotated[int, msgspec.Meta(ge=1)] = 5

    def __post_init__(self) -> None:
        if self.neighbours > self.views:
            raise ParameterError(
                f"neighbours: expected at most the {self.views} views, got {self.neighbours}"
            )


class PointsShape(Record, frozen=True):
    """The size of a map of points.

    Attributes:
        views: Pictures in it.
        retrieval: The index that finds them.
        camera: Of all its pictures, and of those that it may be asked for: fx, fy, cx, cy over the
            image's width and height.
        points: Of each picture.
        keypoints: Of the image that is asked for.
        neighbours: Views that are compared with it.
    """

    views: Annotated[int, msgspec.Meta(ge=1)]
    retrieval: RetrievalShape
    camera: tuple[float, float, float, float]
    points: Annotated[int, msgspec.Meta(ge=64)] = 256
    keypoints: Annotated[int, msgspec.Meta(ge=64)] = 1024
    neighbours: Annotated[int, msgspec.Meta(ge=1)] = 10

    def __post_init__(self) -> None:
        if self.neighbours > self.views:
            raise ParameterError(
                f"neighbours: expected at most the {self.views} views, got {self.neighbours}"
            )


class RegressorSpec(Record, frozen=True):
    """All that one must know to build a regressor's network and to feed it.

    Attributes:
        model: Name of the network.
        scenes: Names of the scenes that it knows, in the order of their numbers.
        rotation: Name of the rotation's code.
        resize: Images are resized to resize x resize pixels, whatever their shape.
        crop: The network sees the middle crop x crop pixels of them.
        dropout: While training; None for the model's own.
        orientation_layers: Of MS-Transformer's second transformer.
        retrieval: Of model `retrieval` alone.
        points: Of model `points` alone.
    """

    model: str
    scenes: tuple[str, ...]
    rotation: str = "log-quat"
    resize: int = 256
    crop: int = 224
    dropout: float | None = None
    orientation_layers: int = 6
    retrieval: RetrievalShape | msgspec.UnsetType = msgspec.UNSET
    points: PointsShape | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        if not self.scenes:
            raise ParameterError("scenes: expected at least one, got none")
        if not 32 <= self.crop <= self.resize <= 4096:
            raise ParameterError(
                f"expected 32 <= crop <= resize <= 4096 pixels, "
                f"got `crop` {self.crop} and `resize` {self.resize}"
            )
        if self.dropout is not None and not 0 <= self.dropout < 1:
            raise ParameterError(f"dropout: expected 0 to below 1, got {self.dropout}")
        if not 1 <= self.orientation_layers <= 12:
            raise ParameterError(
                f"orientation_layers: expected 1 to 12, got {self.orientation_layers}"
            )


class EpochRecord(Record, frozen=True, omit_defaults=True):
    """The record of an epoch of training.

    Attributes:
        loss: Mean over the epoch's batches.
        lr: Learning rate of the last batch.
        images_per_s: Of all processes together.
        validation_position_m: Median error on the validation recordings; None without any, as
            all that follow.
        validation_orientation_deg: Median error.
        validation_score: For comparing epochs; lower is better.
        validation_sigma_position: By how much the stated uncertainties are too small.
        validation_sigma_orientation: As the previous.
    """

    loss: float
    lr: float
    images_per_s: float
    validation_position_m: float | None = None
    validation_orientation_deg: float | None = None
    validation_score: float | None = None
    validation_sigma_position: float | None = None
    validation_sigma_orientation: float | None = None


class FittedIndex(Record, frozen=True):
    """How an index of training images was fitted, and how far off it is on what it left out.

    Attributes:
        candidates: Images that were described, of which the index's views were chosen.
        left_out: What was left out of the index in turn, to measure by: `recordings`, `parts` of
            the only recording, or `validation` recordings.
        position_m: Median error on what was left out.
        orientation_deg: Median error.
        seconds: That it took.
    """

    candidates: int
    left_out: LeftOutKind
    position_m: float
    orientation_deg: float
    seconds: float


class FittedMap(Record, frozen=True):
    """How a map of points was fitted, and how far off it is on what it left out.

    Attributes:
        views: Pictures in it.
        points: Of all views together.
        left_out: See `FittedIndex`.
        position_m: Median error where it is sure; None if nowhere.
        orientation_deg: Median error where it is sure.
        sure: Share of the images left out where it is.
        seconds: That it took.
    """

    views: int
    points: int
    left_out: LeftOutKind
    position_m: float | None
    orientation_deg: float | None
    sure: float
    seconds: float


class Trained(Record, frozen=True, omit_defaults=True):
    """The origin of a regressor, for people.

    Attributes:
        epoch: The epoch that the weights are of, from 1.
        params: The training's parameters.
        last_epoch: Of the same number.
        images: How many there were to learn from.
        weights: Where the backbone's first weights come from, and their licence; None for random
            ones.
        index: Of model `retrieval`.
        map: Of model `points`.
    """

    epoch: int | None = None
    params: Settings | None = None
    last_epoch: EpochRecord | None = None
    images: int | None = None
    weights: str | None = None
    index: FittedIndex | None = None
    map: FittedMap | None = None


class RegressorHeader(Document, frozen=True, kw_only=True):
    """The header of a regressor.

    Attributes:
        spec: The network.
        trained: Where its weights come from.
    """

    FORMAT: ClassVar[str] = "vioapr regressor"

    spec: RegressorSpec
    trained: Trained = Trained()


class RunIdentity(Record, frozen=True):
    """The parts of a run that must be the same for it to be resumed.

    Attributes:
        spec: The network.
        params: The parameters that decide the result.
        samples: Fingerprint of the images and poses.
    """

    spec: RegressorSpec
    params: Settings
    samples: str


class BegunEpoch(Record, frozen=True):
    """How far an epoch has come of which a state was kept.

    Attributes:
        steps: Batches that were learned from.
        images: In these.
        seconds: How long they took.
    """

    steps: int
    images: int
    seconds: float


class StateHeader(Document, frozen=True, kw_only=True):
    """The header of a training's state, after an epoch or within one.

    Attributes:
        run: Whose state.
        epochs: All finished epochs so far.
        begun: The epoch after them, if it was begun.
    """

    FORMAT: ClassVar[str] = "vioapr training state"

    run: RunIdentity
    epochs: tuple[EpochRecord, ...] = ()
    begun: BegunEpoch | None = None
