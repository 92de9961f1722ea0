"""Whether a calibration fits what it is used on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.fusion.types import FrameInput, Status
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.calibration import PairCalibration

_FAR = 2.0
"""Times the spread between the calibration's walks, from which on a walk is unlike them."""

_FEW = 10


def explain_misfit(
    pair: PairCalibration,
    inputs: FrameInput,
    world_from_cam: Rigid3,
    status: NDArray[np.integer],
) -> str | None:
    """Say that predictions and answers disagree more than they did on the calibration's walks.

    A tracker that drifts more than the calibrated one, another regressor and another place all
    do that.

    Args:
        pair: That the walk was fused with, by method `chain`.
        inputs: Frames of the walk, shape (n,).
        world_from_cam: The answers, shape (n,).
        status: Theirs, shape (n,), integers of `Status`.

    Returns:
        A sentence, or None where it fits or too few frames have a prediction and an answer.
    """
    rows = np.isin(status, (Status.TRACKED, Status.OPTIMIZED))
    rows = rows & np.asarray(inputs.has_apr) & np.asarray(inputs.tracking_ok)
    expected = pair.disagreement
    if rows.sum() < _FEW or not expected.position_m > 0 < expected.orientation_deg:
        return None
    apr, own = inputs.apr_world_from_cam.at(rows), world_from_cam.at(rows)
    gap_m = float(np.median(rigid.distance_m(apr, own)))
    gap_deg = float(np.median(rigid.angle_deg(apr, own)))
    most = _FAR * expected.spread
    if gap_m <= most * expected.position_m and gap_deg <= most * expected.orientation_deg:
        return None
    return (
        f"predictions lie {gap_m:.2g} m and {gap_deg:.2g} deg from the answers (medians), and "
        f"{expected.position_m:.2g} m and {expected.orientation_deg:.2g} deg on the calibration's "
        "walks: is it of another tracker, regressor or place? Calibrate with walks of this one"
    )
