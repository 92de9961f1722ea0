"""All importers, and importing a source into a scene."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import ParameterError
from vioapr.importers import (
    advio,
    cambridge,
    frame_files,
    images,
    ios_logger,
    marvin,
    nerfstudio,
    record3d,
    sevenscenes,
    stray,
)
from vioapr.importers.base import (
    Finding,
    ImportedScene,
    Importer,
    ImportOptions,
    Place,
    is_pattern,
)
from vioapr.importers.diagnostics import diagnose
from vioapr.importers.write import (
    WriteSettings,
    check_target,
    is_imported,
    open_or_create,
    write_recording,
)
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


def import_source(
    importer: Importer,
    source: Path,
    out: Path,
    options: ImportOptions,
    *,
    place: Place | None = None,
    link: bool = False,
    progress: Progress,
) -> Iterator[Imported]:
    """Import all of a source's recordings, one after the other.

    A source of several scenes makes a folder in `out` for each. Whatever fails, the recordings
    before are whole and entered; the same import, run again, passes over them.

    Args:
        importer: Of the source's kind.
        source: What to import.
        out: The scene, made if needed.
        options: What the user says of the source.
        place: For a new scene, where the source does not say.
        link: Hard-link images rather than copy them.
        progress: Opened once a recording.

    Raises:
        LockedError: Another process imports into the scene.
        VioAprError: The source is not what it should be, or cannot be written.
    """
    for name in _SOME_USE:
        if getattr(options, name) not in (None, False) and name not in importer.uses:
            raise ParameterError(f"`{name}` has no meaning for {importer.name}")
    if not source.exists() and not (importer.takes_patterns and is_pattern(source)):
        raise ParameterError(f"{source}: expected {importer.layout}, found nothing of this name")
    made_from = fingerprint(importer.name, str(source.resolve()), repr(options))
    noted = ImportedFrom(importer=importer.name, made_from=made_from)
    settings = WriteSettings(link, options.focal_px, options.strict, options.max_megapixels, noted)
    scenes = importer.read(source, options)
    for imported in scenes:
        folder = out / imported.name if len(scenes) > 1 else out
        yield from _import_scene(imported, folder, settings, place, progress)


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
            if settings.imported_from and is_imported(scene, walk.id, settings.imported_from):
                split = next((name for name, ids in scene.splits.items() if walk.id in ids), None)
                yield Imported(
                    folder=scene.recording_folder(walk.id),
                    split=split,
                    is_excluded=walk.id in scene.excluded,
                    findings=(Finding("imported before, by the same import: kept as it is"),),
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
