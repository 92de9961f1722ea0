"""Long walks with fewer frames: neighbouring frames share their view, and say little more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vioapr.evaluation.cases import Case
from vioapr.fusion.pairing import PairedFrames

MOST_FRAMES = 1200
"""Predictions of a walk that are used: five minutes at 4 Hz."""


def thin(case: Case, most: int = MOST_FRAMES) -> Case:
    """The case with at most a number of predictions, evenly spread.

    Frames without a prediction go too, unless they tell of a loss or of a new tracking world. A
    walk of no more frames stays as it is.
    """
    inputs = case.frames.inputs
    if len(case.frames) <= most:
        return case
    rows = np.flatnonzero(inputs.has_apr)
    is_kept = ~np.asarray(inputs.tracking_ok) | np.asarray(inputs.tracking_reset)
    is_kept[rows[:: max(-(-len(rows) // most), 1)]] = True
    kept = np.flatnonzero(is_kept)
    names = case.frames.names
    frames = PairedFrames(inputs.at(kept), None if names is None else tuple(names[k] for k in kept))
    return replace(case, frames=frames, gt_world_from_cam=case.gt_world_from_cam.at(kept))
