"""A calibration as a file, and as parameters."""

import dataclasses

import msgspec
import numpy as np
import pytest
from tests.calibrations import SETTING, pair_of
from tests.helpers import frames_of

from vioapr.errors import FileMissingError, FormatError, ParameterError, VersionError
from vioapr.fusion.calibrated import (
    find_pair,
    params_from_calibration,
    read_calibration,
    write_calibration,
)
from vioapr.fusion.calibration_fit import explain_misfit
from vioapr.fusion.chain.method import METHOD
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.offline import run_steps
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.calibration import Calibration, ChainSetting, Disagreement
from vioapr.simulation.walks import WalkParams, simulate_walk


def test_a_file_gives_back_what_was_written(tmp_path):
    calibration = Calibration(
        made_by="vioapr 1", date="2026-01-31", pairs=(pair_of(), pair_of("arcore", left_out=None))
    )
    path = tmp_path / "calibration.toml"
    write_calibration(path, calibration)
    assert read_calibration(path) == calibration
    assert path.read_text().startswith("# What walks")


def test_numbers_have_five_digits(tmp_path):
    odd = msgspec.structs.replace(SETTING, scale_error=0.0123456789)
    path = tmp_path / "calibration.toml"
    write_calibration(path, Calibration(pairs=(pair_of(setting=odd),)))
    assert read_calibration(path).pairs[0].setting.scale_error == 0.012346


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ("version = 1", "version = 2", VersionError, "expected version 1, got 2"),
        ("vioapr calibration", "vioapr map", FormatError, "'vioapr map'"),
        ('gravity = "known"', 'gravity = "up"', FormatError, r"pairs\[0\]\.setting\.gravity"),
        ("scale_error = 0.02", "scale_error = -1.0", FormatError, "setting.scale_error"),
        ("scale_error = 0.02", "scale_error = nan", FormatError, "setting.scale_error"),
        ("tilt_drift_rad2_per_m = 1e-06", "", FormatError, "'tilt_drift_rad2_per_m'"),
        ("position_factor = 0.5", "position_factor = 0", FormatError, "sigma_position_factor"),
        ("[[pairs]]", "[[pairs", FormatError, ":8: expected TOML"),
        ("[[pairs]]", "[[others]]", FormatError, "pairs"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path, old, new, error, message):
    path = tmp_path / "calibration.toml"
    write_calibration(path, Calibration(pairs=(pair_of(),)))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(error, match=message):
        read_calibration(path)


def test_what_is_no_calibration_is_refused(tmp_path):
    with pytest.raises(FileMissingError):
        read_calibration(tmp_path / "none.toml")
    (tmp_path / "scene.toml").write_text('version = 1\nname = "Place"\nis_outdoor = true\n')
    with pytest.raises(FormatError, match="vioapr calibration"):
        read_calibration(tmp_path / "scene.toml")
    with pytest.raises(FormatError, match="directory"):
        read_calibration(tmp_path)


def test_pairs_are_found_by_names():
    one = Calibration(pairs=(pair_of(),))
    assert find_pair(one, "other", "net") is one.pairs[0]
    three = Calibration(pairs=(pair_of(), pair_of("arcore", "posenet"), pair_of("arcore", "dfnet")))
    assert find_pair(three, "arcore", "dfnet") is three.pairs[2]
    assert find_pair(three, None, "dfnet") is three.pairs[2]
    assert find_pair(three, "arkit") is three.pairs[0]
    with pytest.raises(ParameterError, match="several for any tracker with posenet"):
        find_pair(three, None, "posenet")
    with pytest.raises(ParameterError, match="arkit with posenet, arcore.*none for vins with any"):
        find_pair(three, "vins")


def test_parameters_are_the_calibrations_but_for_what_is_kept():
    params = params_from_calibration(SETTING)
    for name, value in msgspec.structs.asdict(SETTING).items():
        assert getattr(params, name) == value
    own = ChainParams(window=40, gravity="estimate", scale_error=0.3)
    kept = params_from_calibration(SETTING, own, keep=["gravity"])
    assert (kept.window, kept.gravity, kept.scale_error) == (40, "estimate", 0.02)
    assert Localizer("chain", params) is not None


def test_every_setting_is_a_parameter_of_the_method():
    names = {field.name for field in dataclasses.fields(ChainParams)}
    assert set(ChainSetting.__struct_fields__) <= names


def test_a_calibration_of_another_tracker_or_regressor_is_noticed():
    walk = simulate_walk(WalkParams(duration_s=60.0), seed=3)
    frames = frames_of(walk)
    found = run_steps(METHOD, ChainParams(), frames)
    answers = found.world_from_cam, np.asarray(found.status)
    fits = pair_of(disagreement=Disagreement(1.0, 3.0, 1.5))
    assert explain_misfit(fits, frames, *answers) is None
    better = pair_of(disagreement=Disagreement(0.1, 3.0, 1.5))
    text = explain_misfit(better, frames, *answers)
    assert "0.1 m and 3 deg on the calibration's walks" in text
    assert "Calibrate with walks of this one" in text
    some = frames.at(slice(0, 5))
    few = Rigid3(*(part[:5] for part in answers[0])), answers[1][:5]
    assert explain_misfit(better, some, *few) is None
