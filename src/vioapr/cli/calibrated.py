"""The flag `--calibration` of the verbs that fuse."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vioapr.cli.console import is_given, warn
from vioapr.cli.parameters import parameters_of
from vioapr.errors import ParameterError, SuspectTrackError
from vioapr.evaluation.calibration.calibrate import group_by_pair
from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import Result
from vioapr.evaluation.tables import Evaluation, Group, tabulate
from vioapr.fusion.calibrated import find_pair, params_from_calibration
from vioapr.fusion.calibration_fit import explain_misfit
from vioapr.fusion.chain.method import METHOD as CHAIN
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.offline import View
from vioapr.fusion.types import FrameInput
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.walks import APR_PREFIX, VIO_PREFIX
from vioapr.schemas.calibration import Calibration, PairCalibration
from vioapr.work.progress import Tick


def require_chain(methods: list[str]) -> None:
    """See that the method that a calibration is for is among those to run.

    Raises:
        ParameterError: It is not.
    """
    if CHAIN.name not in methods:
        raise ParameterError(
            f"calibration: expected method {CHAIN.name}, which it is for, got {', '.join(methods)}"
        )


def name_of(path: Path, prefix: str) -> str | None:
    """The tracker's or regressor's name in that of a walk's file, without the draw's number.

    Args:
        path: E.g. `vio_arkit.tum` or `apr_posenet.csv.gz`.
        prefix: `VIO_PREFIX` or `APR_PREFIX`.
    """
    stem = path.name.split(".")[0]
    if not stem.startswith(prefix):
        return None
    name = stem.removeprefix(prefix)
    return re.sub(r"(?<=[^\d])\d+$", "", name) if prefix == VIO_PREFIX else name


def pair_of_files(
    calibration: Calibration, apr: Path, vio: Path, *, strict: bool
) -> PairCalibration:
    """The pair for a walk's files, by their names; see `pick_pair`."""
    names = name_of(vio, VIO_PREFIX), name_of(apr, APR_PREFIX)
    return pick_pair(calibration, *names, strict=strict)


def pick_pair(
    calibration: Calibration, tracker: str | None, regressor: str | None, *, strict: bool = False
) -> PairCalibration:
    """The pair for a tracker and a regressor; warns where the only one is of others.

    Args:
        calibration: What was found.
        tracker: Its name, or None.
        regressor: Its name, or None.
        strict: Whether to refuse it instead.

    Raises:
        ParameterError: There are several, and not just one is for them.
        SuspectTrackError: The only one is of others, with `strict`.
    """
    pair = find_pair(calibration, tracker, regressor)
    for kind, used, own in (
        ("tracker", tracker, pair.tracker),
        ("regressor", regressor, pair.regressor),
    ):
        if used not in (None, own):
            _object(
                f"the calibration is of {kind} {own!r} and used with {used!r}: calibrate with "
                "walks of that one",
                strict=strict,
            )
    return pair


def _object(text: str, *, strict: bool) -> None:
    """Warn, or refuse."""
    if strict:
        raise SuspectTrackError(f"{text}; or go on without `strict`")
    warn(text)


def calibrated_params(pair: PairCalibration, params: Any) -> ChainParams:
    """Parameters of method `chain`: flags win over the calibration, which wins over defaults.

    Args:
        pair: Of the calibration.
        params: As the flags say.
    """
    flags = [one for one in parameters_of(ChainParams) if any(map(is_given, one.flags))]
    given = [one.name for one in flags]
    return params_from_calibration(pair.setting, cast("ChainParams", params), given)


def warn_of_misfit(
    pair: PairCalibration,
    inputs: FrameInput,
    world_from_cam: Rigid3,
    status: NDArray[np.integer],
    *,
    strict: bool,
) -> None:
    """Warn where predictions and answers disagree as they did on no walk of the calibration.

    Raises:
        SuspectTrackError: They do, with `strict`.
    """
    if (text := explain_misfit(pair, inputs, world_from_cam, status)) is not None:
        _object(f"the calibration does not fit: {text}", strict=strict)


def tabulate_calibrated(
    cases: Sequence[Case],
    params_of_method: Mapping[str, Any],
    calibration: Calibration,
    *,
    view: View,
    offline: bool,
    tick: Tick,
    strict: bool,
) -> Evaluation:
    """Fuse every case with every method, method `chain` as calibrated for its pair.

    Args:
        cases: See `evaluation.tables.tabulate`.
        params_of_method: The same; method `chain` is among them.
        calibration: Cases of a tracker and a regressor that it does not hold are evaluated without,
            with a warning.
        view: The same.
        offline: The same.
        tick: The same.
        strict: Whether to refuse what is otherwise warned of.

    Raises:
        ParameterError: The calibration does not hold a pair, with `strict`.
        SuspectTrackError: It does not fit, with `strict`.
    """
    order = list(dict.fromkeys(case.group for case in cases))
    results: list[Result] = []
    groups: list[Group] = []
    for (tracker, regressor), of_pair in group_by_pair(cases).items():
        params, pair = dict(params_of_method), None
        try:
            pair = pick_pair(calibration, tracker, regressor, strict=strict)
            params[CHAIN.name] = calibrated_params(pair, params[CHAIN.name])
        except ParameterError as error:
            if strict:
                raise
            warn(f"not calibrated: {error}")
        done = tabulate(of_pair, params, view=view, offline=offline, tick=tick)
        results += done.results
        groups += done.groups
        if pair is not None:
            _warn_of_misfits(pair, done.results, strict=strict)
    groups.sort(key=lambda group: order.index((group.set_name, group.vio, group.apr)))
    return Evaluation(results, groups)


def _warn_of_misfits(pair: PairCalibration, results: Sequence[Result], *, strict: bool) -> None:
    """One warning for all walks of a tracker and a regressor."""
    found: dict[str, str] = {}
    own = [result for result in results if result.method == CHAIN.name]
    for result in own:
        inputs = result.case.frames.inputs.at(result.case.has_gt)
        text = explain_misfit(pair, inputs, result.world_from_cam, result.status)
        if text is not None:
            found[result.case.title] = text
    if found:
        title, text = next(iter(found.items()))
        _object(
            f"the calibration does not fit {len(found)} of {len(own)} walks, e.g. {title}: {text}",
            strict=strict,
        )
