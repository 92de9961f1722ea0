"""A plain folder of images, with any trajectory file of a tracker, of ground truth, or of both."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import require_folder
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import read_trajectory
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    flat_names,
    id_of,
    list_image_names,
    one_walk,
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
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the names of the images, pair the trajectories' poses with them."""
    names = list_image_names(source)
    if not names:
        raise FormatError(source, "expected images (.jpg, .png), found none")
    vio = None if options.poses is None else read_trajectory(options.poses, options=ReadOptions())
    gt = None if options.gt is None else read_trajectory(options.gt, options=ReadOptions())
    tracks = [track for track in (vio, gt) if track is not None]
    times, clock = find_times(source, names, tracks, options.rate_hz)
    is_measured = not clock.startswith("no timestamps")
    poses = Rigid3.unknown((len(names),))
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
        images=[f"{source}/{name}" for name in names],
        vio_from_cam=poses,
        tracking=tracking_of(poses),
    )
    is_said = is_measured or options.rate_hz is not None
    (walk.note if is_said else walk.warn)(f"time: {clock}")
    if vio is not None and options.poses is not None:
        file = options.poses.name
        rows, of = pair_images(source, names, times, vio, options.poses)
        if unused := len(vio) - len(of):
            text = f"{file}: {unused} of {len(vio)} poses belong to no image, and are left out"
            walk.warn(text)
        paired = vio.at_rows(of)
        if vio.target != "vio":
            world, turned = turn_y_up(paired)
            paired = paired.with_transforms(turned)
            walk.note(f"world of {file}: {world}")
        walk.vio_from_cam = spread_poses(paired, rows, len(walk))
        walk.tracking = tracking_of(walk.vio_from_cam)
    if gt is not None and options.gt is not None:
        rows, of = pair_images(source, names, times, gt, options.gt)
        walk.gt = timed_gt(gt.at_rows(of), times[rows])
    return walk


def find_times(
    source: Path, names: list[str], tracks: list[Trajectory], rate_hz: float | None
) -> tuple[NDArray[np.float64], str]:
    """When each image was taken, and how that is known.

    Args:
        source: The folder, for messages.
        names: Of its images, in order.
        tracks: Trajectories of the same walk, the one to trust most first.
        rate_hz: Frames per second, if the user says so.

    Raises:
        FormatError: Neither names nor trajectories tell.
    """
    if rate_hz is not None:
        return np.arange(len(names)) / rate_hz, f"no timestamps: {rate_hz:g} Hz"
    stamps = timestamps_of_names(names)
    timed = [track for track in tracks if track.is_timed]
    if stamps is not None:
        known_s = timed[0].timestamp_s if timed else stamps
        if stamps[0] <= known_s[-1] and known_s[0] <= stamps[-1]:
            return stamps, "from the images' names"
    for track in timed:
        if len(track) == len(names):
            return track.timestamp_s, "the trajectory's: pose k is taken to be of image k"
    if timed:
        raise FormatError(
            source,
            f"expected images named by timestamps, or as many as poses ({len(timed[0])}), got "
            f"{len(names)} images as {names[0]}: give `rate_hz`, or a trajectory with names",
        )
    rate_hz = _DEFAULT_RATE_HZ
    return np.arange(len(names)) / rate_hz, f"no timestamps: counted at {rate_hz:g} Hz"


def timestamps_of_names(names: list[str]) -> NDArray[np.float64] | None:
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


def pair_images(
    source: Path,
    images: list[str],
    timestamp_s: NDArray[np.float64],
    track: Trajectory,
    path: Path,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which image each pose is of: rows of images, rows of the track.

    By names, else by times (mutually nearest, within half a frame), else by order.

    Raises:
        FormatError: No pose is of an image.
    """
    if track.names is not None:
        row_of = {image: row for row, image in enumerate(images)}
        row_of |= {_stem(image): row for row, image in enumerate(images)}
        found = [(row_of.get(PurePosixPath(name).name), of) for of, name in enumerate(track.names)]
        pairs = sorted((row, of) for row, of in found if row is not None)
    elif track.is_timed:
        step_s = float(np.median(np.diff(timestamp_s))) if len(timestamp_s) > 1 else 0.1
        nearest = nearest_rows(timestamp_s, track.timestamp_s)
        back = nearest_rows(track.timestamp_s, timestamp_s)
        off_s = np.abs(timestamp_s - track.timestamp_s[nearest])
        pairs = [
            (row, int(of))
            for row, of in enumerate(nearest)
            if back[of] == row and off_s[row] <= 0.5 * step_s
        ]
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


IMPORTER = Importer(
    name="images",
    title="a folder of images with any trajectory file",
    layout="a folder of .jpg or .png; --poses and --gt name trajectory files of any format",
    read=read,
    uses=frozenset({"poses", "gt", "rate_hz", "tracker"}),
)
