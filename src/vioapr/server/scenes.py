"""What clients read of scenes: summaries, recordings, maps, content and localizers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np
from starlette.requests import Request
from starlette.responses import Response

from vioapr.errors import AlreadyExistsError, FileMissingError, VioAprError
from vioapr.files.onnx_metadata import read_onnx_metadata
from vioapr.files.text import read_text, write_text
from vioapr.formats.colmap_points import POINTS_FILE, read_points
from vioapr.scene.recording import (
    FRAMES_FILE,
    GNSS_FILE,
    HEADING_FILE,
    IMAGES_FOLDER,
    IMU_FILE,
    INFO_FILE,
)
from vioapr.scene.scene import Scene, check_id
from vioapr.scene.summary import summarize_scene
from vioapr.schemas.anchors import AnchorsDocument
from vioapr.schemas.base import decode, encode
from vioapr.schemas.contract import METADATA_KEY, parse
from vioapr.schemas.server import LocalizerEntry, NewScene, SceneEntry
from vioapr.server.content import Hashes, send_file
from vioapr.server.layout import ANCHORS_FILE, ServedFolder
from vioapr.server.refusals import Refusal, answer

MAP_SUMMARY_FILE, BUILD_SUMMARY_FILE = "map.json", "build/build.json"
_MAX_POINTS = 400_000
"""A phone draws no more, and 6 MB are enough to send."""

_TABLES = (INFO_FILE, FRAMES_FILE, IMU_FILE, GNSS_FILE, HEADING_FILE)
_LOCALIZER_FOLDERS = ("*.onnx", "*/*.onnx", "*/*/*.onnx", "*/*/*/*.onnx")


def describe_scene(served: ServedFolder, id_: str) -> SceneEntry:
    """A scene in short; of a broken one, why."""
    try:
        scene = served.scene(id_)
        splits = dict.fromkeys(scene.recording_ids, "")
        splits |= {other: name for name, ids in scene.splits.items() for other in ids}
        splits |= dict.fromkeys(scene.excluded, "excluded")
        return SceneEntry(
            id=id_,
            name=scene.name,
            is_outdoor=scene.is_outdoor,
            recordings=splits,
            has_map=(scene.map_folder / MAP_SUMMARY_FILE).exists(),
            has_anchors=(scene.folder / ANCHORS_FILE).exists(),
        )
    except FileMissingError:
        raise
    except VioAprError as error:
        return SceneEntry(id=id_, name=id_, problem=str(error))


def make_scene(served: ServedFolder, wanted: NewScene) -> SceneEntry:
    """Make an empty scene.

    Raises:
        AlreadyExistsError: A folder of this name is there.
        UnwritableError: It cannot be written.
    """
    folder = served.scene_folder(wanted.id)
    try:
        folder.mkdir()
    except FileExistsError:
        text = "expected the name of a new folder, but there is one"
        raise AlreadyExistsError(wanted.id, text) from None
    Scene.create(folder, wanted.name or wanted.id, is_outdoor=wanted.is_outdoor)
    return describe_scene(served, wanted.id)


def send_summary(served: ServedFolder, id_: str) -> Response:
    """What `vioapr scene info --json` says of a scene."""
    return answer(summarize_scene(served.scene(id_)).to_record())


def send_recording_file(served: ServedFolder, request: Request, id_: str, name: str) -> Response:
    """A table or an image of a recording.

    Raises:
        FileMissingError: It is not there, or is no file of a recording.
    """
    folder = served.scene(id_).recording_folder(request.path_params["recording"])
    path = PurePosixPath(name)
    is_image = len(path.parts) == 2 and path.parts[0] == IMAGES_FOLDER and path.name[:1] != "."
    if name not in _TABLES and not is_image:
        raise FileMissingError(name[:80], "expected a file of a recording")
    return send_file(request, folder / path)


def send_gt(served: ServedFolder, request: Request, id_: str) -> Response:
    """The ground truth of a recording.

    Raises:
        FileMissingError: There is none.
    """
    return send_file(request, served.scene(id_).gt_path(request.path_params["recording"]))


def send_map_summary(served: ServedFolder, request: Request, id_: str) -> Response:
    """The `map.json` that `vioapr map` wrote.

    Raises:
        FileMissingError: The scene is not mapped.
    """
    return send_file(request, served.scene(id_).map_folder / MAP_SUMMARY_FILE)


def send_map_points(served: ServedFolder, request: Request, id_: str, hashes: Hashes) -> Response:
    """The points of a scene's map, 16 bytes each: x, y, z as f32, red, green, blue as u8, a zero.

    Raises:
        FileMissingError: The scene is not mapped.
    """
    path = served.scene(id_).map_folder / POINTS_FILE
    headers = {"etag": f'"{hashes.of(path)}"', "cache-control": "no-cache"}
    if request.headers.get("if-none-match") == headers["etag"]:
        return Response(status_code=304, headers=headers)
    positions, colours = read_points(path)
    step = max(1, -(-len(positions) // _MAX_POINTS))
    rows = np.zeros(len(positions[::step]), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 4)])
    rows["xyz"], rows["rgb"][:, :3] = positions[::step], colours[::step]
    return Response(rows.tobytes(), headers=headers, media_type="application/octet-stream")


def send_build_summary(served: ServedFolder, request: Request, id_: str) -> Response:
    """The `build.json` that `vioapr build` wrote.

    Raises:
        FileMissingError: There is none.
    """
    return send_file(request, served.scene(id_).folder / BUILD_SUMMARY_FILE)


def send_anchors(served: ServedFolder, request: Request, id_: str, hashes: Hashes) -> Response:
    """The content of a scene.

    Raises:
        FileMissingError: There is none.
    """
    path = served.scene(id_).folder / ANCHORS_FILE
    return send_file(request, path, hashes.of(path))


def write_anchors(
    served: ServedFolder, request: Request, id_: str, content: bytes, hashes: Hashes
) -> Response:
    """Replace the content of a scene, unless somebody else did so meanwhile.

    Args:
        served: The folder.
        request: `If-Match` must be the ETag of what is replaced, `If-None-Match: *` of nothing.
        id_: The scene's.
        content: JSON.
        hashes: Of files.

    Raises:
        Refusal: It was changed meanwhile, or the header lacks.
        FormatError: It is no such document.
    """
    path = served.scene(id_).folder / ANCHORS_FILE
    found = f'"{hashes.of(path)}"' if path.exists() else None
    if found is None and request.headers.get("if-none-match") != "*":
        raise Refusal(412, "there is no content yet: expected If-None-Match: *")
    if found is not None and request.headers.get("if-match") != found:
        raise Refusal(412, "expected If-Match with the ETag of the content: it has changed")
    document = decode(ANCHORS_FILE, content, AnchorsDocument)
    for anchor in document.anchors:
        _check_model(anchor.model)
    write_text(path, encode(document))
    etag = f'"{hashes.of(path)}"'
    return Response(status_code=204, headers={"etag": etag, "cache-control": "no-cache"})


def send_model(
    served: ServedFolder, request: Request, id_: str, name: str, hashes: Hashes
) -> Response:
    """A glTF model that the content of a scene names; no other file.

    Raises:
        FileMissingError: It is not there, or not named.
    """
    folder = served.scene(id_).folder
    path = folder / ANCHORS_FILE
    document = decode(path, read_text(path), AnchorsDocument)
    if name not in {anchor.model for anchor in document.anchors if anchor.model}:
        raise FileMissingError(name[:80], f"expected a model that {ANCHORS_FILE} names")
    _check_model(name)
    return send_file(request, folder / name, hashes.of(folder / name))


def _check_model(name: str) -> None:
    """See that a model's path stays in its scene's folder.

    Raises:
        Refusal: It does not.
    """
    parts = PurePosixPath(name).parts
    if name and (name.startswith("/") or "\\" in name or any(p[:1] == "." for p in parts)):
        raise Refusal(422, f"expected a model's path in the scene's folder, got {name[:80]!r}")


def localizers(served: ServedFolder, hashes: Hashes) -> list[LocalizerEntry]:
    """All files that `vioapr export` wrote, in the folder or in its scenes; others are left out."""
    found: list[LocalizerEntry] = []
    for path in _onnx_files(served.folder):
        relative = path.relative_to(served.folder)
        try:
            contract = parse(read_onnx_metadata(path).get(METADATA_KEY), str(relative))
        except VioAprError:
            continue
        scene = relative.parts[0] if len(relative.parts) > 1 else ""
        found.append(
            LocalizerEntry(
                path=relative.as_posix(),
                scene=scene if scene in served.scene_ids() else "",
                size_bytes=path.stat().st_size,
                sha256=hashes.of(path),
                contract=contract,
            )
        )
    return found


def send_localizer(served: ServedFolder, request: Request, name: str, hashes: Hashes) -> Response:
    """A localizer.

    Raises:
        FileMissingError: There is none at this path.
    """
    known = {
        path.relative_to(served.folder).as_posix(): path for path in _onnx_files(served.folder)
    }
    if name not in known:
        raise FileMissingError(name[:80], "expected a localizer, found none at this path")
    parse(read_onnx_metadata(known[name]).get(METADATA_KEY), name)
    return send_file(request, known[name], hashes.of(known[name]))


def _onnx_files(folder: Path) -> Iterator[Path]:
    for pattern in _LOCALIZER_FOLDERS:
        for path in sorted(folder.glob(pattern)):
            parts = path.relative_to(folder).parts
            if path.is_file() and not any(part.startswith(".") for part in parts):
                yield path


def check_recording_free(scene: Scene, recording: str) -> None:
    """See that a recording's id is free.

    Raises:
        AlreadyExistsError: It is taken.
    """
    if scene.recording_folder(check_id(recording)).exists():
        text = "expected the id of a new recording, but there is one: choose another"
        raise AlreadyExistsError(recording, text)
