"""What a user can choose of mapping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vioapr.errors import ParameterError


@dataclass(frozen=True)
class MappingParams:
    """How a place is mapped.

    Attributes:
        mapper: vio starts from the tracker's poses, and takes incremental where that fails;
            incremental grows the model image by image, which takes several times as long; global
            solves all rotations, then all positions at once.
        max_rate_hz: Largest number of images a second of every recording that are mapped; 0 for
            all. Frames between them get their ground truth by VIO.
        max_image_size: Images are scaled down to this many pixels along their longer side
            before features are looked for.
        max_features: Features of an image at most.
        sequential: Every image is matched with this many that follow it in its recording.
        loops: Every image is matched with this many that look alike, of other recordings, other
            tracking worlds and other times.
        spatial: Every image is matched with this many that are near and look the same way, by VIO
            and earlier matches.
        refine_intrinsics: Whether focal lengths are adjusted. auto: only those that the
            recordings do not know.
        min_inliers: Points that must agree before an image of a test recording is registered.
        allow_partial: Go on with the largest model where recordings share no view.
        threads: Processor threads; -1 for all. With one, the same map comes out every time.
        seed: Of all random draws.
    """

    mapper: Literal["vio", "incremental", "global"] = "vio"
    max_rate_hz: float = 3.0
    max_image_size: int = 1600
    max_features: int = 2048
    sequential: int = 6
    loops: int = 5
    spatial: int = 6
    refine_intrinsics: Literal["auto", "yes", "no"] = "auto"
    min_inliers: int = 30
    allow_partial: bool = False
    threads: int = -1
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("max_image_size", 64), ("max_features", 100), ("min_inliers", 6)):
            if getattr(self, name) < least:
                value = getattr(self, name)
                raise ParameterError(f"{name}: expected at least {least}, got {value}")
        if not 0 <= self.max_rate_hz < float("inf"):
            raise ParameterError(f"max_rate_hz: expected at least 0, got {self.max_rate_hz}")
        for name in ("sequential", "loops", "spatial"):
            if getattr(self, name) < 0:
                raise ParameterError(f"{name}: expected at least 0, got {getattr(self, name)}")
        if self.sequential + self.spatial + self.loops == 0:
            raise ParameterError("expected some images to be matched, got 0 of every kind")
