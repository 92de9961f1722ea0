"""Agisoft Metashape's cameras XML: a 4x4 `transform` for each camera, and one for the chunk.

A camera's matrix is chunk_from_cam by rows, with OpenCV axes; the chunk's (or its component's)
rotation, translation and scale take the chunk to the world: geocentric, metres, where the project
is georeferenced, and local otherwise. The matrices are those of the Python API, `Camera.transform`
and `Chunk.transform`; the files agree with converters that read them (nerfstudio/process_data/
metashape_utils.py; geograypher, cameras/derived_cameras.py).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import Rows
from vioapr.files.text import read_text
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.matrix_order import TRANSPOSED, to_rows
from vioapr.formats.named import build_named
from vioapr.formats.poses import rigid_of_matrices
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_GEOCENTRIC_M = 1e6


def sniff(path: Path, head: bytes) -> float:
    """Sure of XML that begins with a document, a chunk and cameras."""
    del path
    start = head[:4096]
    is_xml = start.lstrip(b"\xef\xbb\xbf \r\n\t")[:1] == b"<"
    return 0.95 if is_xml and b"<document" in start and b"<chunk" in start else 0.0


def read(path: Path, options: ReadOptions) -> Trajectory:
    """Read world_from_cam poses, in the natural order of the cameras' labels.

    Cameras that are not aligned have no pose.

    Args:
        path: The file of "Export Cameras", Agisoft XML.
        options: Rate and strictness.

    Raises:
        FileError: It cannot be read or is malformed, naming file and the camera's number in it.
        ParameterError: The options do not fit the labels.
    """
    chunk = _choose_chunk(path, _parse(path), options)
    cameras = [camera for group in chunk.findall("cameras") for camera in group.iter("camera")]
    if not cameras:
        raise FormatError(path, "expected cameras in the chunk, got none")
    names: list[str] = []
    matrices: list[NDArray[np.float64]] = []
    similarities: list[_World] = []
    worlds = _world_from_chunk(path, chunk)
    for entry, camera in enumerate(cameras, start=1):
        names.append(camera.get("label") or f"camera-{camera.get('id', entry)}")
        transform = camera.find("transform")
        similarities.append(worlds.get(camera.get("component_id"), worlds[None]))
        if transform is None:
            matrices.append(np.full((4, 4), np.nan))
        else:
            numbers = _numbers(path, transform, 16, "a camera's transform", entry)
            matrices.append(numbers.reshape(4, 4))
    rows = Rows.numbered(path, len(names))
    in_chunk, is_transposed = to_rows(np.array(matrices))
    if is_transposed:
        options.note(path, TRANSPOSED, is_warning=True)
    for matrix, (rotation, translation, scale) in zip(in_chunk, similarities, strict=True):
        with np.errstate(all="ignore"):  # numbers too large are found with the poses
            matrix[:3, 3] = scale * (rotation @ matrix[:3, 3]) + translation
            matrix[:3, :3] = rotation @ matrix[:3, :3]
    poses: Rigid3 = rigid_of_matrices(rows, in_chunk)
    _note_world(path, chunk, poses, options)
    return build_named(rows, names, poses, options)


def _parse(path: Path) -> Element:
    from xml.etree import ElementTree as ET  # slow, and the registry imports all formats

    text = read_text(path)
    # Entities can make a small file a large one; Metashape writes none.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise FormatError(path, "expected XML without a document type")
    try:
        return ET.fromstring(text)
    except ET.ParseError as error:
        raise FormatError(path, f"expected XML: {error}", error.position[0]) from None
    except (ValueError, RecursionError) as error:
        raise FormatError(path, f"expected XML that can be read: {error}") from None


def _choose_chunk(path: Path, root: Element, options: ReadOptions) -> Element:
    """The chunk that `sequence` names, or the only one with cameras."""
    chunks = [chunk for chunk in root.iter("chunk") if chunk.find("cameras") is not None]
    if not chunks:
        raise FormatError(path, "expected a chunk with cameras (Export Cameras, Agisoft XML)")
    if len(chunks) == 1:
        return chunks[0]
    labels = [chunk.get("label", "") for chunk in chunks]
    if options.sequence in labels:
        return chunks[labels.index(options.sequence)]
    listed = ", ".join(labels)
    raise ParameterError(f"{path} holds several chunks: choose one with `sequence`: {listed}")


_World = tuple[NDArray[np.float64], NDArray[np.float64], float]


def _world_from_chunk(path: Path, chunk: Element) -> dict[str | None, _World]:
    """Rotation, translation and scale of the chunk (None) and of each of its components."""
    worlds: dict[str | None, _World] = {None: _similarity(path, chunk.find("transform"))}
    for component in chunk.findall("components/component"):
        if (transform := component.find("transform")) is not None:
            worlds[component.get("id")] = _similarity(path, transform)
    return worlds


def _similarity(path: Path, transform: Element | None) -> _World:
    rotation, translation, scale = np.eye(3), np.zeros(3), 1.0
    if transform is not None:
        if (element := transform.find("rotation")) is not None:
            rotation = _numbers(path, element, 9, "the chunk's rotation").reshape(3, 3)
        if (element := transform.find("translation")) is not None:
            translation = _numbers(path, element, 3, "the chunk's translation")
        if (element := transform.find("scale")) is not None:
            scale = float(_numbers(path, element, 1, "the chunk's scale")[0])
            if not (math.isfinite(scale) and scale > 0):
                raise FormatError(path, f"expected a scale above 0, got {scale}")
    return rotation, translation, scale


def _numbers(
    path: Path, element: Element, count: int, what: str, entry: int | None = None
) -> NDArray[np.float64]:
    fields = (element.text or "").split()
    try:
        values = np.array(fields, dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if values.shape != (count,):
        raise FormatError(path, f"expected {count} numbers in {what}, got {len(fields)}", entry)
    return values


def _note_world(path: Path, chunk: Element, poses: Rigid3, options: ReadOptions) -> None:
    known = poses.translation_m[poses.is_known]
    if len(known) and np.abs(known).max() > _GEOCENTRIC_M:
        text = "positions are geocentric (georeferenced project): z is not up"
        options.note(path, text, is_warning=True)
    elif next(chunk.iter("scale"), None) is None:
        text = "the project has no scale: positions are not metres"
        options.note(path, text, is_warning=True)


FORMAT = Format(
    name="metashape",
    title="Agisoft Metashape cameras XML",
    convention=(
        "4x4 transform a camera, by rows, times the chunk's; world_from_cam, OpenCV axes, no times"
    ),
    extensions=(".xml",),
    sniff=sniff,
    read=read,
    has_names=True,
)
