"""The frames that a fusion method steps through, its estimates, and its interface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Self

from vioapr.fusion.easing import Eased
from vioapr.geometry.arrays import Array, Mask
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_at


class Labelled(IntEnum):
    """Numbers in files and graphs, each with a meaning for people."""

    meaning: str

    def __new__(cls, value: int, meaning: str) -> Self:
        """Make a member of its number and of what it means."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.meaning = meaning
        return member

    @property
    def label(self) -> str:
        """The name in files and tables."""
        return self.name.lower()


class Status(Labelled):
    """Where a frame's pose comes from (paper, Figure 2)."""

    UNLOCALIZED = 0, "no pose, all numbers nan: nothing is known, the tracker is lost, or not here"
    TRACKED = 1, "VIO, carried on from earlier frames: this frame has no prediction that is used"
    KEYFRAME = 2, "the prediction, which VIO confirms (method vio-apr)"
    OPTIMIZED = 3, "the method computed it, in place of this frame's prediction"
    PREDICTED = 4, "the prediction, unchecked: method apr, or the tracker is lost (chain)"


class LocalizationState(Labelled):
    """What to tell people about where they are; by methods that judge themselves."""

    SEARCHING = 0, "no prediction yet, or too few that agree"
    LOCALIZED = 1, "predictions and motion agree"
    UNCERTAIN = 2, "found before, but predictions contradict each other or the motion by now"
    NOT_HERE = 3, "predictions and motion contradict: another place than the map's, or wiring"
    LOST = 4, "the tracker does not know its pose"


class FrameInput(NamedTuple):
    """One frame of one or more walks; every field has the same leading batch axes (...).

    Where `has_apr` or `tracking_ok` is false, the values of that pose do not matter but must
    be finite (use the identity).

    Attributes:
        timestamp_s: Shape (...), seconds.
        apr_world_from_cam: The regressor's prediction.
        has_apr: Shape (...), whether there is one.
        vio_from_cam: The tracker's pose, in a tracking world of its own.
        tracking_ok: Shape (...), whether the tracker knows its pose.
        tracking_reset: Shape (...), whether the tracker's world is a new one since this frame.
            Whether a frame without tracking implies it for the next one is up to the method:
            `chain` keeps what it knew and verifies it, others start again.
        apr_sigma_m: Shape (...), the standard deviation of the predicted position per axis
            that the regressor states, m; NaN or not above 0 where it states none. None if it
            never does. Methods without use for it ignore it.
        apr_sigma_rad: The same of its orientation: about each axis, rad.
    """

    timestamp_s: Array
    apr_world_from_cam: Rigid3
    has_apr: Mask
    vio_from_cam: Rigid3
    tracking_ok: Mask
    tracking_reset: Mask
    apr_sigma_m: Array | None = None
    apr_sigma_rad: Array | None = None

    @property
    def keeps_world(self) -> Mask:
        """Shape (...), whether what was known of the tracker's world still holds."""
        return self.tracking_ok & ~self.tracking_reset

    def at(self, index: object) -> FrameInput:
        """The frames at an index of the leading axes."""
        return tree_at(self, index)


class Estimate(NamedTuple):
    """A frame's pose, as known when the frame arrived (the live view).

    Attributes:
        world_from_cam: The pose; NaN while unlocalized.
        world_from_vio: Where the tracking world lies in the map; apply it to content that is
            anchored to the map. NaN while unknown.
        status: Shape (...), integers of `Status`.
        confirmed_run: Shape (...), integers: n says that this and the n - 1 predictions
            before it have just been confirmed as keyframes (the retrospective view).
        sigma_position_m: Shape (...), standard deviation per axis in metres, or None where
            the method has none.
        sigma_orientation_deg: Shape (...), standard deviation about each axis in degrees, or
            None.
        sigma_position_axes_m: Shape (..., 3), along each axis of the world, or None.
        sigma_orientation_axes_deg: Shape (..., 3), about each axis of the world, or None.
        localization_state: Shape (...), integers of `LocalizationState`, or None.
        confidence: Shape (...), the probability that the pose is the right one of those that
            are possible, and its error therefore within what the sigmas say; 0 where there is
            no pose. None where the method has none.
        eased: Where to show content that is not to jump; by `session.step` only, else None.
    """

    world_from_cam: Rigid3
    world_from_vio: Rigid3
    status: Array
    confirmed_run: Array
    sigma_position_m: Array | None = None
    sigma_orientation_deg: Array | None = None
    sigma_position_axes_m: Array | None = None
    sigma_orientation_axes_deg: Array | None = None
    localization_state: Array | None = None
    confidence: Array | None = None
    eased: Eased | None = None


@dataclass(frozen=True)
class Method:
    """A fusion method: a pure step on explicit state, registered in `methods.py`.

    Attributes:
        name: Name on the command line.
        summary: One line for people.
        params_type: Frozen dataclass of the parameters, all with defaults.
        init: From parameters, batch shape and an array that gives backend and dtype, the
            state before the first frame.
        step: From parameters, state and a frame, the next state and the estimate.
        carry: The same for frames of which none has a prediction, for less work; None where
            there is no shorter way.
        is_batched: Whether leading batch axes are allowed; if not, the batch shape is ().
        extra: The optional package group that it needs, if any.
        uses_apr_sigma: Whether it uses what a regressor states of its predictions' errors.
    """

    name: str
    summary: str
    params_type: type
    init: Callable[[Any, tuple[int, ...], Array], Any]
    step: Callable[[Any, Any, FrameInput], tuple[Any, Estimate]]
    carry: Callable[[Any, Any, FrameInput], tuple[Any, Estimate]] | None = None
    is_batched: bool = True
    extra: str | None = None
    uses_apr_sigma: bool = False
