"""A plain folder of images, with any trajectory file of a tracker, of ground truth, or of both."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import read_trajectory
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    flat_names,
    id_of,
    list_image_names,
    no_poses,
    one_walk,
    require_folder,
    spread_poses,
    timed_gt,
    tracking_of,
)
from vioapr.importers.diagnostics import turn_y_up
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory, nearest_rows

_DEFAULT_RATE_HZ = 1.0


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A folder of images.

    Raises:
        FormatError: It is none.
    """
    require_folder(source, "a folder of images")
    return one_walk(lambda: _read_walk(source, options))


def _read_walk(source: Path, options: ImportOptions) -> Walk:
    names = list_image_names(source)
    if not names:
        raise FormatError(source, "expected images (.jpg, .png), found none")
    vio, gt = (
        None if path is None else read_trajectory(path, options=ReadOptions())
        for path in (options.poses, options.gt)
    )
    times, clock = _find_times(source, names, vio, gt, options)
    is_measured = not clock.startswith("no timestamps")
    walk = Walk(
        id=options.id or id_of(source.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="" if options.poses is None else options.tracker or options.poses.name,
            source="folder of images",
            clock="device" if is_measured else "frame-rate",
        ),
        source=source,
        timestamp_s=times,
        image_names=flat_names(names),
        images=(f"{source}/{name}" for name in names),
        vio_from_cam=no_poses(len(names)),
        tracking=tracking_of(no_poses(len(names))),
    )
    walk.note(f"time: {clock}") if is_measured else walk.warn(f"time: {clock}")
    if vio is not None and options.poses is not None:
        _add_vio(walk, names, vio, options.poses)
    if gt is not None and options.gt is not None:
        rows, of = _pair(source, names, times, gt, options.gt)
        walk.gt = timed_gt(gt.at_rows(of), times[rows])
    return walk


def _add_vio(walk: Walk, names: list[str], vio: Trajectory, path: Path) -> None:
    rows, of = _pair(walk.source, names, walk.timestamp_s, vio, path)
    unused = len(vio) - len(of)
    if unused:
        walk.warn(f"{path.name}: {unused} of {len(vio)} poses belong to no image, and are left out")
    paired = vio.at_rows(of)
    if vio.target != "vio":
        world, turned = turn_y_up(paired)
        paired = paired.with_transforms(turned)
        walk.note(f"world of {path.name}: {world}")
    walk.vio_from_cam = spread_poses(paired, rows, len(walk))
    walk.tracking = tracking_of(walk.vio_from_cam)


def _find_times(
    source: Path,
    names: list[str],
    vio: Trajectory | None,
    gt: Trajectory | None,
    options: ImportOptions,
) -> tuple[NDArray[np.float64], str]:
    """When each image was taken, and how that is known."""
    if options.rate_hz is not None:
        return np.arange(len(names)) / options.rate_hz, f"no timestamps: {options.rate_hz:g} Hz"
    stamps = _stamps_of_names(names)
    timed = [track for track in (vio, gt) if track is not None and track.is_timed]
    if stamps is not None and (not timed or _overlaps(stamps, timed[0].timestamp_s)):
        return stamps, "from the images' names"
    for track in timed:
        if len(track) == len(names):
            return track.timestamp_s, "the trajectory's: pose k is taken to be of image k"
    if timed:
        raise FormatError(
            source,
            f"expected images named by timestamps, or as many as poses ({len(timed[0])}), got "
            f"{len(names)} images as {names[0]}: give --rate-hz, or a trajectory with names",
        )
    rate_hz = _DEFAULT_RATE_HZ
    return np.arange(len(names)) / rate_hz, f"no timestamps: counted at {rate_hz:g} Hz"


def _stamps_of_names(names: list[str]) -> NDArray[np.float64] | None:
    """Seconds from names as 1305031102.175304.png, or in milli-, micro- or nanoseconds."""
    try:
        values = np.array([float(_stem(name)) for name in names])
    except ValueError:
        return None
    if not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        return None
    # Of the years since 2001, counted from 1970.
    for scale, least in ((1e9, 1e18), (1e6, 1e15), (1e3, 1e12)):
        if values[0] >= least:
            return np.array([int(_stem(name).split(".")[0]) / scale for name in names])
    return values


def _stem(name: str) -> str:
    return name.rsplit(".", 1)[0]


def _overlaps(left_s: NDArray[np.float64], right_s: NDArray[np.float64]) -> bool:
    return bool(left_s[0] <= right_s[-1] and right_s[0] <= left_s[-1])


def _pair(
    source: Path,
    images: list[str],
    timestamp_s: NDArray[np.float64],
    track: Trajectory,
    path: Path,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which image each pose is of: rows of images, rows of the track.

    Raises:
        FormatError: No pose is of an image.
    """
    if track.names is not None:
        row_of = {image: row for row, image in enumerate(images)}
        row_of |= {_stem(image): row for row, image in enumerate(images)}
        found = [(row_of.get(PurePosixPath(name).name), of) for of, name in enumerate(track.names)]
        pairs = sorted((row, of) for row, of in found if row is not None)
    elif track.is_timed:
        pairs = _pair_by_time(timestamp_s, track.timestamp_s)
    else:
        pairs = [(k, k) for k in range(len(track))] if len(track) == len(images) else []
    if not pairs:
        what = "names" if track.names else "timestamps" if track.is_timed else "number of poses"
        raise FormatError(
            path, f"expected {what} that fit the {len(images)} images of {source}, "
            f"as {images[0]}, got none that do"
        )  # fmt: skip
    rows, of = np.array(pairs, dtype=np.intp).T
    return rows, of


def _pair_by_time(
    timestamp_s: NDArray[np.float64], track_s: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Mutually nearest, within half a frame."""
    tolerance_s = 0.5 * float(np.median(np.diff(timestamp_s))) if len(timestamp_s) > 1 else 0.05
    nearest, back = nearest_rows(timestamp_s, track_s), nearest_rows(track_s, timestamp_s)
    return [
        (row, int(of))
        for row, of in enumerate(nearest)
        if back[of] == row and abs(timestamp_s[row] - track_s[of]) <= tolerance_s
    ]


IMPORTER = Importer(
    name="images",
    title="a folder of images with any trajectory file",
    layout="a folder of .jpg or .png; --poses and --gt name trajectory files of any format",
    read=read,
    uses=frozenset({"poses", "gt", "rate_hz", "tracker"}),
)
