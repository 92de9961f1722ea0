"""Rows of a file that give no pose: which they are, and how a user is told.

Trackers write rows of NaN or zeros until they start, loggers write a row twice, and published
labels hold positions of 3e9 m. Such rows are left out, counted and named. A file of mostly such
rows is rather misread, and two runs in one file are no trajectory: those are errors.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import CUT_OFF, RowProblem, Rows
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import LeftOutRow
from vioapr.plurals import count_of

NO_POSE = "no pose"
"""The summary of rows without numbers."""

NOT_TRACKED = "not tracked"
"""The summary of rows that say that the tracker was lost."""

_NOTHING = (NO_POSE, NOT_TRACKED)

_MAX_LISTED = 3
_MAX_BACKWARD_RUN = 5
_FAR_SPREADS, _FAR_M, _FAR_SHARE, _FAR_LEAST_ROWS = 1000.0, 10_000.0, 0.01, 10


def find_sound_rows(
    rows: Rows,
    timestamp_s: NDArray[np.float64],
    position_m: NDArray[np.float64],
    options: ReadOptions,
    names: Sequence[str] | None,
    *,
    is_timed: bool,
) -> list[int]:
    """Find the rows that give a pose, and say which do not.

    Args:
        rows: Where each pose came from, and what its reader found wrong with some.
        timestamp_s: Shape (n,), s.
        position_m: Shape (n, 3), m; NaN in rows with a problem.
        options: Whether to be strict, and where notes go.
        names: Image names.
        is_timed: Whether the timestamps are seconds of a clock.

    Returns:
        Indices of the sound rows, in order.

    Raises:
        FormatError: No row gives a pose, or as many are malformed as are sound; times run
            backwards for many rows; or `strict`, and one row gives no pose.
    """
    problems: dict[int, RowProblem] = {
        row: rows.problems[line] for row, line in enumerate(rows.lines) if line in rows.problems
    }
    for row in np.flatnonzero(~np.isfinite(timestamp_s)).tolist():
        text = "expected a finite timestamp, got NaN or inf"
        problems.setdefault(row, RowProblem(text, "no time"))
    sound = [row for row in range(len(rows)) if row not in problems]
    malformed = [row for row in sorted(problems) if problems[row].summary not in _NOTHING]
    if not sound or len(malformed) >= len(sound):
        _raise(rows, problems, malformed[0] if malformed else min(problems), names)
    problems |= _far_from_all_others(position_m, sound)
    sound = [row for row in sound if row not in problems]
    late = _out_of_order(timestamp_s, sound)
    if late:
        _raise_if_misordered(rows, late, len(sound))
        problems |= late
    _report_cut_off(rows, options)
    if problems:
        if options.strict:
            _raise(rows, problems, min(problems, key=lambda row: rows.lines[row]), names)
        _report(rows, problems, timestamp_s if is_timed else None, names, options)
    return [row for row in sound if row not in problems]


def _raise(
    rows: Rows, problems: dict[int, RowProblem], row: int, names: Sequence[str] | None
) -> None:
    name = f" ({names[row]})" if names is not None else ""
    raise FormatError(rows.path, problems[row].error + name, rows.lines[row])


def _far_from_all_others(
    position_m: NDArray[np.float64], sound: list[int]
) -> dict[int, RowProblem]:
    """Positions that are absurd beside the others, where only a few are."""
    if len(sound) < _FAR_LEAST_ROWS:
        return {}
    distances_m = np.abs(position_m[sound] - np.median(position_m[sound], axis=0)).max(axis=1)
    limit_m = max(_FAR_M, _FAR_SPREADS * float(np.quantile(distances_m, 0.9)))
    found = np.flatnonzero(distances_m > limit_m)
    if len(found) > max(1, _FAR_SHARE * len(sound)):
        return {}
    return {
        sound[i]: RowProblem(
            f"expected a position near the others, got one {distance_text(distances_m[i])} away",
            f"position is {distance_text(distances_m[i])} away",
        )
        for i in found.tolist()
    }


def distance_text(distance_m: float) -> str:
    """A large distance in few characters: 3.1e9 m."""
    return f"{distance_m:.2g} m".replace("e+0", "e").replace("e+", "e")


def _out_of_order(timestamp_s: NDArray[np.float64], sound: list[int]) -> dict[int, RowProblem]:
    """The fewest rows without which times increase; of equal ones, the later rows."""
    times: list[float] = timestamp_s[sound].tolist()
    dropped: list[int] = []
    latest: list[float] = []  # before each dropped row
    latest_s = -np.inf
    for i, time_s in enumerate(times):
        if time_s > latest_s:
            latest_s = time_s
        else:
            dropped.append(i)
            latest.append(latest_s)
    if len(dropped) > 1 and len(fewest := _outside_longest_increase(times)) < len(dropped):
        dropped, latest = fewest, [times[max(i - 1, 0)] for i in fewest]
    problems: dict[int, RowProblem] = {}
    for i, before in zip(dropped, latest, strict=True):
        is_same = times[i] == before
        relation = "a duplicate of" if is_same else "earlier than"
        relation = relation if times[i] <= before else "later than"
        problems[sound[i]] = RowProblem(
            f"expected increasing timestamps, got {times[i]:.6f} s, {relation} the one before "
            f"({before:.6f} s)",
            f"timestamp {times[i]:.6f} s is {relation} "
            + ("one before" if times[i] <= before else "those after")
            + f" ({before:.6f} s)",
        )
    return problems


def _outside_longest_increase(times: list[float]) -> list[int]:
    """Indices outside a longest strictly increasing subsequence (patience sorting)."""
    tails: list[float] = []
    tail_rows: list[int] = []
    before = [-1] * len(times)
    for i, time_s in enumerate(times):
        pile = bisect.bisect_left(tails, time_s)
        if pile < len(tails) and tails[pile] == time_s:
            continue  # the first of equal times stays
        before[i] = tail_rows[pile - 1] if pile else -1
        tails[pile : pile + 1] = [time_s]
        tail_rows[pile : pile + 1] = [i]
    kept: set[int] = set()
    row = tail_rows[-1]
    while row >= 0:
        kept.add(row)
        row = before[row]
    return [i for i in range(len(times)) if i not in kept]


def _raise_if_misordered(rows: Rows, late: dict[int, RowProblem], count: int) -> None:
    """Refuse times that run backwards for many rows, as of two runs in one file."""
    length, previous = 0, -2
    first = min(late)
    for row in sorted(late):
        if "duplicate" in late[row].summary:
            continue
        length = length + 1 if row == previous + 1 else 1
        previous = row
        if length > _MAX_BACKWARD_RUN:
            first = row - length + 1
            break
    if length > _MAX_BACKWARD_RUN or 2 * len(late) > count:
        what = f"{late[first].error}: {len(late)} of {count} rows are out of order: two runs?"
        raise FormatError(rows.path, what, rows.lines[first])


def _report_cut_off(rows: Rows, options: ReadOptions) -> None:
    """Say that the last row was cut off: it is none of the rows, so it has no pose at all."""
    for line, problem in rows.problems.items():
        if problem.summary == CUT_OFF:
            if options.strict:
                raise FormatError(rows.path, problem.error, line)
            options.leave_out([LeftOutRow(rows.path, line, problem.error)])
            text = f"the file ends in the middle of line {line}: left out"
            options.note(rows.path, text, is_warning=True, lines=[line])


def _report(
    rows: Rows,
    problems: dict[int, RowProblem],
    timestamp_s: NDArray[np.float64] | None,
    names: Sequence[str] | None,
    options: ReadOptions,
) -> None:
    ordered = sorted(problems, key=lambda row: rows.lines[row])
    options.leave_out(
        [
            LeftOutRow(
                path=rows.path,
                line=rows.lines[row],
                problem=problems[row].error,
                name=None if names is None else names[row],
                timestamp_s=None
                if timestamp_s is None or not np.isfinite(timestamp_s[row])
                else float(timestamp_s[row]),
            )
            for row in ordered
        ]
    )
    kinds = {
        "pose": [row for row in ordered if problems[row].summary == NO_POSE],
        "state": [row for row in ordered if problems[row].summary == NOT_TRACKED],
        "time": [row for row in ordered if problems[row].summary.startswith("timestamp")],
    }
    named = {row for members in kinds.values() for row in members}
    kinds[""] = [row for row in ordered if row not in named]
    for kind, members in kinds.items():
        if members:
            lines = [rows.lines[row] for row in members]
            text = _sentence(rows, problems, kind, members, names)
            options.note(rows.path, text, is_warning=True, lines=lines)


def _sentence(
    rows: Rows,
    problems: dict[int, RowProblem],
    kind: str,
    members: list[int],
    names: Sequence[str] | None,
) -> str:
    count, has = count_of(len(members), "row"), "have" if len(members) > 1 else "has"
    if kind == "pose":
        where = lines_text(rows.lines[row] for row in members)
        return f"{count} {has} no pose ({where}): left out"
    if kind == "state":
        where = lines_text(rows.lines[row] for row in members)
        return f"{count} {'are' if len(members) > 1 else 'is'} not tracked ({where}): left out"
    image = [f" ({names[row]})" if names is not None else "" for row in members]
    if not kind and len(members) == 1:
        row = members[0]
        place = f"{rows.path.name}:{rows.lines[row]}"
        return f"{place}: {problems[row].summary}, left out{image[0]}"
    listed = [
        f"line {rows.lines[row]}: {problems[row].summary}{name}"
        for row, name in zip(members[:_MAX_LISTED], image, strict=False)
    ]
    rest = len(members) - len(listed)
    more = f"; and {rest} more" if rest else ""
    title = f"time: {count} out of order" if kind == "time" else f"{count} {has} no sound pose"
    return f"{title}, left out: {'; '.join(listed)}{more}"


def lines_text(lines: Iterable[int]) -> str:
    """Line numbers in few words: "lines 1 to 20", "line 7", "lines 3, 9 to 12 and 5 more"."""
    ranges: list[list[int]] = []
    for line in sorted(lines):
        if ranges and line == ranges[-1][1] + 1:
            ranges[-1][1] = line
        else:
            ranges.append([line, line])
    shown = [f"{a}" if a == b else f"{a} to {b}" for a, b in ranges[:_MAX_LISTED]]
    rest = sum(b - a + 1 for a, b in ranges[_MAX_LISTED:])
    is_one = len(ranges) == 1 and ranges[0][0] == ranges[0][1]
    more = f" and {rest} more" if rest else ""
    return ("line " if is_one else "lines ") + ", ".join(shown) + more
