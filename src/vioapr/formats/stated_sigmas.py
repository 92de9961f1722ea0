"""Standard deviations that a regressor states of its errors: a table beside its predictions.

`apr_<name>.sigma.csv` beside `apr_<name>.tum`, with the header
`timestamp_s,sigma_position_m,sigma_orientation_deg`: standard deviations per axis. nan says that
nothing is known, as do predictions without a row.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.files.tables import read_headed_csv
from vioapr.files.text import write_text
from vioapr.trajectory import Trajectory, nearest_rows

COLUMNS = ("timestamp_s", "sigma_position_m", "sigma_orientation_deg")
SUFFIX = ".sigma.csv"

_SAME_TIME_S = 1e-3
"""Times of a row and its prediction may differ by this, by rounding in text."""


class Sigmas(NamedTuple):
    """Of the n poses of a trajectory, NaN where nothing is stated.

    Attributes:
        position_m: Standard deviation per axis, shape (n,), m.
        orientation_deg: Shape (n,), degrees.
    """

    position_m: NDArray[np.float64]
    orientation_deg: NDArray[np.float64]


def path_beside(trajectory: Path) -> Path | None:
    """Find the table that accompanies a file of predictions, if there is one."""
    stem = trajectory.name.removesuffix(".gz").rsplit(".", 1)[0]
    tables = (trajectory.with_name(stem + SUFFIX + end) for end in ("", ".gz"))
    return next((path for path in tables if path.is_file()), None)


def read_sigmas(path: Path, predictions: Trajectory) -> Sigmas:
    """Read a table and bring it into the order of the predictions.

    Args:
        path: The table.
        predictions: The trajectory that it accompanies.

    Raises:
        FormatError: Another header, a negative or infinite sigma, a time without a prediction
            or twice, or predictions without a clock.
    """
    rows = read_headed_csv(path, COLUMNS)
    if not predictions.is_timed:
        raise FormatError(path, "expected predictions with timestamps, got names only")
    values = rows.numbers(slice(0, 3))
    timestamp_s, sigmas = values[:, 0], values[:, 1:]
    wrong = (sigmas < 0) | np.isinf(sigmas)
    if wrong.any():
        row, column = divmod(int(np.argmax(wrong)), 2)
        got = f"expected a {COLUMNS[1 + column]} of at least 0, or nan, got {sigmas[row, column]}"
        raise FormatError(path, got, rows.lines[row])
    if not np.isfinite(timestamp_s).all():
        row = int(np.argmin(np.isfinite(timestamp_s)))
        problem = f"expected a finite timestamp_s, got {timestamp_s[row]}"
        raise FormatError(path, problem, rows.lines[row])
    nearest = nearest_rows(timestamp_s, predictions.timestamp_s)
    is_stray = np.abs(predictions.timestamp_s[nearest] - timestamp_s) > _SAME_TIME_S
    if is_stray.any():
        row = int(np.argmax(is_stray))
        problem = f"expected the time of a prediction, got {timestamp_s[row]:.6f} s"
        nearest_is = f"the nearest one is at {predictions.timestamp_s[nearest[row]]:.6f} s"
        raise FormatError(path, f"{problem}: {nearest_is}", rows.lines[row])
    first = np.unique(nearest, return_index=True)[1]
    again = np.setdiff1d(np.arange(len(nearest)), first)
    if len(again):
        row = int(again[0])
        problem = f"expected one row a prediction, got {timestamp_s[row]:.6f} s again"
        raise FormatError(path, problem, rows.lines[row])
    ordered = np.full((2, len(predictions)), np.nan)
    ordered[:, nearest] = sigmas.T
    return Sigmas(*ordered)


def read_sigmas_beside(path: Path, predictions: Trajectory) -> Sigmas | None:
    """Read the table that accompanies a file of predictions, if there is one; see `read_sigmas`."""
    table = path_beside(path)
    return None if table is None else read_sigmas(table, predictions)


def write_sigmas_beside(path: Path, predictions: Trajectory, sigmas: Sigmas) -> None:
    """Write the table that accompanies a file of predictions.

    Raises:
        UnwritableError: It cannot be written.
    """
    columns = zip(predictions.timestamp_s, *sigmas, strict=True)
    rows = [f"{time_s:.6f},{m:.6g},{deg:.6g}" for time_s, m, deg in columns]
    write_text(path.with_suffix(SUFFIX), "\n".join([",".join(COLUMNS), *rows]) + "\n")
