import json
import re

import pytest

from vioapr.fusion.calibrated import read_calibration, write_calibration
from vioapr.scene.walks import write_walk
from vioapr.schemas.calibration import Calibration
from vioapr.simulation.walks import WalkParams, simulate_walk


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walks") / "Place"
    for seed in (1, 2):
        walk = simulate_walk(WalkParams(duration_s=30), seed=seed)
        write_walk(
            folder / f"walk-{seed}", gt=walk.gt, vios={"phone": walk.vio}, aprs={"net": walk.apr}
        )
    return folder


@pytest.fixture(scope="module")
def calibration(walks, tmp_path_factory):
    """Made once, in a process of its own kind: as a user would."""
    from vioapr.cli import main

    path = tmp_path_factory.mktemp("calibration") / "calibration.toml"
    assert main(["calibrate", str(walks), "--out", str(path)]) == 0
    return path


@pytest.fixture
def files(walks):
    return "--apr", walks / "walk-1" / "apr_net.tum", "--vio", walks / "walk-1" / "vio_phone.tum"


def with_pair(path, target, **changes):
    import msgspec

    (pair,) = read_calibration(path).pairs
    write_calibration(target, Calibration(pairs=(msgspec.structs.replace(pair, **changes),)))
    return target


def test_it_says_what_it_was_made_from_and_how_it_does(run, walks, tmp_path):
    out = tmp_path / "c.toml"
    code, text, err = run("calibrate", walks, "--out", out)
    assert code == 0, err
    assert re.search(r"phone with net: 2 walks, \d+ m, 1\.0 min, 120 frames", text)
    assert "map and tracker share up" in text
    assert re.search(r"phone +net +2 +\d\.\d\d \d\.\d\d \d\.\d\d \d\.\d\d", text)
    assert "19 / 54 / 74 are promised" in " ".join(text.split())
    (pair,) = read_calibration(out).pairs
    assert pair.made_from.walks == ("Place/walk-1", "Place/walk-2")
    assert pair.left_out.walks == 2


def test_one_walk_says_that_more_are_better(run, walks, tmp_path):
    out = tmp_path / "c.toml"
    code, text, err = run("calibrate", walks / "walk-1", "--out", out, "--format", "json")
    assert code == 0, err
    assert "made from one walk" in " ".join(err.split())
    assert "give 2 or more" in " ".join(err.split())
    record = json.loads(text)
    assert record["format"] == "vioapr calibration"
    assert record["pairs"][0]["left_out"] is None


def test_what_cannot_be_calibrated(fails, walks, tmp_path, calibration):
    out = ("--out", tmp_path / "c.toml")
    assert "expected walks" in fails("calibrate", tmp_path, *out)
    assert "--trackers: expected names from phone, got arkit" in fails(
        "calibrate", walks, *out, "--trackers", "arkit"
    )
    assert "--regressors: expected names from net, got x" in fails(
        "calibrate", walks, *out, "--regressors", "x"
    )
    assert "expected one scene, as --model predicts its images" in fails(
        "calibrate", walks, *out, "--model", tmp_path / "m.safetensors"
    )
    assert "exists" in fails("calibrate", walks, "--out", calibration)
    assert not (tmp_path / "c.toml").exists()


def test_fuse_takes_it_and_flags_win(run, fails, files, calibration, tmp_path):
    def fuse(name, *flags):
        out = tmp_path / f"{name}.csv"
        code, _, err = run("fuse", *files, "--method", "chain", "--out", out, *flags)
        assert code == 0, err
        return out.read_text(), err

    setting = read_calibration(calibration).pairs[0].setting
    plain, _ = fuse("plain")
    own, err = fuse("own", "--calibration", calibration)
    assert "WARNING" not in err
    assert own != plain
    flags = {
        "gravity": setting.gravity,
        "tilt-drift": setting.tilt_drift_rad2_per_m,
        "heading-drift": setting.heading_drift_rad2_per_m,
        "position-drift": setting.position_drift_m2_per_m,
        "scale-error": setting.scale_error,
        "sigma-position-factor": setting.sigma_position_factor,
        "sigma-orientation-factor": setting.sigma_orientation_factor,
    }
    words = [f"--{name}={value}" for name, value in flags.items()]
    assert fuse("flags", *words)[0] == own
    # Flags win, also with the values that they have by default.
    drifts = ("--tilt-drift=-1", "--heading-drift=-1", "--position-drift=-1")
    defaults = ("--gravity", "auto", *drifts, "--scale-error", "0.01")
    factors = ("--sigma-position-factor", "1", "--sigma-orientation-factor", "1")
    assert fuse("again", "--calibration", calibration, *defaults, *factors)[0] == plain
    line = fails("fuse", *files, "--method", "vio-apr", "--out", tmp_path / "x.csv",
                 "--calibration", calibration)  # fmt: skip
    assert line == "--calibration: expected method chain, which it is for, got vio-apr"


def test_a_misfit_and_other_names_are_told(run, fails, files, calibration, tmp_path):
    from vioapr.schemas.calibration import Disagreement

    other = with_pair(
        calibration, tmp_path / "other.toml",
        tracker="arkit", disagreement=Disagreement(0.01, 0.05, 1.2),
    )  # fmt: skip
    out = tmp_path / "f.csv"
    fuse = ("fuse", *files, "--method", "chain", "--out", out, "--calibration", other)
    code, _, err = run(*fuse)
    assert code == 0
    told = " ".join(err.split())
    assert "the calibration is of tracker 'arkit' and used with 'phone'" in told
    assert "the calibration does not fit: predictions lie" in told
    line = fails(*fuse, "--strict", "--overwrite")
    assert "tracker 'arkit' and used with 'phone'" in line
    assert line.endswith("or go on without --strict")
    own = with_pair(calibration, tmp_path / "own.toml", disagreement=Disagreement(0.01, 0.05, 1.2))
    assert "the calibration does not fit: predictions lie" in fails(
        *fuse[:-1], own, "--strict", "--overwrite"
    )


def test_evaluate_takes_it(run, fails, walks, calibration, tmp_path):
    evaluate = ("evaluate", walks, "--methods", "apr,chain", "--format", "json")
    code, plain, err = run(*evaluate)
    assert code == 0, err
    code, text, err = run(*evaluate, "--calibration", calibration)
    assert code == 0, err
    assert "WARNING" not in err
    rows, others = (
        {row["method"]: row["fused"] for row in json.loads(one)[0]["rows"]} for one in (text, plain)
    )
    assert rows["apr"] == others["apr"]
    assert rows["chain"] != others["chain"]
    assert "--calibration: expected method chain" in fails(
        "evaluate", walks, "--methods", "apr,vio", "--calibration", calibration
    )
    strange = with_pair(calibration, tmp_path / "strange.toml", regressor="dfnet")
    code, _, err = run(*evaluate, "--calibration", strange)
    assert code == 0
    told = "the calibration is of regressor 'dfnet' and used with 'net'"
    assert told in " ".join(err.split())
    assert told in fails(*evaluate, "--calibration", strange, "--strict")


def test_a_wrong_file_is_refused_before_the_work(fails, files, walks, tmp_path):
    (tmp_path / "c.toml").write_text("version = 1")
    out = tmp_path / "f.csv"
    line = fails("fuse", *files, "--method", "chain", "--out", out,
                 "--calibration", tmp_path / "c.toml")  # fmt: skip
    assert "c.toml: expected" in line
    assert not out.exists()
