"""A plain folder of images, with any trajectory file of a tracker, of ground truth, or of both."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.text import natural_key, require_folder
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.body_from_cam import turn_to_camera
from vioapr.formats.registry import read_with_notes
from vioapr.formats.times import PER_SECOND, find_time_unit
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Up,
    Walk,
    flat_names,
    id_of,
    is_image_name,
    is_pattern,
    list_image_names,
    one_walk,
    spread_poses,
    timed_gt,
    tracking_of,
)
from vioapr.importers.diagnostics import turn_y_up
from vioapr.importers.reading import Reading
from vioapr.importers.transforms import Transforms
from vioapr.importers.transforms_world import find_maker
from vioapr.importers.walk_tracks import check_given_tracks
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory, nearest_rows

_DEFAULT_RATE_HZ = 1.0
_MAX_LISTED = 5
_LEAST_TIME = 1e8
"""Smaller whole numbers in names count frames."""
_OTHER_ENDINGS = (
    ".heic", ".heif", ".webp", ".tif", ".tiff", ".bmp", ".gif", ".pgm", ".ppm", ".avif", ".dng",
    ".exr", ".jxl",
)  # fmt: skip
_CONVERT = "convert them to JPEG or PNG first, e.g. magick mogrify -format jpg FILES"
# Worlds that are y up by definition, however the phone is held, and one that is not at all.
_UP_OF_FORMAT: dict[str, Up] = {
    "3dscannerapp": "definition",
    "arcore-logger": "definition",
    "arkit-logger": "definition",
    "ios-logger": "definition",
    "marvin-vio": "definition",
    "polycam": "definition",
    "record3d": "first-pose",
    "scancapture": "definition",
    "stray": "definition",
}
# Poses that structure from motion made: their unit is nobody's, but where it was georeferenced.
_WITHOUT_SCALE = (
    "3dgs", "bundler", "colmap", "colmap-binary", "meshroom", "metashape", "nvm", "opensfm"
)  # fmt: skip


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A folder of images, or those of a pattern.

    Raises:
        FormatError: There are none.
    """
    if not is_pattern(source) or source.exists():
        require_folder(source, "a folder of images")
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the names of the images, pair the trajectories' poses with them.

    Raises:
        FileError: A trajectory cannot be read, or has no pose of an image.
    """
    found = find_images(source)
    vio = read_track(options.poses, options.poses_format, "poses_format", options)
    gt = read_track(options.gt, options.gt_format, "gt_format", options)
    turned = ""
    if vio is not None and options.vio_from_cam is not None:
        camera = None if gt is None else gt.track
        poses_of_camera, turned = turn_to_camera(vio.track, options.vio_from_cam, camera)
        turned_reading = Reading(poses_of_camera, vio.reading.left_out, vio.reading.notes)
        vio = vio._replace(reading=turned_reading)
    tracks = [track for track in (vio, gt) if track is not None]
    times, clock = find_times(found, tracks, options.rate_hz, options.time_unit)
    is_measured = not clock.startswith("no timestamps")
    count = len(found.names)
    poses = Rigid3.unknown((count,))
    walk = Walk(
        id=options.id or id_of(found.folder.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="" if options.poses is None else options.tracker or options.poses.name,
            source="folder of images",
            clock="device" if is_measured else "frame-rate",
        ),
        source=source,
        timestamp_s=times,
        image_names=flat_names(found.names),
        images=[f"{found.folder}/{name}" for name in found.names],
        vio_from_cam=poses,
        tracking=tracking_of(poses),
    )
    if found.others:
        walk.warn(f"images: {found.others} are not read: {_CONVERT}")
    is_said = is_measured or options.rate_hz is not None
    (walk.note if is_said else walk.warn)(f"time: {clock}")
    if vio is not None:
        vio.reading.say(walk)
        if turned:
            walk.note(f"{vio.path.name}: {turned}")
        add_poses(walk, found, vio, options)
    if gt is not None:
        gt.reading.say(walk)
        rows, of = pair_images(found, times, gt)
        walk.gt = timed_gt(gt.track.at_rows(of), times[rows])
    if vio is not None and gt is not None:
        given = (vio.path, vio.track), (gt.path, gt.track)
        check_given_tracks(walk, *given, strict=options.strict)
    return walk


class ImageFiles(NamedTuple):
    """Images of a walk.

    Attributes:
        folder: In which they are.
        names: Of the images, as paths below the folder, in natural order.
        others: Images of other kinds beside them, for people; "" if there are none.
    """

    folder: Path
    names: list[str]
    others: str


def find_images(source: Path) -> ImageFiles:
    """Find the images of a folder or of a pattern.

    Raises:
        FormatError: There are none; says what there is.
    """
    if is_pattern(source) and not source.exists():
        parts = source.parts
        first = next(k for k, part in enumerate(parts) if is_pattern(Path(part)))
        folder = Path(*parts[:first]) if first else Path()
        paths = folder.glob(str(Path(*parts[first:])))
        names = [p.relative_to(folder).as_posix() for p in paths if is_image_name(p.name)]
        if not names:
            raise FormatError(source, "expected images (.jpg, .png), found none of this pattern")
        return ImageFiles(folder, sorted(names, key=natural_key), "")
    names, others = list_image_names(source), count_other_images(source)
    if names:
        return ImageFiles(source, names, others)
    if others:
        raise FormatError(source, f"expected images (.jpg, .png), found {others}: {_CONVERT}")
    inner = [path.name for path in sorted(source.iterdir()) if list_image_names(path)]
    if inner:
        listed = ", ".join(inner[:_MAX_LISTED]) + (", ..." if len(inner) > _MAX_LISTED else "")
        raise FormatError(
            source,
            f"expected images (.jpg, .png), found folders of images: {listed}. Import one of them, "
            f"or all as one walk by a pattern: '{source / '**' / '*.jpg'}'",
        )
    raise FormatError(source, "expected images (.jpg, .png), found none")


def count_other_images(folder: Path) -> str:
    """Name the images in a folder that are of other kinds, as "3 .heic"; "" if there are none."""
    endings = Counter(path.suffix.lower() for path in folder.iterdir())
    return ", ".join(f"{endings[ending]} {ending}" for ending in _OTHER_ENDINGS if endings[ending])


class Track(NamedTuple):
    """A trajectory of the walk.

    Attributes:
        path: The file.
        reading: As it was read.
        format: The name of its format.
    """

    path: Path
    reading: Reading
    format: str

    @property
    def track(self) -> Trajectory:
        """The poses."""
        return self.reading.trajectory

    def rows_in_file(self) -> tuple[NDArray[np.intp], NDArray[np.float64]] | None:
        """Which row of the file each pose is, and the times of all rows, repeated ones apart.

        None where rows were left out whose place is not known.
        """
        left_out = self.reading.left_out
        if self.track.is_timed:
            others = [row.timestamp_s for row in left_out if row.timestamp_s is not None]
            if len(others) < len(left_out):
                return None
            times = np.unique(np.array([*self.track.timestamp_s.tolist(), *others]))
            return np.searchsorted(times, self.track.timestamp_s), times
        count = len(self.track) + len(left_out)
        lines = {row.line for row in left_out}
        if lines and max(lines) > count:
            return None
        rows = [row for row in range(count) if row + 1 not in lines]
        return np.array(rows, dtype=np.intp), np.arange(count, dtype=np.float64)


def read_track(
    path: Path | None, format_name: str | None, parameter: str, options: ImportOptions
) -> Track | None:
    """Read a trajectory that the user names, if any.

    Raises:
        FileError: It cannot be read, or is malformed.
        ParameterError: There is no format of that name.
    """
    if path is None:
        return None
    read_options = ReadOptions(time_unit=options.time_unit, strict=options.strict)
    found = read_with_notes(path, format_name, read_options, parameter=parameter)
    reading = Reading(found.trajectory, found.left_out, found.notes)
    return Track(path, reading, found.format.name)


def add_poses(walk: Walk, found: ImageFiles, vio: Track, options: ImportOptions) -> None:
    """Give a walk's frames the tracker's poses; findings are added."""
    rows, of = pair_images(found, walk.timestamp_s, vio)
    if unused := len(vio.track) - len(of):
        walk.warn(
            f"{vio.path.name}: {unused} of {len(vio.track)} poses belong to no image, and are left "
            "out"
        )
    paired = vio.track.at_rows(of)
    walk.up = _UP_OF_FORMAT.get(vio.format, "unknown")
    if vio.track.target != "vio":
        world, turned = turn_y_up(paired)
        paired = paired.with_transforms(turned)
        walk.note(f"world of {vio.path.name}: {world}")
    walk.vio_from_cam = spread_poses(paired, rows, len(walk))
    walk.tracking = tracking_of(walk.vio_from_cam)
    if (why := find_no_scale(vio)) and not options.metric:
        text = "marked as not metric; if they are in metres, give `metric`"
        walk.warn(f"scale: {why}: {text}")
        walk.info = replace(walk.info, is_metric=False)


def find_no_scale(vio: Track) -> str | None:
    """Why a trajectory is not taken to be in metres, or None if it is."""
    if vio.format == "nerfstudio":
        is_metric, why, _ = find_maker(Transforms.read(vio.path), vio.track.target_from_source)
        return None if is_metric else why
    if vio.format in _WITHOUT_SCALE:
        return f"{vio.path.name} is of {vio.format}, whose poses have no unit"
    return None


def find_times(
    found: ImageFiles,
    tracks: list[Track],
    rate_hz: float | None,
    unit: TimeUnit | None = None,
) -> tuple[NDArray[np.float64], str]:
    """When each image was taken, and how that is known.

    Args:
        found: The images.
        tracks: Trajectories of the same walk, the one to trust most first.
        rate_hz: Frames per second, if the user says so.
        unit: Of times in names, if the user says so.

    Raises:
        FormatError: Neither names nor trajectories tell.
    """
    names = found.names
    if rate_hz is not None:
        return np.arange(len(names)) / rate_hz, f"no timestamps: {rate_hz:g} Hz"
    stamps = timestamps_of_names(names, unit)
    timed = [track for track in tracks if track.track.is_timed]
    if stamps is not None:
        known_s = timed[0].track.timestamp_s if timed else stamps
        if stamps[0] <= known_s[-1] and known_s[0] <= stamps[-1]:
            return stamps, "from the images' names"
    for track in timed:
        pairs = pairs_by_name(names, track.track)
        if len(pairs) == len(names):
            times = track.track.timestamp_s[[of for _, of in pairs]]
            if (np.diff(times) > 0).all():
                return times, "the trajectory's, by the images' names"
    for track in timed:
        placed = track.rows_in_file()
        if placed is not None and len(placed[1]) == len(names):
            return placed[1], "the trajectory's: pose k is taken to be of image k"
    if timed:
        raise FormatError(
            found.folder,
            f"expected images named by timestamps, or as many as poses ({len(timed[0].track)}), "
            f"got {len(names)} images as {names[0]}: give `rate_hz`, or a trajectory with names",
        )
    rate_hz = _DEFAULT_RATE_HZ
    return np.arange(len(names)) / rate_hz, f"no timestamps: counted at {rate_hz:g} Hz"


def timestamps_of_names(
    names: list[str], unit: TimeUnit | None = None
) -> NDArray[np.float64] | None:
    """Seconds from names as 1305031102.175304.png; None if names are none of times.

    Whole numbers are times in the unit that their size or their steps show, unless they are
    small: then they count frames. In names as ARKitScenes' 41069021_306.508.png, the time comes
    after the video's number.

    Args:
        names: Of the images, in order.
        unit: Of whole numbers, if the user says so.
    """
    stems = [_time_text(name) for name in names]
    try:
        values = np.array([float(stem) for stem in stems])
    except ValueError:
        return None
    if not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        return None
    if not all(stem.isdecimal() for stem in stems):
        return values
    if unit is None and values[-1] < _LEAST_TIME:
        return None
    per_second = PER_SECOND[unit or find_time_unit(values).unit]
    return np.array([int(stem) / per_second for stem in stems])


def _time_text(name: str) -> str:
    """What an image's name has as its time; nothing where it has an underscore besides."""
    stem = _stem(_last(name))
    video, _, time = stem.rpartition("_")
    text = time if video.isdecimal() and "." in time else stem
    return "" if "_" in text else text  # Python would read 1_2 as 12


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def _stem(name: str) -> str:
    return name.rsplit(".", 1)[0]


def pairs_by_name(images: list[str], track: Trajectory) -> list[tuple[int, int]]:
    """Rows of images and of poses that have one name, in the order of the images."""
    if track.names is None:
        return []
    row_of = rows_by_name(images)
    rows = [(find_row(row_of, name), of) for of, name in enumerate(track.names)]
    return sorted((row, of) for row, of in rows if row is not None)


def pair_images(
    found: ImageFiles, timestamp_s: NDArray[np.float64], of_walk: Track
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which image each pose is of: rows of images, rows of the track.

    By names, else by times (mutually nearest, within half a frame), else by order. Names of a
    trajectory with times are not needed: its images may have been renamed.

    Raises:
        FormatError: No pose is of an image.
    """
    track, images = of_walk.track, found.names
    pairs = pairs_by_name(images, track)
    if not pairs and track.is_timed:
        step_s = float(np.median(np.diff(timestamp_s))) if len(timestamp_s) > 1 else 0.1
        nearest = nearest_rows(timestamp_s, track.timestamp_s)
        back = nearest_rows(track.timestamp_s, timestamp_s)
        off_s = np.abs(timestamp_s - track.timestamp_s[nearest])
        pairs = [
            (row, int(of))
            for row, of in enumerate(nearest)
            if back[of] == row and off_s[row] <= 0.5 * step_s
        ]
    elif (
        not pairs
        and track.names is None
        and (placed := of_walk.rows_in_file()) is not None
        and len(placed[1]) == len(images)
    ):
        pairs = [(int(row), of) for of, row in enumerate(placed[0])]
    if not pairs:
        what = "timestamps" if track.is_timed else "names" if track.names else "number of poses"
        raise FormatError(
            of_walk.path, f"expected {what} that fit the {len(images)} images of "
            f"{found.folder}, as {images[0]}, got none that do"
        )  # fmt: skip
    rows, of = np.array(pairs, dtype=np.intp).T
    return rows, of


def rows_by_name(images: list[str]) -> dict[str, int | None]:
    """Rows of images by every end of their paths, with and without ending; None if of several."""
    row_of: dict[str, int | None] = {}
    for row, image in enumerate(images):
        parts = image.split("/")
        for first in range(len(parts)):
            end = "/".join(parts[first:])
            for name in (end, _stem(end)):
                row_of[name] = row if name not in row_of or row_of[name] == row else None
    return row_of


def find_row(row_of: dict[str, int | None], name: str) -> int | None:
    """The image of a name: by the longest end of its path that any image has."""
    parts = name.replace("\\", "/").split("/")
    for first in range(len(parts)):
        end = "/".join(parts[first:])
        if end in row_of:
            return row_of[end]
        if _stem(end) in row_of and is_image_name(end):
            return row_of[_stem(end)]
    return None


IMPORTER = Importer(
    name="images",
    title="a folder of images with any trajectory file",
    layout="a folder of .jpg or .png; `poses` and `gt` name trajectory files of any format",
    read=read,
    uses=frozenset(
        {
            *{"poses", "gt", "rate_hz", "tracker", "metric", "poses_format", "gt_format"},
            *{"time_unit", "vio_from_cam"},
        }
    ),
    takes_patterns=True,
)
