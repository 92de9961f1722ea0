"""The demo: a walk through a simulated courtyard, and a localizer of the place.

Both come with the package, the walk's scene as one archive. `scripts/make_demo.py` writes them;
docs/guide/demo.md says how they were made.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

from vioapr.files.atomic import replacing
from vioapr.files.images import IMAGE_SUFFIXES
from vioapr.scene.scene import RECORDINGS_FOLDER
from vioapr.work.results import ResultFolder

LOCALIZER_FILE = "localizer.onnx"
SCENE_FOLDER = "courtyard"
ARCHIVE_FILE = f"{SCENE_FOLDER}.zip"
RECORDING = "test-01"

_OLDEST = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the archive: the same files give the same archive."""


@dataclass(frozen=True)
class Demo:
    """A walk to localize, and where the results go: the values of `vioapr localize`.

    Attributes:
        model: The localizer.
        recording: The walk's folder.
        out: The CSV file to write.
        predictions: The file of raw predictions to write.
        report: The folder of the report to write.
    """

    model: Path
    recording: Path
    out: Path
    predictions: Path
    report: Path


def demo_in(folder: Path) -> Demo:
    """Say where everything of the demo is in a folder."""
    return Demo(
        folder / LOCALIZER_FILE,
        folder / SCENE_FOLDER / RECORDINGS_FOLDER / RECORDING,
        folder / "fused.csv",
        folder / "predictions.tum",
        folder / "report",
    )


def unpack_demo(folder: Path, *, overwrite: bool = False) -> Demo:
    """Copy scene and localizer out of the package; files of an earlier demo are replaced.

    Args:
        folder: Made if needed; other files in it stay.
        overwrite: Whether files of the same names may be replaced that no demo wrote.

    Raises:
        AlreadyExistsError: There are such, and they are not to be replaced.
        UnwritableError: The folder, or a file in it, cannot be written.
    """
    package = files("vioapr.recipes") / "data"
    with ResultFolder(folder, overwrite=overwrite).adding() as partial:
        with (package / ARCHIVE_FILE).open("rb") as file, ZipFile(file) as archive:
            archive.extractall(partial)
        (partial / LOCALIZER_FILE).write_bytes((package / LOCALIZER_FILE).read_bytes())
    return demo_in(folder)


def pack_folder(folder: Path, archive: Path) -> None:
    """Write a folder and all that is in it as an archive, the same bytes for the same files.

    Args:
        folder: Its name is the first part of all names in the archive.
        archive: The file to write, ending in .zip.

    Raises:
        UnwritableError: The archive cannot be written; what was there stays.
    """
    with replacing(archive) as partial, ZipFile(partial, "w") as packed:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            entry = ZipInfo(path.relative_to(folder.parent).as_posix(), _OLDEST)
            entry.external_attr = 0o644 << 16
            is_image = path.suffix.lower() in IMAGE_SUFFIXES  # compressed already
            entry.compress_type = ZIP_STORED if is_image else ZIP_DEFLATED
            packed.writestr(entry, path.read_bytes())
