"""Writing imported walks into a scene: each whole, or not at all."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vioapr.errors import (
    AlreadyExistsError,
    FormatError,
    ParameterError,
    UnwritableError,
    VioAprError,
)
from vioapr.files.atomic import (
    leftovers_beside,
    partial_beside,
    replace_folder,
    sync,
    sync_folder,
)
from vioapr.files.text import read_bytes, write_bytes, write_text
from vioapr.importers.base import DEFAULT_MAX_MEGAPIXELS, Image, ImportedScene, Place, Walk
from vioapr.importers.diagnostics import diagnose_images
from vioapr.importers.fitting import CameraFitter, drop_impossible_intrinsics, sizes_of
from vioapr.importers.pictures import NO_FILE, PictureReader
from vioapr.scene.anonymize import ANONYMIZED_FILE
from vioapr.scene.frames import Frames
from vioapr.scene.gt_origin import origin_path, remove_gt_file
from vioapr.scene.recording import (
    FRAMES_FILE,
    GNSS_FILE,
    HEADING_FILE,
    IMAGES_FOLDER,
    IMU_FILE,
    INFO_FILE,
)
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.base import decode, encode
from vioapr.schemas.written import ImportedFrom
from vioapr.work.progress import Advance, ignore

IMPORT_FILE = ".import.json"

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
        imported_from: Is noted with the recording, so that the same import can be run again.
        overwrite: Replace a recording that an import wrote.
        content: Digest of the archive that the walks come out of; "" where there is none.
    """

    link: bool = False
    focal_px: float | None = None
    strict: bool = False
    max_megapixels: float = DEFAULT_MAX_MEGAPIXELS
    imported_from: ImportedFrom | None = None
    overwrite: bool = False
    content: str = ""


def check_target(folder: Path, imported: ImportedScene, place: Place | None) -> Place | None:
    """See that a scene can be opened or made in a folder.

    Returns:
        Where a new one is; None for one that is there.

    Raises:
        ParameterError: It is new, and nobody said whether it is outdoors.
        FormatError: The folder holds something else.
    """
    if (folder / SCENE_FILE).exists():
        return None
    # Locks, and what is being written or was left by a kill, begin with a dot.
    is_free = folder.is_dir() and all(path.name.startswith(".") for path in folder.iterdir())
    if folder.exists() and not is_free:
        found = "other files" if folder.is_dir() else "a file"
        raise FormatError(folder, f"expected a scene or a new folder, found {found}")
    chosen = place or imported.place
    if chosen is None:
        raise ParameterError(
            f"{folder} is a new scene and the source does not say where: give `place`: outdoor "
            "or indoor"
        )
    return chosen


def open_or_create(folder: Path, imported: ImportedScene, place: Place | None) -> Scene:
    """The scene to import into.

    Raises:
        ParameterError: It is new, and nobody said whether it is outdoors.
        FormatError: It is there, and broken.
    """
    chosen = check_target(folder, imported, place)
    if chosen is None:
        return Scene.open(folder)
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
        AlreadyExistsError: The recording exists, and is not to be replaced.
        FormatError: No image can be used, or there is something to warn of under `strict`.
        UnwritableError: Something cannot be written.
    """
    settings = settings or WriteSettings()
    refuse_warnings(walk, settings)
    folder, gt_path = scene.recording_folder(walk.id), scene.gt_path(walk.id)
    is_replaced = settings.overwrite and folder.exists()
    require_new(scene, walk.id, overwrite=settings.overwrite)
    for leftover in leftovers_beside(folder):
        shutil.rmtree(leftover, ignore_errors=True)
    partial = partial_beside(folder)
    before = read_bytes(scene.folder / SCENE_FILE)
    gt_before = {path: read_bytes(path) for path in _gt_files(gt_path)}
    try:
        _write_files(partial, walk, settings, tick)
        if settings.imported_from is not None:
            write_text(partial / IMPORT_FILE, encode(settings.imported_from))
        sync_folder(partial)
        # Opened again: another process may have mapped the scene meanwhile.
        scene = Scene.open(scene.folder)
        before = read_bytes(scene.folder / SCENE_FILE)
        if walk.gt is not None:
            scene.write_gt(walk.id, walk.gt, "importer", walk.info.source)
        entered = _enter(scene, walk, is_replaced)
        entered.save()
        # Last: whatever a kill leaves before, the same import can be run again.
        if is_replaced:
            replace_folder(folder, partial)
        else:
            partial.rename(folder)
            sync(folder.parent)
        if walk.gt is None:
            remove_gt_file(gt_path)
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        remove_gt_file(gt_path)
        with suppress(VioAprError):
            for path, content in gt_before.items():
                write_bytes(path, content)
        with suppress(VioAprError):
            if read_bytes(scene.folder / SCENE_FILE) != before:
                write_bytes(scene.folder / SCENE_FILE, before)
        if isinstance(error, OSError):
            raise UnwritableError.of(folder, error) from None
        raise
    return entered


def _gt_files(gt_path: Path) -> list[Path]:
    return [path for path in (gt_path, origin_path(gt_path)) if path.exists()]


def _enter(scene: Scene, walk: Walk, is_replaced: bool) -> Scene:
    """The scene with a walk in its split; one that was there stays where the user has put it."""
    if walk.info.is_diverging:
        return scene.with_excluded(walk.id, _DIVERGING)
    if is_replaced and scene.excluded.get(walk.id) != _DIVERGING:
        return scene
    return scene.with_recording(walk.id, walk.split)


def read_import(scene: Scene, id_: str) -> ImportedFrom | None:
    """The import that a recording is of, if it is there, whole, and known to be of one."""
    path = scene.recording_folder(id_) / IMPORT_FILE
    try:
        return decode(path, path.read_text(encoding="utf-8"), ImportedFrom)
    except (OSError, ValueError, VioAprError):
        return None


def require_new(scene: Scene, id_: str, *, overwrite: bool = False) -> None:
    """See that nothing of a recording is there, but for what a killed import left.

    Args:
        scene: Where to look.
        id_: The recording's.
        overwrite: Whether a recording may be there that an import wrote, with nothing of others.

    Raises:
        AlreadyExistsError: The recording exists, or ground truth that no import wrote.
    """
    problem = "of this id exists: give another as `id`, or remove it first"
    folder, gt_path = scene.recording_folder(id_), scene.gt_path(id_)
    if folder.exists():
        if not overwrite or read_import(scene, id_) is None:
            raise AlreadyExistsError(folder, f"a recording {problem}")
        _refuse_others(scene, id_)
    origin = scene.gt_origin(id_) if gt_path.exists() else None
    if gt_path.exists() and (origin is None or origin.writer != "importer"):
        raise AlreadyExistsError(gt_path, f"ground truth {problem}")


def _refuse_others(scene: Scene, id_: str) -> None:
    """See that a recording's folder has no files that an import does not write.

    Raises:
        AlreadyExistsError: It has.
    """
    folder = scene.recording_folder(id_)
    images = set(scene.recording(id_).frames.image)
    tables = (FRAMES_FILE, IMU_FILE, GNSS_FILE, HEADING_FILE, ANONYMIZED_FILE)
    own = (INFO_FILE, IMPORT_FILE, *tables)
    for path in sorted(folder.rglob("*")):
        is_image = path.parent == folder / IMAGES_FOLDER and path.name in images
        if path.is_file() and not is_image and not (path.parent == folder and path.name in own):
            raise AlreadyExistsError(
                path, "no import wrote it, and the recording is to be replaced: move it away first"
            )


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
            said = walk.intrinsics.at(rows)
            # A source may end early, as a video that was cut off.
            given = itertools.chain(itertools.islice(images, len(rows)), itertools.repeat(None))
            names = [str(walk.image_names[row]) for row in rows.tolist()]
            wanted = zip(names, given, sizes_of(said), strict=False)
            written, measured = _write_images(writer, pictures, wanted, broken)
            intrinsics = fitter.fit(said, measured)
            times, states = walk.timestamp_s[rows], walk.tracking[rows]
            poses = walk.vio_from_cam.at(rows)
            writer.add_frames(Frames(times, written, states, poses, intrinsics, rows))
            tick(len(rows))
        _write_sensors(writer, walk)
        diagnose_images(walk, broken)
        pictures.say(walk)
        fitter.say(walk)
        refuse_warnings(walk, settings)
        marks = ("WARNING " if finding.is_warning else "" for finding in walk.findings)
        notes = tuple(m + finding.text for m, finding in zip(marks, walk.findings, strict=True))
        writer.set_info(replace(walk.info, notes=notes))


def _write_images(
    writer: RecordingWriter,
    pictures: PictureReader,
    wanted: Iterable[tuple[str, Image, tuple[int, int] | None]],
    broken: list[str],
) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Write some frames' images.

    Args:
        writer: Of the recording.
        pictures: Reads them.
        wanted: Name, image and the size that its intrinsics are of, for each frame.
        broken: Where images that cannot be used are added.

    Returns:
        The names of those that were written, "" for the other frames; widths and heights, shape
        (2, n), NaN for these.
    """
    names: list[str] = []
    sizes: list[tuple[float, float]] = []
    for name, given, said in wanted:
        image, size, problem = pictures.read(given if name else None, said)
        if name and image is None:
            is_gone = problem == NO_FILE and isinstance(given, Path | str)
            broken.append(f"{given if is_gone else name}: {problem or 'missing'}")
        elif image is not None:
            writer.write_image(name, image)
        names.append("" if image is None else name)
        sizes.append(size or (np.nan, np.nan))
    return tuple(names), np.array(sizes, dtype=np.float64).T


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
