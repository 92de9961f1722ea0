"""Small things that several tests need."""

from __future__ import annotations

from typing import Any

import numpy as np

from vioapr.fusion.types import FrameInput
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import SimulatedWalk


def to_numpy(array: Any) -> np.ndarray:
    """An array of any backend as NumPy's."""
    if isinstance(array, np.ndarray | np.generic):
        return np.array(array)
    return np.array(np.from_dlpack(array))


def random_rigid(rng: np.random.Generator, batch: tuple[int, ...] = (), xp: Any = np) -> Rigid3:
    quats = quaternion.normalize(rng.standard_normal((*batch, 4)))
    return Rigid3(xp.asarray(rng.standard_normal((*batch, 3))), xp.asarray(quats))


def convert_frames(frames: FrameInput, xp: Any) -> FrameInput:
    """NumPy frames in another backend."""
    return FrameInput(
        *(
            Rigid3(*(xp.asarray(part) for part in value))
            if isinstance(value, Rigid3)
            else None
            if value is None
            else xp.asarray(value)
            for value in frames
        )
    )


def frames_of(walk: SimulatedWalk) -> FrameInput:
    """A simulated walk's frames, all with prediction and tracking, shape (n,)."""
    count = len(walk.gt)
    return FrameInput(
        walk.gt.timestamp_s,
        walk.apr.target_from_source,
        np.ones(count, dtype=bool),
        walk.vio.target_from_source,
        np.ones(count, dtype=bool),
        np.zeros(count, dtype=bool),
    )
