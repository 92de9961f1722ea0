"""Recording: one walk with a phone, on disk."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from vioapr.errors import FormatError
from vioapr.files.append_table import Problem
from vioapr.files.images import find_image_problem
from vioapr.scene.frames import Frames, read_frames
from vioapr.scene.info import RecordingInfo, read_info
from vioapr.scene.sensors import Gnss, Heading, Imu, read_gnss, read_heading, read_imu

INFO_FILE, FRAMES_FILE, IMAGES_FOLDER = "recording.json", "frames.csv", "images"
IMU_FILE, GNSS_FILE, HEADING_FILE = "imu.csv", "gnss.csv", "heading.csv"


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording's folder; see docs/recordings.md. Tables are read when first asked for.

    Attributes:
        folder: Where it is; its name is the recording's id.
        info: What made it.
    """

    folder: Path
    info: RecordingInfo

    @staticmethod
    def open(folder: Path) -> Recording:
        """Open a recording.

        Raises:
            FormatError: It is not there, or its `recording.json` is missing or broken.
        """
        folder = Path(folder)
        if not folder.is_dir():
            found = "a file" if folder.exists() else "none of this name"
            raise FormatError(folder, f"expected a recording's folder, found {found}")
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
        problems: list[Problem] = []
        frames = read_frames(self.folder / FRAMES_FILE, problems)
        _raise_unless_torn(problems)
        return self._without_torn_image(frames)

    @cached_property
    def imu(self) -> Imu:
        """Inertial measurements; empty if there are none.

        Raises:
            FormatError: Naming the first line that is wrong.
        """
        path = self.folder / IMU_FILE
        if not path.exists():
            return Imu(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        problems: list[Problem] = []
        imu = read_imu(path, problems)
        _raise_unless_torn(problems)
        return imu

    @cached_property
    def gnss(self) -> Gnss:
        """Satellite positions; empty if there are none. Raises as `imu`."""
        path = self.folder / GNSS_FILE
        if not path.exists():
            return Gnss(*(np.zeros(0) for _ in range(6)))
        problems: list[Problem] = []
        gnss = read_gnss(path, problems)
        _raise_unless_torn(problems)
        return gnss

    @cached_property
    def heading(self) -> Heading:
        """Compass headings; empty if there are none. Raises as `imu`."""
        path = self.folder / HEADING_FILE
        if not path.exists():
            return Heading(*(np.zeros(0) for _ in range(3)))
        problems: list[Problem] = []
        heading = read_heading(path, problems)
        _raise_unless_torn(problems)
        return heading

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

    def _without_torn_image(self, frames: Frames) -> Frames:
        """A crash tears the image written last, if any: that frame is as if never written."""
        if not len(frames) or not frames.image[-1]:
            return frames
        path = self.folder / IMAGES_FOLDER / frames.image[-1]
        is_torn = path.exists() and find_image_problem(path) is not None
        return frames.at_rows(slice(None, -1)) if is_torn else frames


def _raise_unless_torn(problems: list[Problem]) -> None:
    for problem in problems:
        if problem.is_error:
            raise problem.to_error()
