"""A calibration as a file, and as parameters of method `chain`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import tomlkit

from vioapr.errors import ParameterError
from vioapr.files.paths import AnyPath
from vioapr.files.text import read_text, write_text
from vioapr.fusion.chain.params import ChainParams
from vioapr.schemas.base import decode_toml, to_plain
from vioapr.schemas.calibration import Calibration, ChainSetting, PairCalibration

_DIGITS = 5
_HEAD = (
    "What walks with ground truth say of a tracker and a regressor; made by vioapr calibrate.",
    "fuse, evaluate, localize and export take it as --calibration.",
)


def read_calibration(path: AnyPath) -> Calibration:
    """Read `calibration.toml`.

    Raises:
        FileMissingError: There is no such file.
        UnreadableError: It cannot be read.
        FormatError: It is no calibration; the message names the line or the member.
        VersionError: It is of a later version.
    """
    path = Path(path)
    return decode_toml(path, read_text(path), Calibration)


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write `calibration.toml`, numbers with five digits.

    Raises:
        UnwritableError: It cannot be written.
    """
    document = tomlkit.document()
    for line in _HEAD:
        document.add(tomlkit.comment(line))
    document["format"], document["version"] = Calibration.FORMAT, Calibration.VERSION
    members: dict[str, Any] = _rounded(to_plain(calibration))
    for key, value in members.items():
        document[key] = value
    write_text(path, tomlkit.dumps(document))


def _rounded(value: Any) -> Any:
    """Plain values with numbers of a few digits, and without members that are None."""
    if isinstance(value, dict):
        members = cast("dict[str, Any]", value)
        return {key: _rounded(item) for key, item in members.items() if item is not None}
    if isinstance(value, list):
        return [_rounded(item) for item in cast("list[Any]", value)]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def find_pair(
    calibration: Calibration, tracker: str | None = None, regressor: str | None = None
) -> PairCalibration:
    """The pair that a calibration holds for a tracker and a regressor.

    Args:
        calibration: To search.
        tracker: Its name, or None where nobody knows.
        regressor: Its name, or None where nobody knows.

    Returns:
        The only pair, whatever its names; of several, the one that has the given ones.

    Raises:
        ParameterError: There are several, and not just one has these names.
    """
    pairs = calibration.pairs
    if len(pairs) == 1:
        return pairs[0]
    found = [
        pair
        for pair in pairs
        if tracker in (None, pair.tracker) and regressor in (None, pair.regressor)
    ]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{pair.tracker} with {pair.regressor}" for pair in pairs)
    wanted = f"{tracker or 'any tracker'} with {regressor or 'any regressor'}"
    raise ParameterError(
        f"calibration: it holds {known}, and {'none' if not found else 'several'} for {wanted}: "
        "calibrate with that tracker's and that regressor's files alone"
    )


def params_from_calibration(
    setting: ChainSetting, params: ChainParams | None = None, keep: Collection[str] = ()
) -> ChainParams:
    """Parameters of method `chain` with what was calibrated.

    Args:
        setting: Of a `PairCalibration`.
        params: Others to go with it; None for the defaults.
        keep: Names of parameters that stay as `params` has them.

    Example:
        >>> pair = find_pair(read_calibration("calibration.toml"))
        >>> localizer = Localizer("chain", params_from_calibration(pair.setting))
    """
    values = {name: value for name, value in to_plain(setting).items() if name not in keep}
    return replace(params or ChainParams(), **values)
