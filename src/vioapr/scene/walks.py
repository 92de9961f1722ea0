"""Walks as files: ground truth, VIO and predictions of one walk, found and written.

A walk is a folder of its own, or, without predictions, files with a common beginning:

    <set>/<walk>/gt.*  vio_<name>.*  apr_<name>.*  apr_<name>.sigma.csv
    <set>/<walk>_gt.*  <walk>_<name>.*

Every trajectory is of any format that `formats.registry` knows, gzipped or not. The tables
`apr_<name>.sigma.csv` hold what a regressor states of its errors; see `formats.stated_sigmas`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import (
    FileMissingError,
    FormatError,
    ParameterError,
    UnwritableError,
    VioAprError,
)
from vioapr.files.paths import AnyPath
from vioapr.files.text import natural_key
from vioapr.formats import stated_sigmas, tum
from vioapr.scene.scene import Scene
from vioapr.trajectory import Trajectory

GT_NAME, VIO_PREFIX, APR_PREFIX = "gt", "vio_", "apr_"


@dataclass(frozen=True)
class WalkFiles:
    """The files of one walk.

    Attributes:
        set_name: Name of the folder that holds the walk's folder, or its files.
        walk: Name of the walk.
        gt: The ground truth.
        vios: The trackers' files, by name.
        aprs: The regressors' files, by name.
    """

    set_name: str
    walk: str
    gt: Path
    vios: dict[str, Path]
    aprs: dict[str, Path]

    @property
    def paths(self) -> tuple[Path, ...]:
        """All its files, with the tables beside predictions."""
        tables = map(stated_sigmas.path_beside, self.aprs.values())
        return (self.gt, *self.vios.values(), *self.aprs.values(), *filter(None, tables))


Skip = Callable[[VioAprError], object]
"""Called with what is wrong with files that are left out."""


def find_walks(paths: AnyPath | Sequence[AnyPath], skip: Skip | None = None) -> list[WalkFiles]:
    """Find the walks with ground truth, VIO and predictions at or below some folders.

    Args:
        paths: The folders, or one.
        skip: Called for what is left out: walks of which a part is missing, and folders with two
            files of one name. None refuses these folders, and says nothing of missing parts.

    Returns:
        The walks in the order of the paths and, below each, of their folders; none twice.

    Raises:
        ParameterError: There is no path.
        FileMissingError: A path is missing.
        FormatError: No path holds such a walk; without `skip`, also if one of them does not, or
            a walk has two files of one name.
    """
    paths = [paths] if isinstance(paths, str | os.PathLike) else paths
    if not paths:
        raise ParameterError("paths: expected at least one folder with walks, got none")
    walks: dict[Path, WalkFiles] = {}
    problems: list[VioAprError] = []
    for path in map(Path, paths):
        if not path.exists():
            raise FileMissingError(path, "expected a folder with walks, got nothing")
        if not path.is_dir():
            raise FormatError(path, "expected a folder with walks, got a file")
        given = len(problems)
        found = [
            walk
            for walk in walks_at(path, None if skip is None else problems.append)
            if walk.vios and walk.aprs
        ]
        if skip is not None:
            problems += _unfinished_walks(path)
        if not found and len(problems) == given:
            problems.append(
                FormatError(
                    path,
                    "expected walks: folders with a file gt.*, at least one vio_*.* and at least "
                    "one apr_*.*; found none",
                )
            )
        walks |= {walk.gt.parent.resolve(): walk for walk in found}
        if problems and skip is None:
            raise problems[0]
    if problems and not walks:
        raise problems[0]
    for problem in problems:
        assert skip is not None  # else the first one was raised
        skip(problem)
    return list(walks.values())


def _unfinished_walks(path: Path) -> Iterator[FormatError]:
    """Name the folders at or below a path that hold two of a walk's three parts."""
    for folder in (path, *sorted(p for p in path.rglob("*") if p.is_dir())):
        names = [p.name for p in folder.iterdir() if p.is_file() and not is_sidecar(p)]
        has = {
            "gt.*": any(name.split(".")[0] == GT_NAME for name in names),
            "vio_*.*": any(name.startswith(VIO_PREFIX) for name in names),
            "apr_*.*": any(name.startswith(APR_PREFIX) for name in names),
        }
        if sum(has.values()) == len(has) - 1:
            (missing,) = (part for part, is_there in has.items() if not is_there)
            yield FormatError(folder, f"expected a walk with a file {missing}, found none")


def walks_at(path: Path, skip: Skip | None = None) -> Iterator[WalkFiles]:
    """Find walks of both layouts, with whatever files they have.

    Args:
        path: A folder at or below which walks are, or the common beginning of one walk's files,
            e.g. `tum10hz/advio-18`, or its ground truth.
        skip: Called for folders that are left out because a walk has two files of one name.

    Raises:
        FormatError: A walk has two files of one name, and there is no `skip`.
    """
    if path.is_dir():
        for folder in (path, *sorted(p for p in path.rglob("*") if p.is_dir())):
            try:
                yield from list(_walks_in(folder))
            except FormatError as error:
                if skip is None:
                    raise
                skip(error)
    elif path.parent.is_dir():
        for walk in _walks_in(path.parent):
            if path.name == walk.walk or walk.gt == path:
                yield walk


def is_sidecar(path: Path) -> bool:
    """Whether a file accompanies a trajectory, e.g. a table of its uncertainties."""
    return path.name.removesuffix(".gz").endswith((stated_sigmas.SUFFIX, ".json"))


def _walks_in(folder: Path) -> Iterator[WalkFiles]:
    """Walks whose files are in this very folder."""
    files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")]
    files.sort(key=lambda path: natural_key(path.name))
    stem_of = {path: path.name.split(".")[0] for path in files}
    gts: dict[str, list[Path]] = {}
    for path, stem in stem_of.items():
        if stem == GT_NAME or stem.endswith(f"_{GT_NAME}"):
            gts.setdefault(stem.removesuffix(GT_NAME), []).append(path)
    for beginning, found in gts.items():
        named: dict[str, Path] = {}
        for path, stem in stem_of.items():
            if path in found or not stem.startswith(beginning) or is_sidecar(path):
                continue
            name = stem.removeprefix(beginning)
            # Of files with a common beginning, all but predictions are VIO, whatever their name.
            if beginning and not name.startswith((VIO_PREFIX, APR_PREFIX)):
                name = VIO_PREFIX + name
            if not name.startswith((VIO_PREFIX, APR_PREFIX)):
                continue
            if name in named:
                problem = f"expected one file of this name, found also {named[name].name}"
                raise FormatError(path, problem)
            named[name] = path
        if len(found) > 1 and named:
            names = ", ".join(path.name for path in found)
            raise FormatError(folder, f"expected one ground truth file gt.*, got {names}")
        here = folder.resolve()
        set_name, walk = (here.name, beginning[:-1]) if beginning else (here.parent.name, here.name)
        vios, aprs = (
            {k.removeprefix(prefix): path for k, path in named.items() if k.startswith(prefix)}
            for prefix in (VIO_PREFIX, APR_PREFIX)
        )
        yield WalkFiles(set_name, walk, found[0], vios, {} if beginning else aprs)


def write_walk(
    folder: Path,
    *,
    gt: Trajectory | None = None,
    vios: Mapping[str, Trajectory] | None = None,
    aprs: Mapping[str, Trajectory] | None = None,
    apr_sigmas: Mapping[str, stated_sigmas.Sigmas] | None = None,
) -> None:
    """Write files of a walk into its folder; files that are there already stay, or are replaced.

    Args:
        folder: The walk's; made if needed.
        gt: world_from_cam.
        vios: vio_from_cam, by name.
        aprs: world_from_cam, by the regressor's name.
        apr_sigmas: What the regressors state of their errors, by name.

    Raises:
        UnwritableError: A file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    if gt is not None:
        tum.write(folder / f"{GT_NAME}.tum", gt)
    for name, vio in (vios or {}).items():
        tum.write(folder / f"{VIO_PREFIX}{name}.tum", vio)
    for name, apr in (aprs or {}).items():
        path = folder / f"{APR_PREFIX}{name}.tum"
        tum.write(path, apr)
        if apr_sigmas is not None and name in apr_sigmas:
            stated_sigmas.write_sigmas_beside(path, apr, apr_sigmas[name])


def walk_file_names(vios: Sequence[str], aprs: Sequence[str]) -> list[str]:
    """Names of the files of `write_walk` with ground truth and these trackers and regressors."""
    names = [f"{GT_NAME}.tum", *(f"{VIO_PREFIX}{name}.tum" for name in vios)]
    for name in aprs:
        names += [f"{APR_PREFIX}{name}.tum", f"{APR_PREFIX}{name}{stated_sigmas.SUFFIX}"]
    return names


def write_walk_of_recording(folder: Path, scene: Scene, id_: str) -> bool:
    """Write a recording's ground truth and VIO, as far as it has them, into a walk's folder.

    Returns:
        Whether it has both.

    Raises:
        FileError: The recording is broken, or a file cannot be written.
    """
    recording, gt = scene.recording(id_), scene.gt(id_)
    tracker = "".join(c for c in recording.info.tracker.lower() if c.isalnum()) or "tracker"
    has_vio = bool(recording.frames.has_pose.any())
    vios = {tracker: recording.frames.to_trajectory()} if has_vio else {}
    write_walk(folder, gt=gt, vios=vios)
    return has_vio and gt is not None
