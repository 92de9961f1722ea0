"""Faces in a scene's pictures made unrecognizable, one recording after the other.

`anonymized.csv` in a recording says which pictures are done and how many faces were in each, so
that work that was stopped goes on. A picture is on disk before its line is.
"""

from __future__ import annotations

import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import UnwritableError
from vioapr.files.atomic import write_atomically
from vioapr.files.images import IMAGE_SUFFIXES, copy_image, encode_image, read_rgb
from vioapr.files.text import write_text
from vioapr.geometry import quaternion
from vioapr.scene.faces import Face, blur_faces, pick_apart
from vioapr.scene.recording import IMAGES_FOLDER, Recording
from vioapr.scene.scene import CACHE_FOLDER, Scene
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Tick, ignore

ANONYMIZED_FILE = "anonymized.csv"
ORIGINALS_FOLDER = "originals"
_HEADER = "image,bytes,faces"


class Detector(Protocol):
    """What finds faces; see `vioapr.scene.faces.FaceDetector`."""

    def find(self, pixels: NDArray[np.uint8]) -> list[Face]:
        """Find upright faces."""
        ...


class Anonymized(NamedTuple):
    """What was found in a recording, now and before.

    Attributes:
        images: Looked at.
        with_faces: Images that had faces.
        faces: In all of them.
    """

    images: int
    with_faces: int
    faces: int


def count_images(scene: Scene, id_: str) -> int:
    """How many images a recording's folder has: how often `anonymize_recording` ticks."""
    return len(_images_in(scene.recording_folder(id_)))


def anonymize_recording(
    scene: Scene,
    id_: str,
    detector: Detector,
    *,
    keep_originals: bool = False,
    tick: Tick = ignore,
) -> Anonymized:
    """Blur the faces in all images of a recording, also in those that belong to no frame.

    Images without faces stay as they are. Others are written again, without what cameras note
    beside the pixels, such as a small preview. Caches of decoded images are removed.

    Args:
        scene: The recording's.
        id_: Of the recording.
        detector: Finds faces.
        keep_originals: Copy images with faces to `originals/` in the scene first.
        tick: Called after every image.

    Raises:
        LockedError: Another process does the same.
        FileError: An image is broken, or cannot be written; what is done stays.
    """
    recording = scene.recording(id_)
    turns = find_turns(recording)
    with locked_folder(recording.folder), _open_notes(recording.folder) as (done, notes):
        for path in _images_in(recording.folder):
            size, _ = done.get(path.name, (-1, 0))
            if size != path.stat().st_size:
                pixels = read_rgb(path)
                faces = find_faces(pixels, detector, turns.get(path.name, range(4)))
                if faces:
                    if keep_originals:
                        _keep(path, scene.folder / ORIGINALS_FOLDER / id_ / path.name)
                    _remove_caches(scene)
                    write_atomically(path, encode_image(path.name, blur_faces(pixels, faces)))
                done[path.name] = path.stat().st_size, len(faces)
                _note(notes, recording.folder, path.name, *done[path.name])
            tick()
        counts = [faces for _, faces in done.values()]
    return Anonymized(len(counts), sum(count > 0 for count in counts), sum(counts))


def find_turns(recording: Recording) -> dict[str, list[int]]:
    """Find by how many quarters, counterclockwise, images are to be turned to be upright.

    Returns:
        By image name, of frames whose tracker knows where up is; a tilted camera has two answers.
    """
    if not recording.info.is_gravity_aligned:
        return {}
    frames = recording.frames
    turns: dict[str, list[int]] = {}
    for row in np.flatnonzero(frames.has_pose & frames.has_image).tolist():
        cam_from_vio = quaternion.inverse(frames.vio_from_cam.quat_xyzw[row])
        x, y, _ = quaternion.rotate(cam_from_vio, np.array([0.0, 1.0, 0.0])).tolist()
        quarters = float(np.arctan2(x, -y)) / (np.pi / 2)
        near = {round(quarters - 0.2) % 4, round(quarters + 0.2) % 4}
        looks_up_or_down = np.hypot(x, y) < 0.5
        turns[frames.image[row]] = [*range(4)] if looks_up_or_down else sorted(near)
    return turns


def find_faces(
    pixels: NDArray[np.uint8], detector: Detector, turns: list[int] | range
) -> list[Face]:
    """Find faces in an image as the sensor gave it.

    Args:
        pixels: RGB, shape (height, width, 3).
        detector: Finds upright faces.
        turns: Quarters, counterclockwise, by which the image may have to be turned.
    """
    height, width = pixels.shape[:2]
    found: list[Face] = []
    for quarter_turns in turns:
        faces = detector.find(np.ascontiguousarray(np.rot90(pixels, quarter_turns)))
        found += [_turned_back(face, width, height, quarter_turns) for face in faces]
    if not found:
        return []
    boxes = np.array(found)
    return [found[row] for row in pick_apart(boxes, np.prod(boxes[:, 2:] - boxes[:, :2], axis=1))]


def _turned_back(face: Face, width: int, height: int, quarter_turns: int) -> Face:
    """A box of an image that was turned counterclockwise, in the image as it was."""
    left, top, right, bottom = face
    if quarter_turns == 1:
        return Face(width - bottom, left, width - top, right)
    if quarter_turns == 2:
        return Face(width - right, height - bottom, width - left, height - top)
    if quarter_turns == 3:
        return Face(top, height - right, bottom, height - left)
    return face


def _images_in(folder: Path) -> list[Path]:
    paths = (folder / IMAGES_FOLDER).glob("*")
    return sorted(path for path in paths if path.suffix.lower() in IMAGE_SUFFIXES)


def _keep(path: Path, original: Path) -> None:
    """Copy an image that is to be changed; the first copy stays."""
    if not original.exists():
        try:
            original.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnwritableError.of(original, error) from None
        copy_image(path, original, link=False)


def _remove_caches(scene: Scene) -> None:
    """Remove decoded images that training left: they have the faces, too."""
    shutil.rmtree(scene.folder / CACHE_FOLDER, ignore_errors=True)


@contextmanager
def _open_notes(folder: Path) -> Generator[tuple[dict[str, tuple[int, int]], TextIO], None, None]:
    """Read what is done, by image: size in bytes and faces; and open its file for more lines."""
    path = folder / ANONYMIZED_FILE
    done: dict[str, tuple[int, int]] = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True):
            name, *numbers = line.rstrip("\n").rsplit(",", 2)
            if line.endswith("\n") and len(numbers) == 2 and all(map(str.isdigit, numbers)):
                done[name] = int(numbers[0]), int(numbers[1])
    lines = [f"{name},{size},{faces}" for name, (size, faces) in done.items()]
    write_text(path, "\n".join([_HEADER, *lines]) + "\n")  # without a line that was cut off
    try:
        file = path.open("a", encoding="utf-8")
    except OSError as error:
        raise UnwritableError.of(path, error) from None
    with file:
        yield done, file


def _note(file: TextIO, folder: Path, name: str, size: int, faces: int) -> None:
    try:
        file.write(f"{name},{size},{faces}\n")
        file.flush()
    except OSError as error:
        raise UnwritableError.of(folder / ANONYMIZED_FILE, error) from None
