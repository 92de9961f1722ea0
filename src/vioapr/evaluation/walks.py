"""Walks on disk: folders with ground truth, odometries and predictions of one walk."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError, ParameterError, VioAprError
from vioapr.formats.registry import read_trajectory
from vioapr.formats.sigma import SUFFIX as SIGMA_SUFFIX
from vioapr.formats.sigma import read_sigmas_beside
from vioapr.fusion.pairing import PairedFrames, pair_frames
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, poses_of_frames


@dataclass(frozen=True)
class WalkFolder:
    """Where the files of one walk are.

    Attributes:
        set_name: Name of the folder that holds the walk's folder.
        walk: Name of the walk's folder.
        gt: The file `gt.*`.
        vios: The files `vio_<name>.*`, by name.
        aprs: The files `apr_<name>.*`, by name; what a regressor states of its errors is read
            from `apr_<name>.sigma.csv` beside them.
    """

    set_name: str
    walk: str
    gt: Path
    vios: dict[str, Path]
    aprs: dict[str, Path]


@dataclass(frozen=True, eq=False)
class Case:
    """One walk with one odometry and one regressor, ready to be fused and judged.

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


def find_walks(paths: Sequence[Path]) -> list[WalkFolder]:
    """All walk folders at or below the given paths, in natural order.

    Raises:
        VioAprError: No path is given, one is missing, or has no walks.
    """
    if not paths:
        raise ParameterError("WALKS: expected at least one folder with walks, got none")
    walks: dict[Path, WalkFolder] = {}
    for path in paths:
        if not path.is_dir():
            problem = "a file" if path.exists() else "nothing"
            raise FormatError(path, f"expected a folder with walks, got {problem}")
        found = [walk for folder in _folders(path) if (walk := _read_folder(folder))]
        if not found:
            raise FormatError(
                path,
                "expected walks: folders with a file gt.*, at least one vio_*.* and at least "
                "one apr_*.*; found none",
            )
        walks |= {walk.gt.parent.resolve(): walk for walk in found}
    return list(walks.values())


def _folders(path: Path) -> Iterator[Path]:
    yield path
    yield from sorted(p for p in path.rglob("*") if p.is_dir())


def _read_folder(folder: Path) -> WalkFolder | None:
    files = sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))
    gts = [p for p in files if p.name.startswith("gt.")]
    vios, aprs = _by_name(files, "vio_"), _by_name(files, "apr_")
    if not (gts and vios and aprs):
        return None
    if len(gts) > 1:
        names = ", ".join(p.name for p in gts)
        raise FormatError(folder, f"expected one ground truth file gt.*, got {names}")
    real = folder.resolve()
    return WalkFolder(real.parent.name, real.name, gts[0], vios, aprs)


def _by_name(files: Iterable[Path], prefix: str) -> dict[str, Path]:
    """Files of a prefix, by the part of their name between it and the first dot."""
    named: dict[str, Path] = {}
    for path in files:
        name = path.name.removeprefix(prefix).split(".")[0]
        if not path.name.startswith(prefix) or _is_sidecar(path):
            continue
        if name in named:
            raise FormatError(
                path, f"expected one file of this name, found also {named[name].name}"
            )
        named[name] = path
    return named


def _is_sidecar(path: Path) -> bool:
    """Whether a file accompanies a trajectory, e.g. a table of its uncertainties."""
    return path.name.removesuffix(".gz").endswith((SIGMA_SUFFIX, ".json"))


def load_cases(
    walks: Sequence[WalkFolder],
    *,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    tick: Callable[[], object] | None = None,
) -> list[Case]:
    """Read every walk with each of its odometries and regressors.

    Args:
        walks: From `find_walks`.
        tolerance_s: Largest difference of timestamps within a frame, s.
        tick: Called after every walk, for progress.

    Raises:
        VioAprError: A file is wrong, or its times or names do not meet the others'.
    """
    cases = []
    for walk in walks:
        gt = read_trajectory(walk.gt)
        vios = {name: read_trajectory(path) for name, path in walk.vios.items()}
        aprs = {name: read_trajectory(path) for name, path in walk.aprs.items()}
        sigmas = {name: read_sigmas_beside(path, aprs[name]) for name, path in walk.aprs.items()}
        for vio_name, vio in vios.items():
            for apr_name, apr in aprs.items():
                try:
                    frames = pair_frames(apr, vio, tolerance_s, apr_sigmas=sigmas[apr_name])
                    gt_poses = _gt_of_frames(gt, frames, apr.is_timed and vio.is_timed, tolerance_s)
                except VioAprError as error:
                    raise AssociationError(
                        f"{walk.gt.parent}: {walk.aprs[apr_name].name} and "
                        f"{walk.vios[vio_name].name}: {error}"
                    ) from None
                cases.append(Case(walk.set_name, walk.walk, vio_name, apr_name, frames, gt_poses))
        if tick is not None:
            tick()
    return cases


def _gt_of_frames(
    gt: Trajectory, frames: PairedFrames, is_timed: bool, tolerance_s: float
) -> Rigid3:
    """Ground truth of every frame, NaN where it has none."""
    timestamp_s = frames.timestamp_s if is_timed else None
    poses = poses_of_frames(gt, timestamp_s, frames.names, tolerance_s)
    if not poses.is_known.any():
        raise AssociationError("no frame has ground truth: no common times or names")
    return poses
