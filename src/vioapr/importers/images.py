"""A plain folder of images, with any trajectory file of a tracker, of ground truth, or of both."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from msgspec.structs import replace

from vioapr.errors import FormatError
from vioapr.files.text import natural_key, require_folder
from vioapr.formats.base import ReadOptions
from vioapr.formats.body_from_cam import turn_to_camera
from vioapr.formats.registry import FORMATS, read_with_notes
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
from vioapr.importers.image_pairing import ImageFiles, Track, pair_images
from vioapr.importers.image_times import find_times
from vioapr.importers.reading import Reading
from vioapr.importers.transforms import Transforms
from vioapr.importers.transforms_world import find_maker
from vioapr.importers.walk_tracks import check_given_tracks
from vioapr.schemas.recording import RecordingInfo

_MAX_LISTED = 5
_OTHER_ENDINGS = (
    ".heic", ".heif", ".webp", ".tif", ".tiff", ".bmp", ".gif", ".pgm", ".ppm", ".avif", ".dng",
    ".exr", ".jxl",
)  # fmt: skip
_CONVERT = "convert them to JPEG or PNG first, e.g. magick mogrify -format jpg FILES"
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
    when = find_times(found, tracks, options.rate_hz, options.time_unit)
    count = len(found.names)
    poses = Rigid3.unknown((count,))
    walk = Walk(
        id=options.id or id_of(found.folder.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="" if options.poses is None else options.tracker or options.poses.name,
            source="folder of images",
            clock="device" if when.is_measured else "frame-rate",
        ),
        source=source,
        timestamp_s=when.timestamp_s,
        image_names=flat_names(found.names),
        images=[f"{found.folder}/{name}" for name in found.names],
        vio_from_cam=poses,
        tracking=tracking_of(poses),
    )
    if found.others:
        walk.warn(f"images: {found.others} are not read: {_CONVERT}")
    (walk.warn if when.is_doubtful else walk.note)(f"time: {when.how}")
    if vio is not None:
        vio.reading.say(walk)
        if turned:
            walk.note(f"{vio.path.name}: {turned}")
        add_poses(walk, found, vio, options)
    if gt is not None:
        gt.reading.say(walk)
        rows, of = pair_images(found, walk.timestamp_s, gt)
        walk.gt = timed_gt(gt.track.at_rows(of), walk.timestamp_s[rows])
    if vio is not None and gt is not None:
        given = (vio.path, vio.track), (gt.path, gt.track)
        check_given_tracks(walk, *given, strict=options.strict)
    return walk


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
    walk.up = up_of_format(vio.format)
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


def up_of_format(name: str) -> Up:
    """How it is known which way is up in the y-up worlds of a format."""
    if name == "record3d":
        return "first-pose"
    return "definition" if FORMATS[name].up == "+y" else "unknown"


def find_no_scale(vio: Track) -> str | None:
    """Why a trajectory is not taken to be in metres, or None if it is."""
    if vio.format == "nerfstudio":
        is_metric, why, _ = find_maker(Transforms.read(vio.path), vio.track.target_from_source)
        return None if is_metric else why
    if vio.format in _WITHOUT_SCALE:
        return f"{vio.path.name} is of {vio.format}, whose poses have no unit"
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
