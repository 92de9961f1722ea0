"""Cases to evaluate: a walk with one odometry and one regressor, its frames paired."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, VioAprError
from vioapr.evaluation.walk_tracks import WalkReader, WalkTracks
from vioapr.formats.stated_sigmas import read_sigmas_beside
from vioapr.fusion.pairing import PairedFrames, check_pairing, pair_frames
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.walks import Skip, WalkFiles
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
        has_clock: Whether the frames' times are seconds, not numbers of frames.
    """

    set_name: str
    walk: str
    vio: str
    apr: str
    frames: PairedFrames
    gt_world_from_cam: Rigid3
    has_clock: bool = True

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
    skip: Skip | None = None,
    tick: Tick = ignore,
) -> list[Case]:
    """Read every walk with each of its odometries and regressors.

    Args:
        walks: From `scene.walks.find_walks`.
        tolerance_s: Largest difference of timestamps within a frame, s.
        reader: Reads the files, and says what looks wrong with them; None checks nothing.
        skip: Called for files that are left out: those that cannot be read, and those whose
            frames do not meet. None refuses them.
        tick: Called after every walk, for progress.

    Raises:
        VioAprError: A file is wrong, or its times or names do not meet the others', and there is
            no `skip`, or nothing else.
    """
    problems: list[VioAprError] = []
    leave_out = None if skip is None else problems.append
    reader = replace(reader or WalkReader(), skip=leave_out)
    cases: list[Case] = []
    for walk in walks:
        try:
            tracks = reader.read(walk, tolerance_s)
        except VioAprError as error:
            if leave_out is None:
                raise
            leave_out(error)
        else:
            for vio, apr in product(tracks.vios, tracks.aprs):
                try:
                    case = _pair_case(walk, tracks, vio, apr, tolerance_s)
                    predictions = len(tracks.aprs[apr])
                    for warning in check_pairing(case.frames, predictions, tolerance_s):
                        reader.report(f"{case.title}: {warning}")
                    cases.append(case)
                except VioAprError as error:
                    if leave_out is None:
                        raise
                    leave_out(error)
        tick()
    if problems and not cases:
        raise problems[0]
    for problem in problems:
        assert skip is not None  # else it was raised
        skip(problem)
    return cases


def _pair_case(
    walk: WalkFiles, tracks: WalkTracks, vio_name: str, apr_name: str, tolerance_s: float
) -> Case:
    """Pair the frames of one odometry and one regressor with ground truth."""
    apr, vio = tracks.aprs[apr_name], tracks.vios[vio_name]
    sigmas = read_sigmas_beside(walk.aprs[apr_name], apr)
    try:
        frames = pair_frames(apr, vio, tolerance_s, apr_sigmas=sigmas)
        has_clock = apr.is_timed and vio.is_timed
        timestamp_s = frames.timestamp_s if has_clock else None
        gt_poses = poses_of_frames(tracks.gt, timestamp_s, frames.names, tolerance_s)
        if not gt_poses.is_known.any():
            raise AssociationError("no frame has ground truth: no common times or names")
    except VioAprError as error:
        raise AssociationError(
            f"{walk.gt.parent}: {walk.aprs[apr_name].name} and {walk.vios[vio_name].name}: {error}"
        ) from None
    return Case(walk.set_name, walk.walk, vio_name, apr_name, frames, gt_poses, has_clock)
