"""All importers, and importing a source into a scene."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from vioapr.errors import FormatError, ParameterError
from vioapr.files.atomic import restore_folder
from vioapr.importers import (
    advio,
    cambridge,
    capture,
    frame_files,
    images,
    ios_logger,
    marvin,
    nerfstudio,
    record3d,
    sevenscenes,
    stray,
)
from vioapr.importers.archives import opened_source
from vioapr.importers.base import (
    Finding,
    ImportedScene,
    Importer,
    ImportOptions,
    Place,
    Walk,
    is_pattern,
)
from vioapr.importers.diagnostics import diagnose
from vioapr.importers.source_content import digest_files, digest_walk
from vioapr.importers.write import (
    WriteSettings,
    check_target,
    open_or_create,
    read_import,
    write_recording,
)
from vioapr.scene.scene import Scene
from vioapr.schemas.written import ImportedFrom
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress
from vioapr.work.steps import fingerprint

IMPORTERS: dict[str, Importer] = {
    importer.name: importer
    for importer in (
        marvin.IMPORTER,
        stray.IMPORTER,
        record3d.IMPORTER,
        advio.IMPORTER,
        nerfstudio.IMPORTER,
        frame_files.SCANNER_APP,
        frame_files.POLYCAM,
        ios_logger.IMPORTER,
        sevenscenes.IMPORTER,
        cambridge.IMPORTER,
        capture.IMPORTER,
        images.IMPORTER,
    )
}

_ALIASES = {
    "3d-scanner-app": "3dscannerapp",
    "scanner-app": "3dscannerapp",
    "scannerapp": "3dscannerapp",
    "instant-ngp": "nerfstudio",
    "ioslogger": "ios-logger",
    "nerfcapture": "nerfstudio",
    "sevenscenes": "7scenes",
    "spectacular-ai": "nerfstudio",
    "stray-scanner": "stray",
    "transforms": "nerfstudio",
}


# What is in a source's folder, the clearest marks first.
_MARKS: tuple[tuple[str, str], ...] = (
    ("capture", "capture.json"),
    ("stray", "odometry.csv"),
    ("ios-logger", "ARposes.txt"),
    ("record3d", "metadata"),
    ("polycam", "keyframes/cameras"),
    ("3dscannerapp", "frame_00000.json"),
    ("nerfstudio", "transforms.json"),
    ("cambridge", "dataset_train.txt"),
    ("marvin", "ARKit.txt"),
    ("marvin", "ARCore.txt"),
    ("advio", "iphone/arkit.csv"),
    ("advio", "advio-*_arkit.csv*"),
    ("advio", "advio-*/iphone/arkit.csv"),
    ("7scenes", "seq-*/frame-000000.pose.txt"),
    ("images", "*.jpg"),
    ("images", "*.png"),
    ("images", "*.JPG"),
)

_SOME_USE = (
    "tracker", "poses", "gt", "rate_hz", "metric", "poses_format", "gt_format", "time_unit",
    "vio_from_cam",
)  # fmt: skip


@dataclass(frozen=True)
class Imported:
    """A recording that was imported.

    Attributes:
        folder: Where it is.
        split: Its split, or None.
        is_excluded: Whether it was kept out of the splits, as its tracker diverges.
        findings: What was found out.
    """

    folder: Path
    split: str | None
    is_excluded: bool
    findings: tuple[Finding, ...]


def get_importer(name: str) -> Importer:
    """The importer of a name, or of what else it goes by.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    name = re.sub(r"[ _]", "-", name.lower())
    name = _ALIASES.get(name, name)
    if name not in IMPORTERS:
        raise ParameterError(f"unknown source {name!r}: expected one of {', '.join(IMPORTERS)}")
    return IMPORTERS[name]


def find_importer(folder: Path) -> Importer | None:
    """The importer that a folder is for, by the files in it; None if none of them is known."""
    for name, pattern in _MARKS:
        if next(folder.glob(pattern), None) is not None:
            return IMPORTERS[name]
    return None


def is_known(folder: Path) -> bool:
    """Whether a folder is what one of the importers reads, by the files in it."""
    return find_importer(folder) is not None


def detect_importer(source: Path) -> Importer:
    """The importer that a file or folder is for, by its name or by the files in it.

    Raises:
        ParameterError: None of them is known.
    """
    by_name = {".r3d": "record3d", ".json": "nerfstudio"}
    if source.is_file() and source.suffix.lower() in by_name:
        return IMPORTERS[by_name[source.suffix.lower()]]
    importer = find_importer(source) if source.is_dir() else None
    if importer is None:
        raise ParameterError(
            f"{source}: expected what an app or data set writes, found nothing that is known: give "
            f"its `format`, one of {', '.join(IMPORTERS)}"
        )
    return importer


def import_source(
    importer: Importer | None,
    source: Path,
    out: Path,
    options: ImportOptions,
    *,
    place: Place | None = None,
    link: bool = False,
    overwrite: bool = False,
    progress: Progress,
) -> Iterator[Imported]:
    """Import all of a source's recordings, one after the other.

    A source of several scenes makes a folder in `out` for each. Whatever fails, the recordings
    before are whole and entered; the same import, run again, passes over them. A recording whose
    source has changed since is kept too, with a warning.

    Args:
        importer: Of the source's kind; None to see which by the source.
        source: What to import; a zip, or the pieces of a file, are unpacked meanwhile.
        out: The scene, made if needed.
        options: What the user says of the source.
        place: For a new scene, where the source does not say.
        link: Hard-link images rather than copy them.
        overwrite: Replace recordings that an import wrote, unless the same import would write
            the same.
        progress: Opened once a recording.

    Raises:
        LockedError: Another process imports into the scene.
        VioAprError: The source is not what it should be, or cannot be written.
    """
    takes_patterns = importer is not None and importer.takes_patterns
    if not source.exists() and not (takes_patterns and is_pattern(source)):
        layout = "a source" if importer is None else importer.layout
        raise ParameterError(f"{source}: expected {layout}, found nothing of this name")
    with opened_source(source, out, progress, is_known) as opened:
        importer = importer or detect_importer(opened.path)
        _check_uses(importer, options)
        made_from = fingerprint(importer.name, str(source.resolve()), repr(options))
        noted = ImportedFrom(importer=importer.name, made_from=made_from)
        settings = WriteSettings(
            link, options.focal_px, options.strict, options.max_megapixels, noted, overwrite
        )
        if opened.packed:
            settings = replace(settings, content=digest_files(opened.packed))
        scenes = importer.read(opened.path, options)
        for imported in scenes:
            folder = out / imported.name if len(scenes) > 1 else out
            yield from _import_scene(imported, folder, settings, place, progress)


def _check_uses(importer: Importer, options: ImportOptions) -> None:
    """See that an importer heeds the options that the user gave.

    Raises:
        ParameterError: It does not.
    """
    for name in _SOME_USE:
        if getattr(options, name) not in (None, False) and name not in importer.uses:
            raise ParameterError(f"`{name}` has no meaning for {importer.name}")


def _import_scene(
    imported: ImportedScene,
    folder: Path,
    settings: WriteSettings,
    place: Place | None,
    progress: Progress,
) -> Iterator[Imported]:
    """Import the recordings of one scene; see `import_source`."""
    scene = None
    with ExitStack() as held:
        for walk in imported.read():
            if scene is None:
                check_target(folder, imported, place)
                held.enter_context(locked_folder(folder))
                scene = open_or_create(folder, imported, place)
            settings = _with_content(settings, walk)
            restore_folder(scene.recording_folder(walk.id))
            if (kept := _compare_with_before(scene, walk, settings)) is not None:
                split = next((name for name, ids in scene.splits.items() if walk.id in ids), None)
                yield Imported(
                    folder=scene.recording_folder(walk.id),
                    split=split,
                    is_excluded=walk.id in scene.excluded,
                    findings=(kept,),
                )
                continue
            diagnose(walk)
            with progress(f"importing {walk.id}", len(walk)) as tick:
                scene = write_recording(scene, walk, settings, tick=tick)
            yield Imported(
                folder=scene.recording_folder(walk.id),
                split=None if walk.info.is_diverging else walk.split,
                is_excluded=walk.info.is_diverging,
                findings=tuple(walk.findings),
            )


def _with_content(settings: WriteSettings, walk: Walk) -> WriteSettings:
    """The settings with a digest of what the source holds, to be noted with the recording."""
    noted = settings.imported_from
    if noted is None:
        return settings
    noted = msgspec.structs.replace(noted, content=settings.content or digest_walk(walk))
    return replace(settings, imported_from=noted)


def _compare_with_before(scene: Scene, walk: Walk, settings: WriteSettings) -> Finding | None:
    """What to say of a recording that the same import wrote before, if it is to be kept.

    Raises:
        FormatError: The source has changed since, under `strict`.
    """
    noted, given = read_import(scene, walk.id), settings.imported_from
    if noted is None or given is None:
        return None
    if (noted.importer, noted.made_from) != (given.importer, given.made_from):
        return None
    if noted.content in ("", given.content):
        return Finding("imported before, by the same import: kept as it is")
    if settings.overwrite:
        return None
    changed = "the source has changed since the recording was imported"
    if settings.strict:
        raise FormatError(walk.source, f"{changed}: give `overwrite` to import it again")
    text = f"{changed}, which is kept as it was: give `overwrite` to import it again"
    return Finding(text, is_warning=True)
