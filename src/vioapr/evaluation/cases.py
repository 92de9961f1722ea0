"""Cases to evaluate: a walk with one odometry and one regressor, its frames paired."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, VioAprError
from vioapr.evaluation.walk_tracks import WalkReader
from vioapr.formats.stated_sigmas import read_sigmas_beside
from vioapr.fusion.pairing import PairedFrames, pair_frames
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.walks import WalkFiles
from vioapr.trajectory import DEFAULT_TOLERANCE_S, poses_of_frames
from vioapr.work.progress import Tick, ignore


@dataclass(frozen=True, eq=False)
class Case:
    """One walk with one odometry and one regressor, ready to be fused and evaluated.

    Attributes:
        set_name: Name of the set.
        walk: Name of the walk.
        vio: Name of the odometry, e.g. "sim0".
        apr: Name of the regressor, e.g. "posenet".
        frames: The frames, n of them.
        gt_world_from_cam: Ground truth, shape (n,); NaN where a frame has none.
    """

    set_name: str
    walk: str
    vio: str
    apr: str
    frames: PairedFrames
    gt_world_from_cam: Rigid3

    @property
    def has_gt(self) -> NDArray[np.bool_]:
        """Shape (n,), the frames that have ground truth."""
        return self.gt_world_from_cam.is_known

    @property
    def group(self) -> tuple[str, str, str]:
        """Set, kind of odometry and regressor; `sim0` and `sim1` are two draws of one kind."""
        return self.set_name, re.sub(r"(?<=[^\d])\d+$", "", self.vio), self.apr

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.set_name}/{self.walk}, VIO {self.vio}, regressor {self.apr}"


def load_cases(
    walks: Sequence[WalkFiles],
    *,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    reader: WalkReader | None = None,
    tick: Tick = ignore,
) -> list[Case]:
    """Read every walk with each of its odometries and regressors.

    Args:
        walks: From `scene.walks.find_walks`.
        tolerance_s: Largest difference of timestamps within a frame, s.
        reader: Reads the files, and says what looks wrong with them; None checks nothing.
        tick: Called after every walk, for progress.

    Raises:
        VioAprError: A file is wrong, or its times or names do not meet the others'.
    """
    cases: list[Case] = []
    for walk in walks:
        tracks = (reader or WalkReader()).read(walk, tolerance_s)
        gt, vios, aprs = tracks.gt, tracks.vios, tracks.aprs
        sigmas = {name: read_sigmas_beside(path, aprs[name]) for name, path in walk.aprs.items()}
        for vio_name, vio in vios.items():
            for apr_name, apr in aprs.items():
                try:
                    frames = pair_frames(apr, vio, tolerance_s, apr_sigmas=sigmas[apr_name])
                    is_timed = apr.is_timed and vio.is_timed
                    timestamp_s = frames.timestamp_s if is_timed else None
                    gt_poses = poses_of_frames(gt, timestamp_s, frames.names, tolerance_s)
                    if not gt_poses.is_known.any():
                        raise AssociationError(
                            "no frame has ground truth: no common times or names"
                        )
                except VioAprError as error:
                    raise AssociationError(
                        f"{walk.gt.parent}: {walk.aprs[apr_name].name} and "
                        f"{walk.vios[vio_name].name}: {error}"
                    ) from None
                cases.append(Case(walk.set_name, walk.walk, vio_name, apr_name, frames, gt_poses))
        tick()
    return cases
