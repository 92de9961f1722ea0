"""Images decoded and resized once, into one memory-mapped array a recording.

Decoding JPEGs of a phone's size takes longer than a small network's training step; a decoded
image of 256 x 256 pixels is 196 kB, a page of the array, and is read at the memory's speed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FileMissingError
from vioapr.files.atomic import replacing
from vioapr.files.images import read_rgb
from vioapr.work.steps import fingerprint, is_current, mark

_VERSION = 1
"""Part of every key: raise it when the same images give other pixels than before."""


def read_image(path: Path, resize: int) -> NDArray[np.uint8]:
    """Decode an image and resize it to resize x resize pixels, whatever its shape.

    Resized as the paper's implementations do, see `images.read_rgb`.

    Returns:
        RGB, shape (resize, resize, 3).

    Raises:
        FileMissingError: It is missing.
        FormatError: It is broken.
    """
    return read_rgb(path, (resize, resize))


def read_images(paths: Sequence[Path], resize: int) -> Iterator[NDArray[np.uint8]]:
    """Decode many images as `read_image`, in order, by all cores a few images ahead."""
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
    """Return the images as a memory-mapped array, decoded now unless that was done before.

    The cache is made again if names, sizes or times of the images have changed.

    Args:
        paths: Of n images.
        resize: See `read_image`.
        file: The cache, ending in .npy.
        tick: Called after every image, for progress; n times if nothing was cached.

    Returns:
        Shape (n, resize, resize, 3), read-only.

    Raises:
        FileMissingError: An image is missing.
        FormatError: An image is broken.
        UnwritableError: The cache cannot be written.
    """
    status = []
    for path in paths:
        try:
            found = path.stat()
        except FileNotFoundError:
            raise FileMissingError(path, "expected an image, found no file of this name") from None
        status.append([path.name, found.st_size, found.st_mtime_ns])
    key, marker = fingerprint(_VERSION, resize, status), file.with_suffix(".json")
    if is_current(marker, key) and file.exists():
        for _ in paths:
            tick()
        return np.load(file, mmap_mode="r")
    marker.unlink(missing_ok=True)  # it may be of these images, and the array not
    shape = (len(paths), resize, resize, 3)
    header = {"descr": "|u1", "fortran_order": False, "shape": shape}
    # Plain writes, not a writable map: on a full disk a map ends the process.
    with replacing(file) as partial, partial.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, header)
        for image in read_images(paths, resize):
            stream.write(image.tobytes())
            tick()
    mark(marker, key)
    return np.load(file, mmap_mode="r")
