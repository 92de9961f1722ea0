"""nerfstudio, instant-ngp, NeRFCapture: `transforms.json` with images and intrinsics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.images import probe_image
from vioapr.files.text import natural_key
from vioapr.formats.matrix_order import TRANSPOSED
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    flat_names,
    id_of,
    one_walk,
    tracking_of,
)
from vioapr.importers.diagnostics import MAX_NAMED, turn_y_up
from vioapr.importers.image_paths import ImagePaths
from vioapr.importers.matrices import poses_of_matrices
from vioapr.importers.transforms import (
    Transforms,
    TransformsFrame,
)
from vioapr.importers.transforms_world import World, find_world
from vioapr.plurals import count_of
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

_FILE = "transforms.json"
_DEFAULT_RATE_HZ = 1.0
_PINHOLE = {"", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"}


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """A transforms.json or the folder that holds it."""
    return one_walk(lambda: read_walk(source, options))


def read_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the poses, cameras and paths of images.

    Raises:
        FileError: It cannot be read, or no frame of it can be used.
    """
    path = find_file(source)
    found = Transforms.read(path)
    paths = ImagePaths(path.parent)
    image_of = {frame.entry: paths.find(frame.file_path) for frame in found.frames}
    leave_out_repeats(found, image_of)
    times, clock = order_frames(found, options)
    images = [image_of[frame.entry] for frame in found.frames]
    poses = poses_of_matrices(np.array([frame.matrix for frame in found.frames]))
    for row, problem in poses.problems.items():
        frame = found.frames[row]
        text = f"{problem}: the frame {frame.file_path} has no pose"
        found.problems.append(FormatError(found.path, text, frame.entry))
    world = find_world(found, poses.world_from_cam, poses.scale)
    walk = Walk(
        id=options.id or id_of(name_of(path)),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker=world.tracker or "transforms.json",
            source="nerfstudio transforms.json",
            clock="frame-rate" if clock is None else "device",
            is_metric=world.is_metric or options.metric,
        ),
        source=path,
        timestamp_s=times,
        image_names=flat_names([image.as_posix() for image in images]),
        images=images,
        vio_from_cam=world.poses,
        tracking=tracking_of(world.poses),
        up=world.up,
    )
    turn_upright(walk)
    if poses.is_transposed:
        walk.warn(TRANSPOSED)
    walk.intrinsics = read_cameras(found, images, walk)
    say_paths(walk, paths)
    say_problems(walk, found)
    if clock is None:
        text = f"no timestamps: counted at {1 / _step_s(times):g} Hz in the order "
        (walk.warn if options.rate_hz is None else walk.note)(f"{text}of the names")
    else:
        walk.note(f"time: from the file, in {clock}")
    say_scale(walk, world, options)
    return walk


def name_of(path: Path) -> str:
    """The name of a capture: its folder's, with that of the split if the file is of one."""
    split = path.stem.removeprefix("transforms") if path.stem.startswith("transforms_") else ""
    return path.resolve().parent.name + split


def find_file(source: Path) -> Path:
    """The file itself, or the one in a folder.

    Raises:
        FormatError: The folder has several, as of splits, and none is transforms.json.
    """
    if not source.is_dir() or (source / _FILE).exists():
        return source / _FILE if source.is_dir() else source
    others = sorted(source.glob("transforms*.json"))
    if len(others) > 1:
        listed = ", ".join(path.name for path in others)
        raise FormatError(source, f"expected {_FILE}, found {listed}: import one, then the others")
    return others[0] if others else source / _FILE


def leave_out_repeats(found: Transforms, image_of: dict[int, Path]) -> None:
    """Leave out frames whose image is an earlier frame's; problems are added."""
    seen: dict[Path, int] = {}
    kept: list[TransformsFrame] = []
    for frame in found.frames:
        first = seen.setdefault(image_of[frame.entry], frame.entry)
        if first == frame.entry:
            kept.append(frame)
            continue
        problem = f"the image {frame.file_path} is entry {first}'s already: left out"
        found.problems.append(FormatError(found.path, problem, frame.entry))
    found.frames = kept


def order_frames(
    found: Transforms, options: ImportOptions
) -> tuple[NDArray[np.float64], str | None]:
    """Bring the frames in order, by their timestamps or else by names; problems are added.

    Returns:
        Times, shape (n,), s, and the unit in the file, or None where they are counted.
    """
    timed = found.times() if options.rate_hz is None else None
    if timed is None:
        found.frames.sort(key=lambda frame: natural_key(frame.file_path.replace("\\", "/")))
        return np.arange(len(found.frames)) / (options.rate_hz or _DEFAULT_RATE_HZ), None
    times, unit = timed
    rows: list[int] = []
    latest_s = -np.inf
    for row in np.argsort(times, kind="stable").tolist():
        frame = found.frames[row]
        if times[row] > latest_s:
            rows.append(row)
            latest_s = float(times[row])
            continue
        is_known = bool(np.isfinite(times[row]))
        problem = "a timestamp that came before" if is_known else "no timestamp"
        text = f"the frame {frame.file_path} has {problem}: left out"
        found.problems.append(FormatError(found.path, text, frame.entry))
    found.frames = [found.frames[row] for row in rows]
    return times[rows], unit


def _step_s(times: NDArray[np.float64]) -> float:
    return float(times[1] - times[0]) if len(times) > 1 else 1.0


def turn_upright(walk: Walk) -> None:
    """Turn the poses into a y-up world where the file's is z up; says so."""
    known = np.flatnonzero(walk.vio_from_cam.is_known)
    if walk.up == "definition" or not len(known):
        return
    poses = walk.vio_from_cam.at(known)
    track = Trajectory.from_arrays(walk.timestamp_s[known], poses.translation_m, poses.quat_xyzw)
    text, turned = turn_y_up(track)
    walk.vio_from_cam = Rigid3.unknown((len(walk),))
    walk.vio_from_cam.translation_m[known] = turned.translation_m
    walk.vio_from_cam.quat_xyzw[known] = turned.quat_xyzw
    walk.note(f"world: {text}")


def read_cameras(found: Transforms, images: list[Path], walk: Walk) -> Intrinsics:
    """Of every frame, else of the file, else not known; findings are added.

    A focal length that is given as an angle needs the images' size, which is that of the first
    image where the file does not say. A principal point that is missing stays so: it is the
    middle of the image, once that is measured.
    """
    model = str(found.members.get("camera_model", "")).upper()
    if model not in _PINHOLE:
        walk.warn(
            f"intrinsics: the camera is {model}, and recordings hold pinhole cameras: left out; "
            "undistort the images and import those"
        )
        return Intrinsics()
    if found.is_distorted:
        walk.warn("intrinsics: lens distortion is left out, recordings hold pinhole cameras")
    size: dict[str, float] = {}
    table = np.full((len(images), 6), np.nan)
    angles = 0
    for row, frame in enumerate(found.frames):
        camera = found.camera(frame)
        if "w" not in camera or "h" not in camera:
            camera = {key: value for key, value in camera.items() if key not in ("w", "h")}
            if "fl_x" not in camera and "camera_angle_x" in camera:
                size = size or measure_first(images)
                camera |= size
        for focal, side, angle in (
            ("fl_x", "w", "camera_angle_x"),
            ("fl_y", "h", "camera_angle_y"),
        ):
            if focal not in camera and {side, angle} <= camera.keys():
                camera[focal] = camera[side] / (2 * np.tan(camera[angle] / 2))
                angles += focal == "fl_x"
        camera.setdefault("fl_x", camera.get("fl_y", np.nan))
        camera.setdefault("fl_y", camera["fl_x"])
        table[row] = [camera.get(key, np.nan) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")]
    if angles:
        walk.note(
            f"intrinsics: the focal length of {count_of(angles, 'frame')} is from camera_angle_x"
        )
    return Intrinsics(*table.T)


def measure_first(images: list[Path]) -> dict[str, float]:
    """Width and height of the first image that is whole; nothing if none is."""
    for image in images:
        probe = probe_image(image)
        if not probe.problem:
            return {"w": float(probe.width), "h": float(probe.height)}
    return {}


def say_paths(walk: Walk, paths: ImagePaths) -> None:
    """Add findings on images that are not where the file says."""
    if paths.moved:
        written, found = next(iter(paths.moved.items()))
        walk.note(
            f"paths: {count_of(len(paths.moved), 'image is', 'images are')} "
            "not where the file says, and found by the "
            f"end of their path: {written} is {found.relative_to(paths.folder).as_posix()}"
        )
    if paths.ambiguous:
        walk.warn(
            f"paths: of {count_of(len(paths.ambiguous), 'path')} several images could be meant, "
            f"the first is {paths.ambiguous[0]}"
        )


def say_problems(walk: Walk, found: Transforms) -> None:
    """Add a finding on the frames of which something is wrong."""
    if found.problems:
        named = "; ".join(str(problem) for problem in found.problems[:MAX_NAMED])
        more = "; ..." if len(found.problems) > MAX_NAMED else ""
        walk.warn(
            f"{count_of(len(found.problems), 'frame is', 'frames are')} not whole: {named}{more}"
        )


def say_scale(walk: Walk, world: World, options: ImportOptions) -> None:
    """Add findings on the scale and the world, and why they are taken to be so."""
    for note in world.notes:
        walk.note(note)
    if world.is_metric:
        walk.note(f"scale: metres, {world.why}")
    elif options.metric:
        walk.note(f"scale: metres, as you say ({world.why})")
    else:
        walk.warn(f"scale: {world.why}: marked as not metric; if they are in metres, give `metric`")


IMPORTER = Importer(
    name="nerfstudio",
    title="transforms.json of nerfstudio, instant-ngp or NeRFCapture",
    layout="transforms.json, or the folder that holds it, with its images",
    read=read,
    uses=frozenset({"rate_hz", "metric"}),
)
