"""Parameters of method `chain`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import tyro

from vioapr.errors import ParameterError
from vioapr.fusion.chain.window import RECENT
from vioapr.geometry.arrays import Array, constant, namespace

Gravity = Literal["auto", "known", "estimate", "none"]
_GRAVITIES = ("auto", "known", "estimate", "none")


@dataclass(frozen=True)
class ChainParams:
    """One default for indoors and outdoors, good and bad odometry.

    What a calibration knows of tracker and regressor takes the place of what is otherwise
    learned while walking. The switches at the end are for ablations.
    """

    gravity: Annotated[Gravity, tyro.conf.arg(name="gravity")] = "auto"
    """known: the map is z up and the tracker y up, so that only the heading is sought.
    estimate: both know up, and the tilt between them is sought and hardly changes.
    none: the tracker does not know up.
    auto: as the predictions say."""
    window: Annotated[int, tyro.conf.arg(name="window")] = 28
    """Past predictions that are smoothed over: more reach further back and take longer."""
    drift_prior: Annotated[float, tyro.conf.arg(name="drift-prior")] = 2.0
    """How strongly little drift is expected of a tracker that knows up: the logarithm of how
    much less likely ten times the drift is, before any prediction is seen."""
    tilt_drift_rad2_per_m: Annotated[float, tyro.conf.arg(name="tilt-drift")] = -1.0
    """Variance by which the tracker's tilt drifts in a metre, rad^2/m; below 0: learned."""
    heading_drift_rad2_per_m: Annotated[float, tyro.conf.arg(name="heading-drift")] = -1.0
    """The same of its heading."""
    position_drift_m2_per_m: Annotated[float, tyro.conf.arg(name="position-drift")] = -1.0
    """The same of its position per axis, m^2/m."""
    scale_error: Annotated[float, tyro.conf.arg(name="scale-error")] = 0.01
    """Standard deviation of the tracker's scale."""
    sigma_position_factor: Annotated[float, tyro.conf.arg(name="sigma-position-factor")] = 1.0
    """By which stated sigmas of position are multiplied, as a calibration finds them true."""
    sigma_orientation_factor: Annotated[float, tyro.conf.arg(name="sigma-orientation-factor")] = 1.0
    """The same of orientation."""
    hypotheses: Annotated[bool, tyro.conf.arg(name="hypotheses")] = True
    """Hold a second hypothesis beside the leading one."""
    view_weights: Annotated[bool, tyro.conf.arg(name="view-weights")] = True
    """Predictions from the same place and direction share one weight."""
    heavy_tails: Annotated[bool, tyro.conf.arg(name="heavy-tails")] = True
    """Predictions far from the others lose weight (Cauchy errors instead of Gaussian ones)."""
    look_at: Annotated[bool, tyro.conf.arg(name="look-at")] = True
    """Correct positions for wrong directions: regressors err as if turned about what they
    look at."""
    estimate_drift: Annotated[bool, tyro.conf.arg(name="estimate-drift")] = True
    """Judge the tracker's drift by the predictions; else the least drift is assumed."""
    not_here: Annotated[bool, tyro.conf.arg(name="not-here")] = True
    """Give no answer where predictions and motion contradict each other."""

    def __post_init__(self) -> None:
        if not (self.window > RECENT and self.window == int(self.window)):
            raise ParameterError(
                f"--window: expected a whole number of more than {RECENT}, got {self.window}"
            )
        for flag, value, least in (
            ("--drift-prior", self.drift_prior, 0.0),
            ("--scale-error", self.scale_error, 0.0),
            ("--tilt-drift", self.tilt_drift_rad2_per_m, -math.inf),
            ("--heading-drift", self.heading_drift_rad2_per_m, -math.inf),
            ("--position-drift", self.position_drift_m2_per_m, -math.inf),
            ("--sigma-position-factor", self.sigma_position_factor, 0.0),
            ("--sigma-orientation-factor", self.sigma_orientation_factor, 0.0),
        ):
            if not least <= value < math.inf:
                expected = "a number" if least == -math.inf else f"a number of at least {least:g}"
                raise ParameterError(f"{flag}: expected {expected}, got {value}")
        if self.gravity not in _GRAVITIES:
            raise ParameterError(
                f"--gravity: expected one of {', '.join(_GRAVITIES)}, got {self.gravity!r}"
            )


def in_a_column(values: Sequence[float | Array], like: Array) -> Array:
    """Parameters one below the other, shape (..., k, 1).

    Args:
        values: Numbers; or arrays of shape (...), where the walks of a batch differ, or an exported
            file takes them as input.
        like: Gives backend and dtype.
    """
    if all(isinstance(value, float | int) for value in values):
        return constant(np.array([values], dtype=np.float64).T, like)
    zero = 0 * like[..., 0, 0]
    return namespace(like).stack([zero + value for value in values], axis=-1)[..., None]
