"""Formats that give a pose for each image name: order, sequences, and times from names."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import Rows, all_numbers, format_rows, head_rows, parse_rows
from vioapr.files.text import natural_key, read_text, write_text
from vioapr.formats.base import ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

_WXYZ = (3, 0, 1, 2)


@dataclass(frozen=True)
class NamedText:
    """A text format of `name position quaternion` or `name quaternion position` rows.

    Attributes:
        convert: From the file's convention to ours and back, of `vioapr.formats.conventions`.
        is_quat_first: Whether the quaternion (always wxyz) comes before the position.
        extra: Names of further columns.
        required_extra: How many of them every row must have.
        header: Lines before the rows, to write; as many are passed over when reading.
        target: Name of the target frame.
    """

    convert: Callable[[Rigid3], Rigid3]
    is_quat_first: bool = False
    extra: tuple[str, ...] = ()
    required_extra: int = 0
    header: tuple[str, ...] = ()
    target: str = "world"

    @property
    def what(self) -> str:
        """The columns, for messages and help."""
        columns = "name qw qx qy qz tx ty tz" if self.is_quat_first else "name x y z qw qx qy qz"
        return " ".join((columns, *self.extra))

    def read(self, path: Path, options: ReadOptions) -> Trajectory:
        """Read world_from_cam poses in the natural order of their names.

        Raises:
            FileError: It cannot be read or is malformed, naming file and line.
            ParameterError: The options do not fit the file's sequences.
        """
        widths = range(8 + self.required_extra, 9 + len(self.extra))
        text = read_text(path)
        if self.header and all_numbers([text.split("\n")[0].split()[1:]], range(7, 8)):
            problem = f"expected {len(self.header)} header lines, got a row of {self.what}"
            raise FormatError(path, problem, 1)
        rows = parse_rows(path, text, widths, what=self.what, skip=len(self.header))
        values = rows.numbers(slice(1, 8))
        if self.is_quat_first:
            values = values[:, [4, 5, 6, 0, 1, 2, 3]]
        poses = poses_of(rows, values[:, :3], values[:, [4, 5, 6, 3]])
        return build_named(rows, rows.column(0), self.convert(poses), options, target=self.target)

    def write(self, path: Path, trajectory: Trajectory) -> None:
        """Write all digits; columns that a trajectory does not know are 0.

        Raises:
            ParameterError: A name that the format cannot hold.
            UnwritableError: The file cannot be written.
        """
        names = writable_names(trajectory)
        columns = pose_columns(self.convert(trajectory.target_from_source), _WXYZ)
        zeros = [0] * len(self.extra) if self.required_extra else []
        rows = [
            (name, *(row[3:] + row[:3] if self.is_quat_first else row), *zeros)
            for name, row in zip(names, columns, strict=True)
        ]
        header = "".join(f"{line}\n" for line in self.header)
        write_text(path, header + format_rows(rows, " "))

    def fits(self, head: bytes) -> bool:
        """Whether a file's first rows have these columns, the quaternion in its place."""
        rows = head_rows(head)
        widths = range(7 + self.required_extra, 8 + len(self.extra))
        if not all_numbers([row[1:] for row in rows], widths) or any(
            is_all_digits(row[0]) for row in rows
        ):
            return False
        values = np.array([row[1:8] for row in rows], dtype=np.float64)
        return bool(is_unit(values[:, :4] if self.is_quat_first else values[:, 3:]).all())


def is_all_digits(name: str) -> bool:
    """Whether a name is rather a number, so that the row has no name."""
    return re.fullmatch(r"[-+.\deE]+", name) is not None


def is_unit(quats: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which rows are unit quaternions, within the tolerance of text files."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.abs(np.sqrt((quats**2).sum(axis=1)) - 1) <= UNIT_TOLERANCE


def build_named(
    rows: Rows,
    names: Sequence[str],
    world_from_cam: Rigid3,
    options: ReadOptions,
    *,
    target: str = "world",
) -> Trajectory:
    """Build a trajectory in the natural order of image names, timed where a rate is given.

    Args:
        rows: Where each pose came from.
        names: An image name for each row.
        world_from_cam: A pose for each row.
        options: Rate and sequence.
        target: Name of the target frame.

    Raises:
        FormatError: Duplicate or broken names, or no frame number in one, naming the line.
        ParameterError: No such sequence, or a rate for several sequences at once.
    """
    seen: dict[str, int] = {}
    for name, line in zip(names, rows.lines, strict=True):
        if any("\ud800" <= letter <= "\udfff" for letter in name):
            raise FormatError(rows.path, f"expected an image name in UTF-8, got {name!r}", line)
        if name in seen:
            problem = f"expected each image once, got {name!r} again (first in line {seen[name]})"
            raise FormatError(rows.path, problem, line)
        seen[name] = line
    kept = rows_of_sequence(rows.path, names, options)
    kept.sort(key=lambda row: natural_key(names[row]))
    rows, names = rows.at(kept), [names[row] for row in kept]
    times = np.arange(len(kept), dtype=np.float64)
    if options.rate_hz is not None:
        for row, (name, line) in enumerate(zip(names, rows.lines, strict=True)):
            # The last digits of the file name, its ending left out.
            digits = re.findall(r"[0-9]+", PurePosixPath(name).stem)
            if not digits or len(digits[-1]) > 15:
                problem = f"expected a frame number in the image name {name!r}, to make its time of"
                raise FormatError(rows.path, problem, line)
            times[row] = int(digits[-1]) / options.rate_hz
    return build_trajectory(
        rows,
        times,
        world_from_cam.at(kept),
        options,
        names=names,
        is_timed=options.rate_hz is not None,
        target=target,
    )


def rows_of_sequence(path: Path, names: Sequence[str], options: ReadOptions) -> list[int]:
    """Find the rows of the sequence that the options ask for: of all images, if of none.

    Args:
        path: For messages.
        names: An image name for each row; a sequence is the folder part.
        options: Rate and sequence.

    Raises:
        ParameterError: No such sequence, or a rate for several sequences at once.
    """
    folders = [str(PurePosixPath(name).parent) for name in names]
    available = sorted(set(folders), key=natural_key)
    listed = ", ".join(available[:20]) + (", ..." if len(available) > 20 else "")
    if options.sequence is None:
        if options.rate_hz is not None and len(available) > 1:
            raise ParameterError(
                f"{path} holds several sequences, whose times would overlap: "
                f"choose one with `sequence`: {listed}"
            )
        return list(range(len(names)))
    wanted = options.sequence.strip("/")
    kept = [i for i, folder in enumerate(folders) if f"/{folder}".endswith(f"/{wanted}")]
    if not kept:
        raise ParameterError(f"{path} holds no sequence {wanted!r}: expected one of {listed}")
    return kept


def writable_names(trajectory: Trajectory, separator: str = " ", suffix: str = ".png") -> list[str]:
    """List a trajectory's image names, or frame-000000.png and so on where it has none.

    Args:
        trajectory: The poses.
        separator: What ends a name in the file: "" (nothing does), "," or " " (white space).
        suffix: Ending of names that are made up.

    Raises:
        ParameterError: A name that could not be read back.
    """
    if trajectory.names is None:
        return [f"frame-{row:06d}{suffix}" for row in range(len(trajectory))]
    for name in trajectory.names:
        broken = re.search(r"\s" if separator == " " else r"[\r\n\0,]", name) if separator else None
        if broken or name != name.strip() or not name or name.startswith("#"):
            raise ParameterError(f"the format cannot hold the image name {name!r}")
    if len(set(trajectory.names)) < len(trajectory):
        raise ParameterError("the format needs different image names, and some are the same")
    return list(trajectory.names)
