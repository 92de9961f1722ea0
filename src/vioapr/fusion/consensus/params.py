"""Parameters of method `consensus`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from vioapr.errors import ParameterError
from vioapr.fusion.consensus.votes import RECENT

Gravity = Literal["auto", "known", "estimate", "none"]
_GRAVITIES = ("auto", "known", "estimate", "none")


@dataclass(frozen=True)
class ConsensusParams:
    """One default for indoors and outdoors, good and bad odometry.

    The four switches are for ablations: they are on unless something is to be shown.
    """

    gravity: Annotated[Gravity, tyro.conf.arg(name="gravity")] = "auto"
    """known: the map is z up and the tracker y up, so that only the heading is sought.
    estimate: both know up, and the tilt between them is constant and sought.
    none: the tracker does not know up, and is trusted only as far as it proves right.
    auto: as estimate where the predictions say that map and tracker are upright, else as none."""
    votes: Annotated[int, tyro.conf.arg(name="votes")] = 28
    """Past predictions that are remembered: more reach further back and take longer."""
    drift_prior: Annotated[float, tyro.conf.arg(name="drift-prior")] = 3.0
    """How strongly little drift is expected of a tracker that knows up: the logarithm of how
    much less likely ten times the drift is, before any vote is seen."""
    heavy_tails: Annotated[bool, tyro.conf.arg(name="heavy-tails")] = True
    """Votes far from the others lose weight (Cauchy errors instead of Gaussian ones)."""
    view_weights: Annotated[bool, tyro.conf.arg(name="view-weights")] = True
    """Votes from the same place and direction share one weight."""
    estimate_drift: Annotated[bool, tyro.conf.arg(name="estimate-drift")] = True
    """Judge VIO's drift by the votes; else the least drift is assumed."""
    look_at: Annotated[bool, tyro.conf.arg(name="look-at")] = True
    """Correct votes' positions for their wrong directions: regressors err as if turned about
    what they look at."""

    def __post_init__(self) -> None:
        if not (self.votes > RECENT and self.votes == int(self.votes)):
            raise ParameterError(
                f"--votes: expected a whole number of more than {RECENT}, got {self.votes}"
            )
        if not 0 <= self.drift_prior < float("inf"):
            raise ParameterError(
                f"--drift-prior: expected a number of at least 0, got {self.drift_prior}"
            )
        if self.gravity not in _GRAVITIES:
            raise ParameterError(
                f"--gravity: expected one of {', '.join(_GRAVITIES)}, got {self.gravity!r}"
            )
