"""`vioapr import`: recordings of other apps and data sets, into a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.console import progress, say
from vioapr.cli.flags import fill_flags, flag_names
from vioapr.formats.base import TimeUnit
from vioapr.importers.base import DEFAULT_MAX_MEGAPIXELS, ImportOptions, Place, Split
from vioapr.importers.registry import get_importer, import_source
from vioapr.plurals import count_of
from vioapr.scene.faces import find_network
from vioapr.scene.scene import Scene


def import_(
    format: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="FORMAT")],
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")],
    out: Path,
    split: Split | None = None,
    id: str | None = None,
    place: Place | None = None,
    images: Literal["copy", "link"] = "copy",
    tracker: str | None = None,
    poses: Path | None = None,
    gt: Path | None = None,
    poses_format: str | None = None,
    gt_format: str | None = None,
    time_unit: TimeUnit | None = None,
    rate_hz: float | None = None,
    focal_px: float | None = None,
    metric: bool = False,
    max_megapixels: float = DEFAULT_MAX_MEGAPIXELS,
    vio_from_cam: Annotated[str | None, tyro.conf.arg(metavar="auto|FILE")] = None,
    anonymize: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    strict: bool = False,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Import what another app or data set recorded into a scene, and say what was found.

    What each format must hold is in docs/reference/scene.md.

    Args:
        format: stray, record3d, 3dscannerapp, polycam, ios-logger, nerfstudio (any
            transforms.json), capture (of `vioapr serve`), advio, marvin, 7scenes, cambridge, or
            images (a folder of images with any trajectory file); auto: see by the source.
        source: The file or folder to import, or a zip of it; of images, also a pattern as
            'walk/**/*.jpg'.
        out: The scene's folder, made if needed; recordings are added to what is there.
        split: train, test or none; by default the data set's own, else train.
        id: Of the recording, for sources with a single one; by default the source's name.
        place: outdoor or indoor, for a new scene whose source does not say.
        images: link: hard-link images instead of copying them, where the disk allows.
        tracker: arkit or arcore, for sources with both; for images, who made the poses.
        poses: The tracker's trajectory for a folder of images, in any format.
        gt: The ground truth's trajectory for a folder of images, in any format.
        poses_format: The format of --poses; by default the one that it looks like.
        gt_format: The format of --gt.
        time_unit: s, ms, us or ns: the unit of times in --poses and --gt.
        rate_hz: Frames per second, for sources without timestamps.
        focal_px: Focal length in pixels of the images as they are, where the source has none or
            a wrong one.
        metric: The poses are in metres, although the source does not show it (nerfstudio, images).
        max_megapixels: The largest image to import; at most 400.
        vio_from_cam: For --poses of an IMU's body: how the camera is mounted on it. auto estimates
            it by --gt; FILE holds the constant transform body_from_cam, see `vioapr fuse --help`.
        anonymize: Blur the faces in the imported images (pip install 'vioapr[anonymize]'); see
            `vioapr scene anonymize --help`. The source stays as it is.
        strict: Refuse what is otherwise imported with a warning.
        overwrite: Replace a recording of the same id that an import wrote, if its source or the
            options have changed since; never one with files that no import wrote.

    Example:
        vioapr import stray 8653a2142b --out courtyard --place outdoor

    Raises:
        VioAprError: The source is not what it should be, or cannot be written.
    """
    options = ImportOptions(
        id,
        split,
        tracker,
        poses,
        gt,
        rate_hz,
        poses_format,
        gt_format,
        time_unit,
        focal_px,
        metric,
        max_megapixels,
        strict,
        vio_from_cam,
    )
    importer = None if format == "auto" else get_importer(format)
    if anonymize:
        find_network()  # before the work: without it, faces would stay
    flags = flag_names(import_)
    count = 0
    for imported in import_source(
        importer,
        source,
        out,
        options,
        place=place,
        link=images == "link",
        overwrite=overwrite,
        progress=progress,
    ):
        where = "excluded" if imported.is_excluded else imported.split or "in no split"
        say(f"{imported.folder} ({where})", "bold")
        for finding in imported.findings:
            warning, style = ("WARNING ", "yellow") if finding.is_warning else ("", "")
            say(f"  {warning}{fill_flags(finding.text, flags)}", style)
        if anonymize:
            blur_faces_of(imported.folder)
        count += 1
    say(f"{out}: {count_of(count, 'recording')} imported")


def blur_faces_of(recording: Path) -> None:
    """Blur the faces in a recording of a scene, and say how many there were."""
    from vioapr.cli.scene import anonymize

    anonymize(Scene.open(recording.parents[1]), [recording.name])
