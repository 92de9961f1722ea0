"""How displayed content jumps: what a user sees of a localizer's corrections.

Content is anchored in the map, and an app shows it where `world_from_vio` says that the map lies.
While that stays the same, content stays put, however VIO moves the camera. Every change of it
moves content at once, by a distance that depends on where the content is. It is measured at two
places: at the camera, and 3 m ahead of it, where a turn of the map shows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.fusion.types import FrameInput
from vioapr.geometry.rigid import Rigid3

AHEAD_M = 3.0
"""Distance of the second place from the camera, along its optical axis."""

JUMP_M = 0.05
"""A step of content that is larger is a jump."""


class ContentSteps(NamedTuple):
    """How far content was moved at each frame of a walk, n of them.

    Attributes:
        step_m: Shape (n,), the farther of the two places; NaN where content was not shown both
            before and after, in one tracking world.
        shown_s: For how long it was shown, seconds; NaN without a clock.
    """

    step_m: NDArray[np.float64]
    shown_s: float

    @property
    def jumps_per_min(self) -> float:
        """Steps above 5 cm a minute, NaN where no content was shown or there is no clock."""
        jumps = int((self.step_m > JUMP_M).sum())
        return 60 * jumps / self.shown_s if self.shown_s > 0 else float("nan")

    @property
    def largest_m(self) -> float:
        """The largest step, NaN where no content was shown."""
        known = self.step_m[np.isfinite(self.step_m)]
        return float(known.max()) if len(known) else float("nan")


def content_steps(
    frames: FrameInput, world_from_vio: Rigid3, *, has_clock: bool = True
) -> ContentSteps:
    """Measure how content moves from frame to frame beyond the camera's own motion.

    Content that stands at a place by the new `world_from_vio` stood elsewhere by the last one; the
    step is the distance between the two. Where a frame's `world_from_vio` is not known, the last
    one goes on. After a loss or reset of tracking nothing is left to compare with: the first
    placement in a new tracking world is no step.

    Args:
        frames: Shape (n,), in order of time.
        world_from_vio: Shape (n,), live; NaN while unknown.
        has_clock: Whether the frames' times are seconds.
    """
    row = np.arange(len(frames.timestamp_s))
    tracking_ok = np.asarray(frames.tracking_ok)
    is_known = tracking_ok & np.asarray(world_from_vio.is_known)
    tracking_world = np.cumsum(~np.asarray(frames.keeps_world))
    latest = np.maximum.accumulate(np.where(is_known, row, -1))
    before = np.concatenate([[-1], latest[:-1]])
    is_shown = tracking_ok & (before >= 0) & (tracking_world[before] == tracking_world)

    camera_m = frames.vio_from_cam.translation_m
    ahead_m = frames.vio_from_cam.apply(np.array([0.0, 0.0, AHEAD_M]))
    new, old = world_from_vio.at(row), world_from_vio.at(np.maximum(before, 0))
    moved_m = [np.linalg.norm(new.apply(x) - old.apply(x), axis=-1) for x in (camera_m, ahead_m)]
    step_m = np.where(is_known, np.maximum(*moved_m), 0.0)
    times = np.asarray(frames.timestamp_s, dtype=np.float64)
    shown_s = float(np.diff(times, prepend=times[:1])[is_shown].sum())
    return ContentSteps(np.where(is_shown, step_m, np.nan), shown_s if has_clock else float("nan"))
