"""Formats that give a pose for each image name: order, sequences, and times from names."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from vioapr.errors import FormatError, ParameterError
from vioapr.files.tables import (
    CUT_OFF,
    RowProblem,
    Rows,
    format_rows,
    is_missing,
    is_number,
)
from vioapr.files.text import natural_key, read_text, write_text
from vioapr.formats.base import ReadOptions
from vioapr.formats.poses import build_trajectory, pose_columns, poses_of
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE, Trajectory

_WXYZ = (3, 0, 1, 2)
_SNIFFED_ROWS, _SNIFFED_BYTES = 20, 16384


@dataclass(frozen=True)
class NamedText:
    """A text format of `name position quaternion` or `name quaternion position` rows.

    Attributes:
        convert: From the file's convention to ours and back, of `vioapr.formats.conventions`.
        is_quat_first: Whether the quaternion (always wxyz) comes before the position.
        extra: Names of further columns.
        required_extra: How many of them every row must have.
        header: Lines before the rows, to write; up to as many that are no rows are passed over
            when reading.
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
        rows = self._rows(path, read_text(path))
        values = rows.numbers(slice(1, 8))
        if self.is_quat_first:
            values = values[:, [4, 5, 6, 0, 1, 2, 3]]
        poses = poses_of(rows, values[:, :3], values[:, [4, 5, 6, 3]])
        return build_named(rows, rows.column(0), self.convert(poses), options, target=self.target)

    def _rows(self, path: Path, text: str) -> Rows:
        """Rows of a name, which may have spaces, and numbers; header lines are passed over."""
        rows = Rows(path, [], [])
        lines = text.splitlines()
        for number, line in enumerate(lines, start=1):
            stripped = line.strip()
            if not stripped or stripped.startswith("#"):
                continue
            fields = self._fields(stripped)
            if fields is not None:
                rows.fields.append(fields)
                rows.lines.append(number)
                continue
            words = stripped.split()
            if not len(rows) and number <= len(self.header) and sum(map(is_number, words)) < 3:
                continue
            wanted = len(self.what.split()) - len(self.extra) + self.required_extra
            if len(words) >= wanted:
                bad = next((w for w in words[1 : 8 + self.required_extra] if not is_number(w)), "")
                raise FormatError(path, f"expected a number, got {bad[:40]!r}", number)
            problem = f"expected {wanted} columns ({self.what}), got {len(words)}"
            if number < len(lines) or text.endswith("\n") or not len(rows):
                raise FormatError(path, problem, number)
            rows.problems[number] = RowProblem(problem, CUT_OFF)
        if not len(rows):
            raise FormatError(path, f"expected rows of {self.what}, got none: the file is empty")
        return rows

    def _fields(self, line: str) -> list[str] | None:
        """The name and the numbers of a row; None if it is none.

        A name may have spaces, and may end in a number: then the quaternion tells where it ends.
        """
        words = line.split()
        least, most = 7 + self.required_extra, 7 + len(self.extra)
        found: list[str] | None = None
        for count in range(min(most, len(words) - 1), least - 1, -1):
            numbers = words[len(words) - count :]
            if not all(is_number(word) or is_missing(word) for word in numbers):
                continue
            fields = [line.rsplit(maxsplit=count)[0], *numbers]
            name_words = words[: len(words) - count]
            is_sound = self._has_unit_quaternion(fields) or _is_nothing(numbers)
            if len(name_words) == 1:
                if is_sound or count == least:
                    return fields
                found = fields  # its quaternion is wrong, unless the name ends in a number
            elif is_sound and not all(map(is_number, name_words)):
                return fields
        return found

    def _has_unit_quaternion(self, fields: list[str]) -> bool:
        quat = fields[1:5] if self.is_quat_first else fields[4:8]
        if any(map(is_missing, quat)):
            return False
        return abs(math.hypot(*map(float, quat)) - 1) <= UNIT_TOLERANCE

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
        """Whether a file's first rows have these columns, the quaternion in its place.

        Rows without a pose, of NaN or zeros, do not count.
        """
        if b"\0" in head:
            return False
        lines = head[:_SNIFFED_BYTES].decode("utf-8", "replace").removeprefix("\ufeff").splitlines()
        lines = lines[:-1] if len(head) > _SNIFFED_BYTES else lines
        lines = [line.strip() for line in lines]
        rows = [line for line in lines if line and not line.startswith("#")]
        while self.header and rows and sum(map(is_number, rows[0].split())) < 3:
            rows = rows[1:]
        count = 0
        for line in rows[:_SNIFFED_ROWS]:
            fields = self._fields(line)
            if fields is None or is_all_digits(fields[0]):
                return False
            is_nothing = _is_nothing(fields[1:8])
            if not is_nothing and not self._has_unit_quaternion(fields):
                return False
            count += not is_nothing
        return count > 0


def _is_nothing(numbers: Sequence[str]) -> bool:
    """Whether a row's numbers are all missing or 0, as of a lost frame."""
    return all(is_missing(number) or float(number) == 0 for number in numbers)


def is_all_digits(name: str) -> bool:
    """Whether a name is rather a number, so that the row has no name."""
    return re.fullmatch(r"[-+.\deE]+", name) is not None


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
    for row, (name, line) in enumerate(zip(names, rows.lines, strict=True)):
        if any("\ud800" <= letter <= "\udfff" for letter in name):
            raise FormatError(rows.path, f"expected an image name in UTF-8, got {name!r}", line)
        first = seen.setdefault(name, row)
        if first == row:
            continue
        first_line = rows.lines[first]
        problem = f"expected each image once, got {name!r} again (first in line {first_line})"
        if not rows.fields[row] or rows.fields[row][1:] != rows.fields[first][1:]:
            raise FormatError(rows.path, problem, line)
        rows.problems[line] = RowProblem(problem, f"repeats line {first_line}")
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
            is_repeated = row and times[row] == times[row - 1]
            if is_repeated and names[row] != names[row - 1]:
                problem = f"the number of {name!r} is a duplicate of that of {names[row - 1]!r}"
                raise FormatError(rows.path, problem, line)
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
