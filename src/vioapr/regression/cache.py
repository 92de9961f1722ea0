"""Images decoded and resized once, into one memory-mapped array a recording.

Decoding JPEGs of a phone's size takes longer than a small network's training step; a decoded
image of 256 x 256 pixels is 196 kB, a page of the array, and is read at the memory's speed.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileMissingError, FormatError
from vioapr.files.images import read_rgb

CACHE_FOLDER = ".cache"
_VERSION = 1
"""Part of every key: raise it when the same images give other pixels than before."""


def read_image(path: Path, resize: int) -> NDArray[np.uint8]:
    """An image, resized to resize x resize pixels whatever its shape, RGB.

    Resized as the paper's implementations do, see `images.read_rgb`.

    Returns:
        Shape (resize, resize, 3).

    Raises:
        FormatError: It is missing or broken.
    """
    return read_rgb(path, (resize, resize))


def read_images(paths: Sequence[Path], resize: int) -> Iterator[NDArray[np.uint8]]:
    """As `read_image`, of many, in order, decoded by all cores a few images ahead."""
    workers = os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        try:
            for start in range(0, len(paths), 16 * workers):
                block = paths[start : start + 16 * workers]
                yield from pool.map(lambda path: read_image(path, resize), block)
        finally:
            pool.shutdown(cancel_futures=True)


def cached_images(
    paths: Sequence[Path],
    resize: int,
    file: Path,
    tick: Callable[[], object] = lambda: None,
) -> NDArray[np.uint8]:
    """The images as a memory-mapped array, decoded now unless that was done before.

    The cache is made anew if names, sizes or times of the images have changed. It is written
    under another name and moved when whole.

    Args:
        paths: Of n images.
        resize: See `read_image`.
        file: The cache, ending in .npy.
        tick: Called after every image, for progress; n times if nothing was cached.

    Returns:
        Shape (n, resize, resize, 3), read-only.

    Raises:
        FormatError: An image is missing or broken, or the cache cannot be written.
    """
    key = _key(paths, resize)
    note = file.with_suffix(".json")
    if not (_read_key(note) == key and file.exists()):
        _write(paths, resize, file, tick)
        _write_note(note, key)
    else:
        for _ in paths:
            tick()
    return np.load(file, mmap_mode="r")


def _key(paths: Sequence[Path], resize: int) -> str:
    digest = hashlib.sha256(f"{_VERSION} {resize}".encode())
    for path in paths:
        try:
            status = path.stat()
        except FileNotFoundError:
            raise FileMissingError(path, "expected an image, found no file of this name") from None
        digest.update(f"{path.name} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()


def _read_key(note: Path) -> str | None:
    try:
        return json.loads(note.read_text())["key"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_note(note: Path, key: str) -> None:
    partial = note.with_name(f".{note.name}.partial")
    partial.write_text(json.dumps({"key": key}) + "\n")
    partial.replace(note)


def _write(paths: Sequence[Path], resize: int, file: Path, tick: Callable[[], object]) -> None:
    partial = file.with_name(f".{file.name}.{os.getpid()}.partial")
    header = {
        "descr": "|u1", "fortran_order": False, "shape": (len(paths), resize, resize, 3),
    }  # fmt: skip
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        # Plain writes, not a writable map: on a full disk a map ends the process.
        with partial.open("wb") as stream:
            np.lib.format.write_array_header_1_0(stream, header)
            for image in read_images(paths, resize):
                stream.write(image.tobytes())
                tick()
        partial.replace(file)
    except OSError as error:
        raise FormatError(file, f"the cache cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)
