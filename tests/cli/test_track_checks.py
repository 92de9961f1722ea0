"""Wrong files are named with a remedy by the verbs that would take them, and refused if strict."""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.formats import conventions, tum
from vioapr.formats.registry import read_trajectory
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.walks import write_walk
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.walks import WalkParams, simulate_walk

BODY_FROM_CAM = Rigid3(
    np.array([0.05, -0.02, 0.01]),
    quaternion.normalize(np.array([0.02, -0.01, 0.7, 0.714])),
)
QUICK = ("--method", "vio")

FAULTS = {
    "opengl": (conventions.world_from_arcam, "OpenGL camera axes", "--reading opengl"),
    "inverted": (conventions.cam_from_world, "poses inverted", "--reading inverted"),
    "wxyz": (
        lambda poses: poses._replace(quat_xyzw=poses.quat_xyzw[:, [3, 0, 1, 2]]),
        "quaternion in the other order (wxyz read as xyzw)",
        "--reading wxyz",
    ),
    "mirrored": (
        lambda poses: poses._replace(translation_m=poses.translation_m * [1, 1, -1]),
        "positions mirrored in z",
        "--reading mirror-z",
    ),
    "centimetres": (
        lambda poses: poses._replace(translation_m=poses.translation_m * 100),
        "(centimetres?)",
        "--scale 0.01",
    ),
    "half": (
        lambda poses: poses._replace(translation_m=poses.translation_m / 2),
        "lengths are 0.",
        "--scale 2",
    ),
}


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=120, rate_hz=5), seed=4)


@pytest.fixture
def write(tmp_path):
    def call(name, trajectory):
        tum.write(tmp_path / name, trajectory)
        return tmp_path / name

    return call


def position_errors_m(path, gt):
    """Of every frame; those without an answer, as of a device that is not understood, are inf."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    positions = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    errors_m = np.linalg.norm(positions - gt.position_m, axis=1)
    return np.where(np.isnan(errors_m), np.inf, errors_m)


@pytest.mark.slow
def test_right_files_give_no_warning(walk, write, run, tmp_path):
    apr, vio = write("apr.tum", walk.apr), write("vio.tum", walk.vio)
    code, _, err = run(
        "fuse", *QUICK, "--apr", apr, "--vio", vio, "--out", tmp_path / "o.csv", "--strict"
    )
    assert (code, err) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_fuse_names_the_fault_and_convert_mends_it(name, walk, write, run, tmp_path):
    change, sentence, remedy = FAULTS[name]
    apr = write("apr.tum", walk.apr)
    vio = write("vio.tum", walk.vio.with_transforms(change(walk.vio.target_from_source)))
    out = tmp_path / "fused.csv"
    code, _, err = run("fuse", *QUICK, "--apr", apr, "--vio", vio, "--out", out)
    assert code == 0
    (warning,) = err.splitlines()
    assert warning.startswith("WARNING vio.tum")
    assert sentence in warning
    assert remedy in warning
    # The remedy is a command: run as it stands, it makes a file that fits.
    command = warning.split("`")[1].split()
    assert command[:2] == ["vioapr", "convert"]
    fixed = tmp_path / "fixed.tum"
    code, _, err = run(*command[1:3], fixed, *command[4:])
    assert (code, err) == (0, "")
    code, _, err = run(
        "fuse", *QUICK, "--apr", apr, "--vio", fixed, "--out", tmp_path / "right.csv", "--strict"
    )
    assert (code, err) == (0, "")


def test_strict_refuses_and_writes_nothing(walk, write, fails, tmp_path):
    apr = write("apr.tum", walk.apr)
    turned = conventions.world_from_arcam(walk.vio.target_from_source)
    vio = write("vio.tum", walk.vio.with_transforms(turned))
    out = tmp_path / "fused.csv"
    error = fails("fuse", "--apr", apr, "--vio", vio, "--out", out, "--strict")
    assert "vio.tum fits apr.tum as OpenGL camera axes" in error
    assert not out.exists()


@pytest.mark.slow
def test_swapped_files(walk, write, run, tmp_path):
    apr, vio = write("apr.tum", walk.apr), write("vio.tum", walk.vio)
    code, _, err = run("fuse", "--apr", vio, "--vio", apr, "--out", tmp_path / "o.csv")
    assert code == 0
    assert err == (
        "WARNING apr.tum jumps about as predictions do, and vio.tum moves smoothly as a tracker's "
        "poses do: exchange --apr and --vio\n"
    )


@pytest.mark.slow
def test_the_same_file_twice(walk, write, run, tmp_path):
    apr, copy = write("apr.tum", walk.apr), write("copy.tum", walk.apr)
    for other in (apr, copy):
        code, _, err = run(
            "fuse", *QUICK, "--apr", apr, "--vio", other, "--out", tmp_path / f"{other.name}.csv"
        )
        assert code == 0
        assert f"apr.tum and {other.name} hold the same poses" in err


@pytest.mark.slow
@pytest.mark.parametrize("shift_s", [-7.0, 3.4])
def test_a_clock_offset_with_partial_overlap(shift_s, write, run, tmp_path):
    walk = simulate_walk(WalkParams(duration_s=180, rate_hz=5), seed=8)
    apr = write("apr.tum", walk.apr)
    late = replace(walk.vio, timestamp_s=walk.vio.timestamp_s + shift_s)
    vio = write("vio.tum", late)
    code, _, err = run("fuse", *QUICK, "--apr", apr, "--vio", vio, "--out", tmp_path / "o.csv")
    assert code == 0
    (warning,) = err.splitlines()
    direction = "ahead of" if shift_s > 0 else "behind"
    assert f"vio.tum: the clock is {abs(shift_s):.3g} s {direction} that of apr.tum" in warning
    assert f"--shift-s={-shift_s:.3f}`" in warning
    command = warning.split("`")[1].split()
    fixed = tmp_path / "fixed.tum"
    assert run(*command[1:3], fixed, *command[4:])[0] == 0
    np.testing.assert_allclose(read_trajectory(fixed).timestamp_s, walk.vio.timestamp_s, atol=1e-3)


@pytest.mark.slow
def test_milliseconds_of_a_clock_that_starts_at_zero(walk, write, run, tmp_path):
    apr, path = write("apr.tum", walk.apr), tmp_path / "vio.tum"
    rows = np.column_stack([walk.vio.timestamp_s * 1000, walk.vio.position_m, walk.vio.quat_xyzw])
    np.savetxt(path, rows, fmt="%.6f")
    out = tmp_path / "o.csv"
    code, text, err = run("fuse", *QUICK, "--apr", apr, "--vio", path, "--out", out)
    assert code == 0
    assert "times are taken for milliseconds" in err
    assert "600 frames" in text
    code, _, err = run("convert", path, tmp_path / "fixed.tum", "--time-unit", "ms")
    assert code == 0
    fixed = read_trajectory(tmp_path / "fixed.tum")
    np.testing.assert_allclose(fixed.timestamp_s, walk.vio.timestamp_s, atol=1e-6)


@pytest.mark.slow
def test_a_vio_of_the_imus_body(write, run, tmp_path):
    errors = RegressorErrors(0.3, 1.0, 0.1, 0.4, 0.02)
    walk = simulate_walk(WalkParams(duration_s=120, rate_hz=5, regressor=errors), seed=4)
    apr = write("apr.tum", walk.apr)
    body = walk.vio.target_from_source @ BODY_FROM_CAM.inverse()
    vio = write("vio.tum", walk.vio.with_transforms(body))
    wrong, auto, given = (tmp_path / f"{name}.csv" for name in ("wrong", "auto", "given"))
    code, _, err = run("fuse", "--apr", apr, "--vio", vio, "--out", wrong)
    assert code == 0
    assert re.search(r"vio\.tum holds poses of a device turned by (8|9)\d\.\d deg about", err)
    assert "give --vio-from-cam, as auto or a file" in err
    flag = "--vio-from-cam"
    code, out, err = run("fuse", "--apr", apr, "--vio", vio, "--out", auto, flag, "auto")
    assert (code, err) == (0, "")
    assert "vio.tum: body_from_cam " in out
    assert "deg about" in out
    calibration = tmp_path / "body_from_cam.txt"
    np.savetxt(calibration, BODY_FROM_CAM.to_matrix())
    code, out, err = run("fuse", "--apr", apr, "--vio", vio, "--out", given, flag, calibration)
    assert (code, err) == (0, "")
    arm = ", ".join(f"{each:.3f}" for each in BODY_FROM_CAM.translation_m)
    assert re.search(rf"body_from_cam \d+\.\d deg about \(.*\); lever arm \({arm}\) m", out)
    medians = [float(np.median(position_errors_m(p, walk.gt))) for p in (wrong, auto, given)]
    assert medians[1] < 0.7 * medians[0]
    assert medians[1] < 1.35 * medians[2]


@pytest.mark.slow
def test_vio_from_cam_leaves_a_camera_as_it_is(walk, write, run, tmp_path):
    apr, vio = write("apr.tum", walk.apr), write("vio.tum", walk.vio)
    code, out, _ = run(
        "fuse",
        *QUICK,
        "--apr",
        apr,
        "--vio",
        vio,
        "--out",
        tmp_path / "o.csv",
        "--vio-from-cam",
        "auto",
    )
    assert code == 0
    assert "vio.tum: the poses are the camera's already" in out


@pytest.mark.slow
def test_case_02(run, tmp_path):
    folder = case_folder("02-fuse-wrong-convention")
    for name, words in (
        ("vio", ""),
        ("vio_opengl", "vio_opengl.tum fits apr.tum as OpenGL camera axes"),
        ("vio_wxyz", "vio_wxyz.tum fits apr.tum as quaternion in the other order"),
    ):
        vio, out = folder / f"{name}.tum", tmp_path / f"{name}.csv"
        code, _, err = run("fuse", "--apr", folder / "apr.tum", "--vio", vio, "--out", out)
        assert code == 0
        assert words in err
        assert len(err.splitlines()) == bool(words)


@pytest.mark.slow
def test_case_03(run, tmp_path):
    folder = case_folder("03-vio-of-the-imu-body")
    files = "--apr", folder / "apr.tum", "--vio", folder / "vio_body.csv"
    gt = read_trajectory(folder / "gt.tum")
    code, _, err = run("fuse", *files, "--out", tmp_path / "wrong.csv")
    assert code == 0
    assert "vio_body.csv holds poses of a device turned by 89.1 deg" in err
    assert "--vio-from-cam" in err
    auto = tmp_path / "auto.csv"
    code, _, err = run("fuse", *files, "--out", auto, "--vio-from-cam", "auto")
    assert (code, err) == (0, "")
    assert np.median(position_errors_m(tmp_path / "wrong.csv", gt)) > 0.3
    assert np.median(position_errors_m(auto, gt)) < 0.15


def test_case_17(run):
    folder = case_folder("17-mirrored-positions-misdiagnosed")
    code, out, _ = run("inspect", folder / "vio_mirror.tum")
    assert code == 0
    (warning,) = (line for line in out.splitlines() if line.startswith("WARNING"))
    mirrored, order = "positions mirrored in z", "quaternion in the other order"
    assert warning.index(mirrored) < warning.index(order)
    assert "--against" in warning
    _, out, _ = run("inspect", folder / "vio_mirror.tum", "--against", folder / "other.tum")
    (warning,) = (line for line in out.splitlines() if line.startswith("WARNING"))
    assert mirrored in warning
    assert order not in warning
    assert "--reading mirror-z" in warning


def write_walk_folder(tmp_path, walk, vio):
    folder = tmp_path / "Set" / "walk"
    write_walk(folder, gt=walk.gt, vios={"phone": vio}, aprs={"net": walk.apr})
    return folder


@pytest.mark.slow
def test_evaluate_names_the_walk_and_the_file(walk, run, fails, tmp_path):
    turned = conventions.world_from_arcam(walk.vio.target_from_source)
    folder = write_walk_folder(tmp_path, walk, walk.vio.with_transforms(turned))
    code, _, err = run("evaluate", folder, "--methods", "vio")
    assert code == 0
    (warning,) = err.splitlines()
    assert warning.startswith("WARNING Set/walk: vio_phone.tum fits gt.tum as OpenGL camera axes")
    assert f"vioapr convert {folder / 'vio_phone.tum'} fixed.tum --reading opengl" in warning
    error = fails(
        "evaluate", folder, "--methods", "vio", "--strict", "--csv", tmp_path / "frames.csv"
    )
    assert "Set/walk: vio_phone.tum fits gt.tum as OpenGL camera axes" in error
    assert not (tmp_path / "frames.csv").exists()


@pytest.mark.slow
def test_evaluate_is_silent_on_right_files(walk, run, tmp_path):
    folder = write_walk_folder(tmp_path, walk, walk.vio)
    code, _, err = run("evaluate", folder, "--methods", "vio", "--strict")
    assert (code, err) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("given", ["auto", "file"])
def test_evaluate_turns_a_body_to_the_camera(given, walk, run, tmp_path):
    body = walk.vio.target_from_source @ BODY_FROM_CAM.inverse()
    folder = write_walk_folder(tmp_path, walk, walk.vio.with_transforms(body))
    code, _, err = run("evaluate", folder, "--methods", "vio")
    assert code == 0
    assert "vio_phone.tum holds poses of a device turned by" in err
    if given == "file":
        given = tmp_path / "mount.txt"
        np.savetxt(given, BODY_FROM_CAM.to_matrix())
    code, out, err = run("evaluate", folder, "--methods", "vio", "--vio-from-cam", given)
    assert (code, err) == (0, "")
    assert "vio_phone.tum: body_from_cam " in out


@pytest.mark.slow
def test_predictions_that_are_the_ground_truth(walk, run, tmp_path):
    folder = tmp_path / "Set" / "walk"
    write_walk(folder, gt=walk.gt, vios={"phone": walk.vio}, aprs={"net": walk.gt})
    _, _, err = run("evaluate", folder, "--methods", "vio")
    assert "gt.tum and apr_net.tum hold the same poses" in err
