"""Predictions that come late: the poses that the tracker had when their pictures were taken."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from vioapr.geometry.rigid import Rigid3, between, interpolate

LONGEST_S = 5.0
"""How far back poses are remembered."""

_FARTHEST_S = 0.1
"""Largest distance of a picture's time from a remembered frame's."""


class _Frame(NamedTuple):
    timestamp_s: float
    vio_from_cam: Rigid3


class RecentPoses:
    """The tracker's poses of the last seconds, in the tracking world of now."""

    def __init__(self) -> None:
        """Start without any."""
        self._frames: deque[_Frame] = deque()

    def add(
        self, timestamp_s: float, vio_from_cam: Rigid3 | None, *, tracking_reset: bool = False
    ) -> None:
        """Note a frame; None for one without tracking, after which nothing before it holds."""
        if vio_from_cam is None or tracking_reset:
            self._frames.clear()
        if vio_from_cam is None:
            return
        self._frames.append(_Frame(timestamp_s, vio_from_cam))
        while self._frames[0].timestamp_s < timestamp_s - LONGEST_S:
            self._frames.popleft()

    def carry(self, timestamp_s: float, world_from_cam: Rigid3) -> Rigid3 | None:
        """A pose of an earlier time as of the newest frame, moved on as VIO has moved.

        Args:
            timestamp_s: When its picture was taken.
            world_from_cam: What was predicted for it.

        Returns:
            None if the tracker's pose at that time is not known any more.
        """
        then = self._at(timestamp_s)
        if then is None:
            return None
        return world_from_cam @ between(then, self._frames[-1].vio_from_cam)

    def _at(self, timestamp_s: float) -> Rigid3 | None:
        """The tracker's pose then, between its two frames."""
        if not self._frames:
            return None
        times = np.array([frame.timestamp_s for frame in self._frames])
        after = int(np.searchsorted(times, timestamp_s))
        if after < len(times) and times[after] == timestamp_s:
            return self._frames[after].vio_from_cam
        if after in (0, len(times)):
            nearest = self._frames[min(after, len(times) - 1)]
            is_near = abs(nearest.timestamp_s - timestamp_s) <= _FARTHEST_S
            return nearest.vio_from_cam if is_near else None
        before, later = self._frames[after - 1], self._frames[after]
        share = (timestamp_s - before.timestamp_s) / (later.timestamp_s - before.timestamp_s)
        gap_s = min(timestamp_s - before.timestamp_s, later.timestamp_s - timestamp_s)
        if gap_s > _FARTHEST_S:
            return None
        return interpolate(before.vio_from_cam, later.vio_from_cam, np.asarray(share))
