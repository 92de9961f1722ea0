"""What a user can choose of localization in a map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import ParameterError


@dataclass(frozen=True)
class PointMapParams:
    """What images are localized in.

    Attributes:
        map: Folder of a COLMAP model, in the world that answers are wanted in. By default the
            ground truth of the training recordings, if it came from elsewhere, else what
            `vioapr map` made.
        map_images: What the names of that model's images are relative to; by default looked for
            beside it.
        max_rate_hz: Of recordings with ground truth from elsewhere, at most this many images a
            second are taken; 0 for all.
    """

    map: Path | None = None
    map_images: Path | None = None
    max_rate_hz: float = 3.0

    def __post_init__(self) -> None:
        if not 0 <= self.max_rate_hz < float("inf"):
            raise ParameterError(f"max_rate_hz: expected at least 0, got {self.max_rate_hz}")
        if self.map_images is not None and self.map is None:
            raise ParameterError("`map_images` names the images of a map: give `map` too")


@dataclass(frozen=True)
class LocalizationParams:
    """How images are localized.

    Attributes:
        views: Images of the map to match with: those that look most alike.
        min_inliers: Features that must agree with a pose.
        seed: Of RANSAC.
    """

    views: int = 10
    min_inliers: int = 30
    seed: int = 0
