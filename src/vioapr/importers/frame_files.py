"""Apps that write a JSON file a frame beside its image: 3D Scanner App and Polycam."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.text import require_folder
from vioapr.formats.frame_files import (
    FrameFiles,
    find_polycam,
    find_scanner_app,
    read_polycam,
    read_scanner_app,
)
from vioapr.formats.matrix_order import TRANSPOSED
from vioapr.importers import nerfstudio
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    one_walk,
    tracking_of,
)
from vioapr.importers.diagnostics import MAX_NAMED
from vioapr.importers.image_paths import with_ending
from vioapr.importers.matrices import poses_of_matrices
from vioapr.plurals import count_of
from vioapr.scene.frames import Intrinsics
from vioapr.schemas.recording import RecordingInfo

_SCANNER_APP, _POLYCAM = "3D Scanner App", "Polycam"
_DEFAULT_RATE_HZ = 1.0


def read_scanner_app_walk(source: Path, options: ImportOptions) -> Walk:
    """Read an "All Data" folder: images of some of the frames, poses of all.

    Raises:
        FormatError: It is none.
    """
    if not find_scanner_app(source):
        raise FormatError(source, "expected frame_00000.json and so on, found none")
    walk = build_walk(source, source, read_scanner_app(source), _SCANNER_APP, options)
    walk.is_thinned = True
    return walk


def read_polycam_walk(source: Path, options: ImportOptions) -> Walk:
    """Read the raw data of a capture; the corrected cameras where there are any.

    Raises:
        FormatError: It is none.
    """
    found = find_polycam(source)
    if found is None:
        raise FormatError(source, "expected keyframes/cameras/ with a .json a frame, found none")
    paths, images = found
    walk = build_walk(source, images, read_polycam(source, paths), _POLYCAM, options)
    kind = paths[0].parent.name
    is_corrected = kind.startswith("corrected")
    walk.note(f"poses: of {kind}/, {'as Polycam corrected them' if is_corrected else 'as ARKit'}")
    if not images.is_dir():
        walk.warn(f"images: expected a folder {images.name}/, found none")
    return walk


def build_walk(
    source: Path, images: Path, found: FrameFiles, title: str, options: ImportOptions
) -> Walk:
    """Make a walk of frames' files, whose images have the same names.

    Args:
        source: The capture.
        images: The folder of the images.
        found: The files.
        title: The app.
        options: The rate counts where no file has a time.
    """
    is_timed = any(np.isfinite(frame.timestamp_s) for frame in found.frames)
    if is_timed:
        found = found.ordered()
        times = np.array([frame.timestamp_s for frame in found.frames])
    else:
        times = np.arange(len(found.frames)) / (options.rate_hz or _DEFAULT_RATE_HZ)
    paths = [with_ending(images / f"{frame.path.stem}.jpg") for frame in found.frames]
    poses = poses_of_matrices(np.array([frame.matrix for frame in found.frames]))
    for row, problem in poses.problems.items():
        path = found.frames[row].path
        found.problems.append(FormatError(path, f"{problem}: the frame has no pose"))
    walk = Walk(
        id=options.id or id_of(source.resolve().name),
        split=options.split_or("train"),
        info=RecordingInfo(
            tracker="ARKit", source=title, clock="device" if is_timed else "frame-rate"
        ),
        source=source,
        timestamp_s=times,
        image_names=["" if path is None else path.name for path in paths],
        images=paths,
        vio_from_cam=poses.world_from_cam,
        tracking=tracking_of(poses.world_from_cam),
        intrinsics=Intrinsics(*np.array([frame.camera for frame in found.frames]).T),
        up="definition",
    )
    if poses.is_transposed:
        walk.warn(TRANSPOSED)
    if not is_timed:
        text = f"no timestamps: counted at {options.rate_hz or _DEFAULT_RATE_HZ:g} Hz"
        (walk.warn if options.rate_hz is None else walk.note)(text)
    if found.problems:
        named = "; ".join(str(problem) for problem in found.problems[:MAX_NAMED])
        more = "; ..." if len(found.problems) > MAX_NAMED else ""
        walk.warn(
            f"{count_of(len(found.problems), 'frame is', 'frames are')} not whole: {named}{more}"
        )
    return walk


def _read_scanner_app(source: Path, options: ImportOptions) -> list[ImportedScene]:
    require_folder(source, f'a folder of {_SCANNER_APP}\'s "All Data"')
    return one_walk(lambda: read_scanner_app_walk(source, options))


def _read_polycam(source: Path, options: ImportOptions) -> list[ImportedScene]:
    if source.is_file() or ((source / "transforms.json").exists() and find_polycam(source) is None):
        return nerfstudio.read(source, options)
    require_folder(source, f"a folder of {_POLYCAM}'s raw data")
    return one_walk(lambda: read_polycam_walk(source, options))


SCANNER_APP = Importer(
    name="3dscannerapp",
    title="3D Scanner App (iPhone), All Data",
    layout='a folder of "All Data" with frame_00000.json and frame_00000.jpg',
    read=_read_scanner_app,
    uses=frozenset({"rate_hz"}),
)

POLYCAM = Importer(
    name="polycam",
    title="Polycam (iPhone), raw data",
    layout="a folder with keyframes/cameras/ and keyframes/images/, or transforms.json",
    read=_read_polycam,
    uses=frozenset({"rate_hz", "metric"}),
)
