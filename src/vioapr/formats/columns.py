"""Which columns of a table hold time, image, position and quaternion, by their names.

Names as pandas, rostopic, EuRoC, OpenVINS, RTAB-Map, Kimera, maplab and people's own loggers
write them: in any case, with units in brackets or at the end, with the parts of a message or a
frame in front (`field.pose.pose.position.x`, `p_RS_R_x [m]`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from vioapr.formats.base import TimeUnit
from vioapr.formats.matrix_names import find_matrix_columns
from vioapr.formats.tracking_states import find_tracking_column

_TIME_UNITS: dict[str, TimeUnit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanos", "nanosecond", "nanoseconds"), "ns"),
}
_METRES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), 0.01),
    **dict.fromkeys(("mm", "millimeters", "millimetres"), 0.001),
}
_TIME_WORDS = frozenset(("t", "time", "ts", "stamp", "utime", "epoch", "datetime", "date", "clock"))
_OTHER_TIMES = frozenset(
    ("exposure", "processing", "compute", "delta", "dt", "duration", "shutter")
)
_INDEX_WORDS = frozenset(
    ("index", "idx", "id", "ids", "num", "no", "nr", "seq", "frame", "count", "number", "i", "n")
)
_IMAGE_WORDS = frozenset(("image", "img", "filename", "file", "name", "path", "rgb", "picture"))
_POSITION_WORDS = ("t", "p", "pos", "position", "trans", "translation", "xyz")
_QUATERNION_WORDS = ("q", "quat", "quaternion", "orientation", "ori", "rot", "rotation", "attitude")
_NO_POSE_WORDS = frozenset(
    (
        *("v", "vel", "velocity", "speed", "linear", "angular", "twist", "omega", "rpy", "euler"),
        *("acc", "accel", "acceleration", "gyro", "gyr", "gravity", "mag", "force", "scale"),
        *("bias", "ba", "bg", "b", "cov", "covariance", "std", "sigma", "var", "variance", "err"),
        "error",
    )
)
_EULER_WORDS = frozenset(("roll", "pitch", "yaw", "heading", "euler", "rpy", "omega", "kappa"))
_GLUED = re.compile(rf"({'|'.join(_POSITION_WORDS + _QUATERNION_WORDS)})([xyzw0-9])")


@dataclass(frozen=True)
class Layout:
    """The columns of a table that make a pose.

    Attributes:
        position: Columns of x, y and z; none where a matrix holds them.
        quat_xyzw: Columns of the quaternion; none where there is a matrix.
        matrix: Columns of a 4x4 or 3x4 matrix by rows, or of its rotation alone (9); none where
            there is a quaternion.
        time: Column of the time, or None.
        time_unit: Its unit, where the name says it.
        nanoseconds: Column of the time's fraction in nanoseconds, where it has its own.
        images: Columns that may hold image names.
        tracking: Column of the tracker's state, or None.
        metres: One unit of the positions in metres.
        passed_over: Names of columns that are not used, indices left out.
        rivals: Sentences about positions and rotations that could have been taken instead.
        time_rival: Such a sentence about times: usually one is of the writing, or None.
    """

    position: tuple[int, ...]
    quat_xyzw: tuple[int, ...]
    matrix: tuple[int, ...]
    time: int | None
    time_unit: TimeUnit | None
    nanoseconds: int | None
    images: tuple[int, ...]
    tracking: int | None
    metres: float
    passed_over: tuple[str, ...]
    rivals: tuple[str, ...]
    time_rival: str | None

    @property
    def entries(self) -> tuple[int, ...]:
        """Columns of the whole matrix, 3x4 or 4x4 by rows; none where there is a quaternion."""
        if len(self.matrix) != 9:
            return self.matrix
        rows = (self.matrix[:3], self.matrix[3:6], self.matrix[6:])
        return tuple(i for row, last in zip(rows, self.position, strict=True) for i in (*row, last))

    @property
    def pose(self) -> tuple[int, ...]:
        """Position and quaternion, or the whole matrix."""
        return self.entries or (*self.position, *self.quat_xyzw)

    def is_in_order(self, quat_order: str) -> bool:
        """Whether columns are time, x, y, z and the quaternion in order "xyzw" or "wxyz"."""
        quat = (4, 5, 6, 7) if quat_order == "xyzw" else (5, 6, 7, 4)
        return (self.time, self.position, self.quat_xyzw) == (0, (1, 2, 3), quat)


class _Column(NamedTuple):
    """A column's name in lower-case words, and the unit that it ends with, if it does."""

    words: tuple[str, ...]
    unit: str | None


def _column_of(name: str) -> _Column:
    text = re.sub(r"\[(\d)\]", r"_\1", name.strip().strip("\"'").lstrip("#% "))
    brackets = re.findall(r"[\[(]([^\])]*)[\])]", text)
    text = re.sub(r"[\[(][^\])]*[\])]", " ", text)
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", text)
    words = [word for word in re.split(r"[^a-z0-9]+", text.lower()) if word]
    unit = brackets[0].strip().lower() if brackets and brackets[0].strip() else None
    if unit is None and len(words) > 1 and (words[-1] in _TIME_UNITS or words[-1] in _METRES):
        unit = words.pop()
    return _Column(tuple(words), unit)


def _component_of(words: tuple[str, ...]) -> tuple[str, tuple[str, ...], str] | None:
    """The kind ("position" or "quaternion"), group and component that a name means."""
    if not words or _NO_POSE_WORDS & set(words):
        return None
    *group, last = words
    if glued := _GLUED.fullmatch(last):
        group, last = [*group, glued[1]], glued[2]
    elif len(last) == 2 and last[1] in "xyzw" and group and group[0] in ("p", "q"):
        group, last = [*group, last[0]], last[1]  # maplab's p_G_Ix
    elif len(last) == 2 and last[0] == "r" and last[1] in "xyzw":
        group, last = [*group, "r"], last[1]
    if last not in ("x", "y", "z", "w", "0", "1", "2", "3", "4"):
        return None
    is_r = bool(group) and group[-1] == "r" and not set(group) & set(_POSITION_WORDS)
    if set(group) & set(_QUATERNION_WORDS) or (is_r and last in "xyzw"):
        return "quaternion", tuple(group), last
    is_position = last in ("x", "y", "z") or bool(group and group[-1] in _POSITION_WORDS)
    return ("position", tuple(group), last) if is_position and last != "w" else None


def find_layout(names: Sequence[str]) -> Layout | None:
    """Find the columns of poses among named ones; None if they have no complete pose.

    Args:
        names: One a column; "" for a column without a name, as of a pandas index.
    """
    columns = [_column_of(name) for name in names]
    positions = _groups(columns, "position", ("xyz", "012"))
    quats = _groups(columns, "quaternion", ("xyzw", "1230"))
    matrix = () if quats else find_matrix_columns(names) or ()
    if len(matrix) == 9:
        positions = positions or _groups(columns, "position", ("123",))
    elif matrix:
        positions = []  # any other is of something else
    if not (quats or matrix) or not (positions or len(matrix) > 9):
        return None
    position_words, position = positions[0] if positions else ((), ())
    quat: tuple[int, ...] = ()
    if quats:
        quat = max(quats, key=lambda group: _common_length(group[0], position_words))[1]
    times = _times(columns)
    time = times[0] if times else None
    nanoseconds = next((i for i in times[1:] if _is_fraction(columns, time, i)), None)
    images = tuple(i for i, (words, _) in enumerate(columns) if words and words[-1] in _IMAGE_WORDS)
    tracking = find_tracking_column([words for words, _ in columns])
    used = {*position, *quat, *matrix, *images, time, nanoseconds, tracking}
    others = [i for i in range(len(names)) if i not in used and not _is_index(columns[i].words)]
    rivals: list[str] = []
    for what, groups, taken in (("position", positions, position), ("rotation", quats, quat)):
        if len(groups) > 1:
            rivals.append(_rival(names, what, taken, [group for _, group in groups]))
    time_rival = None
    if time is not None and len(set(times) - {time, nanoseconds}):
        rest = [(i,) for i in times if i != nanoseconds]
        time_rival = _rival(names, "time", (time,), rest)
    unit = columns[time].unit if time is not None else None
    return Layout(
        position=position,
        quat_xyzw=quat,
        matrix=matrix,
        time=time,
        time_unit=_TIME_UNITS.get(unit or ""),
        nanoseconds=nanoseconds,
        images=images,
        tracking=tracking,
        metres=_METRES.get((columns[position[0]].unit if position else None) or "m", 1.0),
        passed_over=tuple(names[i] for i in others),
        rivals=tuple(rivals),
        time_rival=time_rival,
    )


def names_euler_angles(names: Sequence[str]) -> bool:
    """Whether columns hold a position, and its rotation as angles rather than a quaternion."""
    columns = [_column_of(name) for name in names]
    is_angle = [bool(set(words) & _EULER_WORDS) for words, _ in columns]
    return bool(_groups(columns, "position", ("xyz", "012"))) and sum(is_angle) >= 2


def names_degrees(names: Sequence[str]) -> bool:
    """Whether columns hold latitudes and longitudes."""
    words = {word for name in names for word in _column_of(name).words}
    return bool(words & {"lat", "latitude"}) and bool(words & {"lon", "lng", "long", "longitude"})


def _groups(
    columns: list[_Column], kind: str, orders: Sequence[str]
) -> list[tuple[tuple[str, ...], tuple[int, ...]]]:
    """Complete sets of components of one kind, in order of their first columns."""
    groups: dict[tuple[str, ...], dict[str, int]] = {}
    for i, (words, _) in enumerate(columns):
        if (found := _component_of(words)) and found[0] == kind:
            groups.setdefault(found[1], {}).setdefault(found[2], i)
    return [
        (words, tuple(members[letter] for letter in order))
        for words, members in groups.items()
        for order in orders
        if set(members) == set(order)
    ]


def _common_length(left: tuple[str, ...], right: tuple[str, ...]) -> int:
    return next(
        (i for i, (a, b) in enumerate(zip(left, right, strict=False)) if a != b),
        min(len(left), len(right)),
    )


def _times(columns: list[_Column]) -> list[int]:
    """Columns of times, the likeliest first: a message's stamp before the time of its writing."""
    found: list[tuple[int, int]] = []
    for i, (words, _) in enumerate(columns):
        if set(words) & _OTHER_TIMES:
            continue
        if any("stamp" in word for word in words):
            found.append((0, i))
        elif words and (words[-1] in _TIME_WORDS or set(words) & {"time", "utime", "datetime"}):
            found.append((1, i))
        elif len(words) == 1 and words[0] in _TIME_UNITS and words[0] != "s":
            found.append((2, i))
    return [i for _, i in sorted(found)]


def _is_fraction(columns: list[_Column], time: int | None, other: int) -> bool:
    """Whether two columns are ROS's `secs` and `nsecs`."""
    if time is None:
        return False
    (words, unit), (other_words, other_unit) = columns[time], columns[other]
    names = unit or words[-1], other_unit or other_words[-1]
    is_same = words == other_words or len(words) == len(other_words) == 1
    return is_same and [_TIME_UNITS.get(name) for name in names] == ["s", "ns"]


def _is_index(words: tuple[str, ...]) -> bool:
    return not words or words[-1] in _INDEX_WORDS or words[0] == "unnamed"


def _rival(
    names: Sequence[str], what: str, taken: Sequence[int], groups: Sequence[Sequence[int]]
) -> str:
    def listed(group: Sequence[int]) -> str:
        return ", ".join(names[i] for i in group)

    rest = "; ".join(listed(group) for group in groups if tuple(group) != tuple(taken))
    return f"the {what} was taken from {listed(taken)}, and not from {rest}"
