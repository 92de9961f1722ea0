"""Recording: one walk with a phone, on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.append_table import Problem
from vioapr.files.images import probe_image
from vioapr.files.paths import AnyPath
from vioapr.files.text import read_text, require_folder, write_text
from vioapr.scene.frames import Frames, read_frames
from vioapr.scene.sensors import Gnss, Heading, Imu, read_gnss, read_heading, read_imu
from vioapr.schemas.base import decode, encode
from vioapr.schemas.recording import RecordingInfo

INFO_FILE, FRAMES_FILE, IMAGES_FOLDER = "recording.json", "frames.csv", "images"
IMU_FILE, GNSS_FILE, HEADING_FILE = "imu.csv", "gnss.csv", "heading.csv"


_Table = TypeVar("_Table")


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording's folder; see docs/reference/scene.md. Tables are read when first asked for.

    Attributes:
        folder: Where it is; its name is the recording's id.
        info: What made it.
    """

    folder: Path
    info: RecordingInfo

    @staticmethod
    def open(folder: AnyPath) -> Recording:
        """Open a recording.

        Raises:
            FileMissingError: It is not there, or its `recording.json` is not.
            FormatError: It is no folder, or its `recording.json` is broken.
        """
        folder = Path(folder)
        require_folder(folder, "a recording's folder")
        return Recording(folder, read_info(folder / INFO_FILE))

    @property
    def id(self) -> str:
        """The folder's name."""
        return self.folder.name

    @cached_property
    def frames(self) -> Frames:
        """All frames; one whose writing was interrupted at the end is left out.

        Raises:
            FormatError: Naming the first line that is wrong.
        """
        frames = self._read(FRAMES_FILE, read_frames)
        # A crash tears the image written last, if any: that frame is as if never written.
        if len(frames) and frames.image[-1]:
            path = self.folder / IMAGES_FOLDER / frames.image[-1]
            if path.exists() and probe_image(path).problem:
                return frames.at_rows(slice(None, -1))
        return frames

    @cached_property
    def imu(self) -> Imu:
        """Inertial measurements; empty if there are none.

        Raises:
            FormatError: Naming the first line that is wrong.
        """
        if not (self.folder / IMU_FILE).exists():
            return Imu(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        return self._read(IMU_FILE, read_imu)

    @cached_property
    def gnss(self) -> Gnss:
        """Satellite positions; empty if there are none. Raises as `imu`."""
        if not (self.folder / GNSS_FILE).exists():
            return Gnss(*(np.zeros(0) for _ in range(6)))
        return self._read(GNSS_FILE, read_gnss)

    @cached_property
    def heading(self) -> Heading:
        """Compass headings; empty if there are none. Raises as `imu`."""
        if not (self.folder / HEADING_FILE).exists():
            return Heading(*(np.zeros(0) for _ in range(3)))
        return self._read(HEADING_FILE, read_heading)

    def image_path(self, row: int) -> Path:
        """The image of a frame.

        Raises:
            FormatError: The frame has none.
        """
        name = self.frames.image[row]
        if not name:
            line = int(self.frames.lines[row])
            raise FormatError(self.folder / FRAMES_FILE, "this frame has no image", line)
        return self.folder / IMAGES_FOLDER / name

    def _read(self, name: str, read: Callable[[Path, list[Problem]], _Table]) -> _Table:
        """A table, but for a last line that is cut off."""
        problems: list[Problem] = []
        table = read(self.folder / name, problems)
        for problem in problems:
            if problem.is_error:
                raise problem.to_error()
        return table


def read_info(path: Path) -> RecordingInfo:
    """Read `recording.json`; members that it lacks have their defaults.

    Raises:
        FileError: It cannot be read.
        FormatError: Not such a file, of other conventions, or a member of another type.
        VersionError: It is of a later version.
    """
    return decode(path, read_text(path), RecordingInfo)


def write_info(path: Path, info: RecordingInfo) -> None:
    """Write `recording.json`.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    write_text(path, encode(info))
