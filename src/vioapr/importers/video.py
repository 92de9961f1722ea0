"""Frames of a video file, decoded one at a time with PyAV."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, MissingExtraError


def count_video_frames(path: Path) -> int | None:
    """How many frames a video says it has; None if it does not.

    Raises:
        FormatError: It cannot be read.
        MissingExtraError: PyAV is not installed.
    """
    av, errors = _import_av()
    try:
        with av.open(str(path)) as container:
            stream = _video_stream(path, container)
            return stream.frames or None
    except (errors, OSError) as error:
        raise FormatError(path, f"cannot be read as a video: {error}") from None


def read_video(path: Path) -> Iterator[NDArray[np.uint8]]:
    """The frames in order, RGB, shape (height, width, 3), as stored: not turned upright.

    A video whose end is missing gives the frames before.

    Raises:
        FormatError: It cannot be read at all.
        MissingExtraError: PyAV is not installed.
    """
    av, errors = _import_av()
    decoded = 0
    try:
        with av.open(str(path)) as container:
            stream = _video_stream(path, container)
            stream.thread_type = "AUTO"
            for frame in container.decode(stream):
                decoded += 1
                yield np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
    except (errors, OSError) as error:
        if not decoded:
            raise FormatError(path, f"cannot be read as a video: {error}") from None


def _video_stream(path: Path, container: Any) -> Any:
    if not container.streams.video:
        raise FormatError(path, "expected a video, got a file without pictures")
    return container.streams.video[0]


def _import_av() -> tuple[Any, type[Exception]]:
    """The package, and the root of its errors."""
    try:
        import av
        from av.error import FFmpegError
    except ImportError:
        raise MissingExtraError("Decoding a video", "av", "video") from None
    return av, FFmpegError
