"""Writing imported walks into a scene: each whole, or not at all."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError, UnwritableError
from vioapr.files.images import probe_bytes, probe_image
from vioapr.importers.base import Image, ImportedScene, Place, Walk
from vioapr.scene.frames import Frames, Intrinsics
from vioapr.scene.scene import SCENE_FILE, Scene
from vioapr.scene.writer import RecordingWriter

_MAX_NAMED = 3
_BLOCK_FRAMES = 256
_DIVERGING = "the tracker is diverging"


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
            f"{folder} is a new scene and the source does not say where: give --place outdoor or "
            "--place indoor"
        )
    name = imported.name or folder.resolve().name
    return Scene.create(folder, name, is_outdoor=chosen == "outdoor", world=imported.world)


def write_walk(
    scene: Scene, walk: Walk, *, link: bool = False, tick: Callable[[int], object] | None = None
) -> Scene:
    """Write a walk and enter it into the scene.

    It is written under another name first and renamed when it is whole: whatever fails, the
    scene is as it was.

    Args:
        scene: Where to.
        walk: What; findings about its images are added to it.
        link: Hard-link images rather than copy them, where possible.
        tick: Called with a number of frames after every so many, for progress.

    Returns:
        The scene with the recording; saved.

    Raises:
        FormatError: The recording exists, or something cannot be written.
    """
    folder, gt_path = scene.recording_folder(walk.id), scene.gt_path(walk.id)
    for path, what in ((folder, "a recording"), (gt_path, "ground truth")):
        if path.exists():
            problem = f"{what} of this id exists: give another with --id, or remove it first"
            raise FormatError(path, problem)
    partial = folder.with_name(f".{walk.id}.partial")
    _remove(partial)
    try:
        _write_recording(partial, walk, link=link, tick=tick)
        if walk.gt is not None:
            scene.write_gt(walk.id, walk.gt)
        partial.rename(folder)
        scene = _enter(scene, walk)
        scene.save()
    except BaseException as error:
        _remove(partial)
        _remove(folder)
        gt_path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise UnwritableError.of(folder, error) from None
        raise
    return scene


def _remove(folder: Path) -> None:
    with suppress(FileNotFoundError):
        shutil.rmtree(folder)


def _enter(scene: Scene, walk: Walk) -> Scene:
    if walk.info.is_diverging:
        return scene.with_excluded(walk.id, _DIVERGING)
    return scene.with_recording(walk.id, walk.split)


def _write_recording(
    folder: Path, walk: Walk, *, link: bool, tick: Callable[[int], object] | None
) -> None:
    broken: list[str] = []
    sizes: Counter[tuple[int, int]] = Counter()
    images = iter(walk.images)
    _drop_odd_intrinsics(walk)
    with RecordingWriter(folder, walk.info, link_images=link) as writer:
        for start in range(0, len(walk), _BLOCK_FRAMES):
            rows = np.arange(start, min(start + _BLOCK_FRAMES, len(walk)))
            names, seen = _write_images(writer, walk, rows, images, link, broken)
            sizes.update(size for size in seen if size is not None)
            writer.add_frames(_frames(walk, rows, names, seen))
            if tick is not None:
                tick(len(rows))
        _write_sensors(writer, walk)
        _judge_images(walk, broken, sizes)
        notes = tuple(
            f"WARNING {finding.text}" if finding.is_warning else finding.text
            for finding in walk.findings
        )
        writer.set_info(replace(walk.info, notes=notes))


def _write_images(
    writer: RecordingWriter,
    walk: Walk,
    rows: NDArray[np.intp],
    images: Iterator[Image],
    link: bool,
    broken: list[str],
) -> tuple[list[str], list[tuple[int, int] | None]]:
    """Write the next images; names ("" for what is missing or broken) and sizes."""
    names, sizes = [], []
    for row in rows.tolist():
        # A source may end early, as a video that was cut off.
        name, image = str(walk.image_names[row]), next(images, None)
        image, size, problem = _look_at(image if name else None, link=link)
        if name and image is None and not problem:
            problem = "missing"
        if problem:
            broken.append(f"{name}: {problem}")
            name = ""
        elif image is not None:
            writer.write_image(name, image)
        names.append(name)
        sizes.append(size)
    return names, sizes


def _look_at(image: Image, *, link: bool) -> tuple[Image, tuple[int, int] | None, str | None]:
    """An image to write, its size, and what is wrong with it."""
    if image is None:
        return None, None, None
    if isinstance(image, np.ndarray):
        return image, (image.shape[1], image.shape[0]), None
    if isinstance(image, Path | str) and link:
        probe = probe_image(image)
    else:
        if isinstance(image, Path | str):
            try:
                image = Path(image).read_bytes()
            except FileNotFoundError:
                return None, None, "no file of this name"
            except OSError as error:
                return None, None, f"cannot be read: {error.strerror}"
        probe = probe_bytes(image)
    return image, (probe.width, probe.height) if not probe.problem else None, probe.problem


def _frames(
    walk: Walk,
    rows: NDArray[np.intp],
    names: list[str],
    sizes: list[tuple[int, int] | None],
) -> Frames:
    """Some frames of a walk; where the source does not say how large images are, they do."""
    columns = [np.broadcast_to(column, len(walk))[rows] for column in walk.intrinsics]
    measured = np.array([(np.nan, np.nan) if size is None else size for size in sizes]).T
    is_unsaid = np.isnan(columns[0])
    columns[:2] = [np.where(is_unsaid, m, c) for m, c in zip(measured, columns[:2], strict=True)]
    return Frames(
        walk.timestamp_s[rows],
        tuple(names),
        walk.tracking[rows],
        walk.vio_from_cam.at(rows),
        Intrinsics(*columns),
        rows,
    )


def _drop_odd_intrinsics(walk: Walk) -> None:
    """Cameras that cannot be are rather not known."""
    table = np.array([np.broadcast_to(column, len(walk)) for column in walk.intrinsics])
    size, pinhole = table[:2], table[2:]
    with np.errstate(invalid="ignore"):
        is_odd_size = ~((size >= 1) & (size == np.round(size))).all(axis=0)
        is_odd = ~(np.isfinite(pinhole).all(axis=0) & (pinhole[:2] > 0).all(axis=0))
    said = np.isfinite(size).any(axis=0) & is_odd_size, np.isfinite(pinhole).any(axis=0) & is_odd
    count = int((said[0] | said[1]).sum())
    if count:
        walk.warn(f"intrinsics: those of {count} frames are left out: sizes must be whole, focal "
                  "lengths above 0")  # fmt: skip
        table[:2, is_odd_size], table[2:, is_odd] = np.nan, np.nan
        walk.intrinsics = Intrinsics(*table)


def _judge_images(walk: Walk, broken: list[str], sizes: Counter[tuple[int, int]]) -> None:
    wanted = sum(1 for name in walk.image_names if name)
    if broken:
        named = "; ".join(broken[:_MAX_NAMED]) + ("; ..." if len(broken) > _MAX_NAMED else "")
        walk.warn(f"images: {len(broken)} are missing or broken, their frames have none: {named}")
    if wanted and len(broken) == wanted:
        raise FormatError(walk.source, f"none of {wanted} images can be used: {broken[0]}")
    said = {
        (int(width), int(height))
        for width, height in zip(
            np.ravel(walk.intrinsics.width), np.ravel(walk.intrinsics.height), strict=True
        )
        if np.isfinite(width) and np.isfinite(height)
    }
    if sizes and said and set(sizes) != said:
        walk.warn(
            f"intrinsics: they are of images of {_list(said)}, and the images are {_list(sizes)}"
        )
    elif sizes:
        known = "known" if np.isfinite(np.asarray(walk.intrinsics.fx)).all() else "not known"
        walk.note(f"images: {_list(sizes)} pixels; focal length {known}")


def _list(sizes) -> str:
    return ", ".join(f"{width}x{height}" for width, height in sorted(sizes)[:_MAX_NAMED])


def _write_sensors(writer: RecordingWriter, walk: Walk) -> None:
    if walk.imu is not None:
        for row in range(len(walk.imu)):
            imu = walk.imu
            writer.add_imu(float(imu.timestamp_s[row]), imu.accel_m_s2[row], imu.gyro_rad_s[row])
    if walk.gnss is not None:
        for values in zip(*vars(walk.gnss).values(), strict=True):
            writer.add_gnss(*map(float, values))
    if walk.heading is not None:
        for values in zip(*vars(walk.heading).values(), strict=True):
            writer.add_heading(*map(float, values))
