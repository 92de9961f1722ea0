"""Writing imported walks into a scene: each whole, or not at all."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from vioapr.errors import AlreadyExistsError, FormatError, ParameterError, UnwritableError
from vioapr.files.atomic import leftovers_beside, partial_beside
from vioapr.importers.base import DEFAULT_MAX_MEGAPIXELS, ImportedScene, Place, Walk
from vioapr.importers.diagnostics import diagnose_images
from vioapr.importers.fitting import CameraFitter, drop_impossible_intrinsics, sizes_of
from vioapr.importers.pictures import NO_FILE, PictureReader
from vioapr.scene.frames import Frames
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.work.progress import Advance, ignore

_BLOCK_FRAMES = 256
_DIVERGING = "the tracker is diverging"


@dataclass(frozen=True)
class WriteSettings:
    """How walks are written.

    Attributes:
        link: Hard-link images rather than copy them, where possible.
        focal_px: Focal length, pixels of the images as they are, in place of the source's.
        strict: Refuse walks of which there is something to warn.
        max_megapixels: The largest image to take.
    """

    link: bool = False
    focal_px: float | None = None
    strict: bool = False
    max_megapixels: float = DEFAULT_MAX_MEGAPIXELS


def open_or_create(folder: Path, imported: ImportedScene, place: Place | None) -> Scene:
    """The scene to import into.

    Raises:
        ParameterError: It is new, and nobody said whether it is outdoors.
        FormatError: It is there, and broken.
    """
    if (folder / SCENE_FILE).exists():
        return Scene.open(folder)
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        found = "other files" if folder.is_dir() else "a file"
        raise FormatError(folder, f"expected a scene or a new folder, found {found}")
    chosen = place or imported.place
    if chosen is None:
        raise ParameterError(
            f"{folder} is a new scene and the source does not say where: give `place`: outdoor "
            "or indoor"
        )
    name = imported.name or folder.resolve().name
    return Scene.create(folder, name, is_outdoor=chosen == "outdoor", world=imported.world)


def write_recording(
    scene: Scene, walk: Walk, settings: WriteSettings | None = None, *, tick: Advance = ignore
) -> Scene:
    """Write a walk as a recording and enter it into the scene.

    It is written under another name first and renamed when it is whole: whatever fails, the
    scene is as it was.

    Args:
        scene: Where to.
        walk: What; findings about its images are added to it.
        settings: How it is written.
        tick: Called with the number of frames after every block of them.

    Returns:
        The scene with the recording; saved.

    Raises:
        AlreadyExistsError: The recording exists.
        FormatError: No image can be used, or there is something to warn of under `strict`.
        UnwritableError: Something cannot be written.
    """
    settings = settings or WriteSettings()
    refuse_warnings(walk, settings)
    folder, gt_path = scene.recording_folder(walk.id), scene.gt_path(walk.id)
    for path, what in ((folder, "a recording"), (gt_path, "ground truth")):
        if path.exists():
            problem = f"{what} of this id exists: give another as `id`, or remove it first"
            raise AlreadyExistsError(path, problem)
    for leftover in leftovers_beside(folder):
        shutil.rmtree(leftover, ignore_errors=True)
    partial = partial_beside(folder)
    try:
        _write_files(partial, walk, settings, tick)
        if walk.gt is not None:
            scene.write_gt(walk.id, walk.gt, "importer", walk.info.source)
        partial.rename(folder)
        if walk.info.is_diverging:
            scene = scene.with_excluded(walk.id, _DIVERGING)
        else:
            scene = scene.with_recording(walk.id, walk.split)
        scene.save()
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        shutil.rmtree(folder, ignore_errors=True)
        gt_path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise UnwritableError.of(folder, error) from None
        raise
    return scene


def _write_files(folder: Path, walk: Walk, settings: WriteSettings, tick: Advance) -> None:
    """Write a recording's folder in one pass over the images, a block of frames at a time."""
    broken: list[str] = []
    images = iter(walk.images)
    drop_impossible_intrinsics(walk)
    fitter = CameraFitter(settings.focal_px)
    pictures = PictureReader(
        walk.images if isinstance(walk.images, list | tuple) else (),
        link=settings.link,
        max_megapixels=settings.max_megapixels,
    )
    with RecordingWriter(folder, walk.info, link_images=settings.link) as writer:
        for start in range(0, len(walk), _BLOCK_FRAMES):
            rows = np.arange(start, min(start + _BLOCK_FRAMES, len(walk)))
            names: list[str] = []
            measured = np.full((2, len(rows)), np.nan)
            said = walk.intrinsics.at(rows)
            said_sizes = sizes_of(said)
            for column, row in enumerate(rows.tolist()):
                # A source may end early, as a video that was cut off.
                name, given = str(walk.image_names[row]), next(images, None)
                image, size, problem = pictures.read(given if name else None, said_sizes[column])
                if name and image is None and not problem:
                    problem = "missing"
                if problem:
                    is_gone = problem == NO_FILE and isinstance(given, Path | str)
                    broken.append(f"{given if is_gone else name}: {problem}")
                    name = ""
                elif image is not None:
                    writer.write_image(name, image)
                if size is not None:
                    measured[:, column] = size
                names.append(name)
            intrinsics = fitter.fit(said, measured)
            times, states = walk.timestamp_s[rows], walk.tracking[rows]
            poses = walk.vio_from_cam.at(rows)
            writer.add_frames(Frames(times, tuple(names), states, poses, intrinsics, rows))
            tick(len(rows))
        _write_sensors(writer, walk)
        diagnose_images(walk, broken)
        pictures.say(walk)
        fitter.say(walk)
        refuse_warnings(walk, settings)
        marks = ("WARNING " if finding.is_warning else "" for finding in walk.findings)
        notes = tuple(m + finding.text for m, finding in zip(marks, walk.findings, strict=True))
        writer.set_info(replace(walk.info, notes=notes))


def _write_sensors(writer: RecordingWriter, walk: Walk) -> None:
    for table, add in (
        (walk.imu, writer.add_imu), (walk.gnss, writer.add_gnss),
        (walk.heading, writer.add_heading),
    ):  # fmt: skip
        if table is not None:
            for values in zip(*vars(table).values(), strict=True):
                add(*values)


def refuse_warnings(walk: Walk, settings: WriteSettings) -> None:
    """See that there is nothing to warn of, where that is asked for.

    Raises:
        FormatError: There is, under `strict`.
    """
    warnings = [finding.text for finding in walk.findings if finding.is_warning]
    if settings.strict and warnings:
        more = f" (and {len(warnings) - 1} more)" if len(warnings) > 1 else ""
        raise FormatError(walk.source, f"refused, as `strict` says: {warnings[0]}{more}")
