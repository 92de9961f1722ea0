"""Golden vectors: inputs and outputs of fusion methods, to test any implementation with."""

from __future__ import annotations

import json
from typing import Annotated, ClassVar

from msgspec import UNSET, Meta, UnsetType

from vioapr.schemas.base import Document, Record, to_plain

Flag = Annotated[int, Meta(ge=0, le=1)]
FlatPose = Annotated[tuple[float | None, ...], Meta(min_length=7, max_length=7)]
"""x y z qx qy qz qw; null where a number is unknown."""

One = Annotated[tuple[float | None, ...], Meta(min_length=1, max_length=1)]
Axes = Annotated[tuple[float | None, ...], Meta(min_length=3, max_length=3)]


class GoldenInputs(Record, frozen=True, kw_only=True):
    """The inputs of a fusion step, under the contract's names.

    Attributes:
        timestamp_s: Of the image, s; a number that single precision holds.
        apr_world_from_cam: The regressor's pose, or null.
        apr_sigma_position_m: The regressor's own, per axis, m, or null where it states none.
        apr_sigma_orientation_deg: The regressor's own, deg, or null where it states none.
        has_apr: 1 if this frame has a regressor's pose, else 0.
        vio_from_cam: The tracker's pose, or null.
        tracking_ok: 1 if the tracker knows its pose, else 0.
        tracking_reset: 1 if the tracker's world is a new one since this frame, else 0.
        image_timestamp_s: When the prediction's image was taken, s.
        image_vio_from_cam: The tracker's pose then, or null.
    """

    timestamp_s: float
    apr_world_from_cam: FlatPose | None
    apr_sigma_position_m: float | None
    apr_sigma_orientation_deg: float | None
    has_apr: Flag
    vio_from_cam: FlatPose | None
    tracking_ok: Flag
    tracking_reset: Flag
    image_timestamp_s: float
    image_vio_from_cam: FlatPose | None


class GoldenOutputs(Record, frozen=True, kw_only=True):
    """The outputs of a fusion step, under the contract's names.

    Attributes:
        status: Where the pose comes from: see the contract's statuses.
        confirmed_run: n: this and the n - 1 predictions before it are right.
        world_from_cam: The fused pose.
        world_from_vio: The tracking world in the map.
        display_from_vio: `world_from_vio` for content that is not to jump.
        display_left_m: How far content is from its place, m.
        display_left_deg: By which angle it is turned, deg.
        display_placed_anew: 1 if it was put in place without easing, else 0.
        sigma_position_m: Per axis, m; missing where the method has none, as the next five.
        sigma_orientation_deg: Per axis, deg.
        sigma_position_axes_m: Along the world's axes, m.
        sigma_orientation_axes_deg: About the world's axes, deg.
        localization_state: What to tell people: see the contract's localization states.
        confidence: Probability that the pose is the right one.
    """

    status: Annotated[int, Meta(ge=0)]
    confirmed_run: Annotated[int, Meta(ge=0)]
    world_from_cam: FlatPose
    world_from_vio: FlatPose
    display_from_vio: FlatPose
    display_left_m: One
    display_left_deg: One
    display_placed_anew: Flag
    sigma_position_m: One | UnsetType = UNSET
    sigma_orientation_deg: One | UnsetType = UNSET
    sigma_position_axes_m: Axes | UnsetType = UNSET
    sigma_orientation_axes_deg: Axes | UnsetType = UNSET
    localization_state: Annotated[int, Meta(ge=0)] | UnsetType = UNSET
    confidence: One | UnsetType = UNSET


class GoldenFrame(Record, frozen=True):
    """A frame of the walk.

    Attributes:
        inputs: Of the fusion step.
        outputs: Of the fusion step, with the method's default parameters, when all frames
            before it were taken in.
    """

    inputs: GoldenInputs
    outputs: GoldenOutputs


class GoldenVectors(Document, frozen=True, kw_only=True):
    """A walk through a fusion method, in NumPy and double precision.

    Inputs and outputs are rounded to single precision; NaN is null.

    Attributes:
        method: Name of the fusion method.
        frames: In order of time.
    """

    FORMAT: ClassVar[str] = "vioapr golden vectors"
    VERSION: ClassVar[int] = 2

    method: str
    frames: tuple[GoldenFrame, ...]

    def to_json(self) -> str:
        """The text of a file: a line a frame."""
        head = {"format": self.FORMAT, "version": self.VERSION, "method": self.method}
        rows = ",\n".join(json.dumps(to_plain(frame)) for frame in self.frames)
        return f'{json.dumps(head)[:-1]}, "frames": [\n{rows}\n]}}\n'
