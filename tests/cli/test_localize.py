"""`vioapr localize` and `vioapr bench` on an exported file."""

import csv
import json
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.calibrations import SETTING, pair_of
from tests.localizers import images

from vioapr.errors import VioAprError
from vioapr.evaluation.calibration.choice import UNCALIBRATED
from vioapr.formats import tum
from vioapr.fusion.calibrated import read_calibration, write_calibration
from vioapr.runtime.session import open_session
from vioapr.scene.frames import Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.calibration import Calibration
from vioapr.schemas.contract import METADATA_KEY
from vioapr.schemas.recording import RecordingInfo
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow
FRAMES = 20


@pytest.fixture
def scene(tmp_path):
    """A scene with one test recording with pictures and ground truth."""
    walk = simulate_walk(WalkParams(duration_s=FRAMES / 2, extent_m=8), seed=5)
    scene = Scene.create(tmp_path / "scene", "Place", is_outdoor=True)
    with RecordingWriter(scene.recording_folder("walk"), RecordingInfo(tracker="ARKit")) as writer:
        for row, image in enumerate(images(FRAMES)):
            is_lost = row == 12
            writer.add_frame(
                float(walk.gt.timestamp_s[row]),
                "" if row == 7 else f"{row:04d}.jpg",
                None if row == 7 else image,
                Tracking.LOST if is_lost else Tracking.NORMAL,
                None if is_lost else walk.vio.target_from_source.at(row),
            )
    scene = scene.with_recording("walk", "test")
    scene.save()
    scene.write_gt("walk", walk.gt)
    return scene


@pytest.fixture
def recording(scene):
    return scene.recording_folder("walk")


@pytest.fixture
def model(model_of):
    return model_of("chain")


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_recording_becomes_a_csv_and_a_report(run, model, recording, tmp_path):
    out = tmp_path / "fused.csv"
    code, text, err = run(
        "localize", "--model", model, "--recording", recording, "--out", out,
        "--report", tmp_path / "report",
    )  # fmt: skip
    assert code == 0, err
    rows = rows_of(out)
    assert len(rows) == FRAMES
    assert [row["status"] for row in rows[:1]] == ["optimized"]
    assert rows[7]["status"] == "tracked"  # the frame without image
    assert rows[12]["status"] == "predicted"  # the one without tracking
    assert np.isfinite([float(row["sigma_position_m"]) for row in rows]).all()
    assert "chain" in text
    assert "vio-apr" in text
    # What the file's own answers did to content is known too.
    title = next(line for line in text.splitlines() if "content jumps and stated sigmas" in line)
    below = text[text.index(title) :].splitlines()
    own = next(line.split() for line in below if line.startswith("chain "))
    assert np.isfinite([float(cell) for cell in own[1:3]]).all()
    assert (tmp_path / "report" / "index.html").exists()


def test_images_with_a_trajectory_give_the_same(run, model, recording, tmp_path, scene):
    whole, some = tmp_path / "whole.csv", tmp_path / "some.csv"
    run("localize", "--model", model, "--recording", recording, "--out", whole)
    vio = scene.recording("walk").frames.to_trajectory()
    lines = ["# timestamp_s x y z qx qy qz qw"]
    for row in range(len(vio)):
        values = [vio.timestamp_s[row], *vio.position_m[row], *vio.quat_xyzw[row]]
        lines.append(" ".join(repr(float(value)) for value in values))
    (tmp_path / "vio.tum").write_text("\n".join(lines) + "\n")
    for row in range(FRAMES):  # images named by their time
        path = recording / "images" / f"{row:04d}.jpg"
        if path.exists():
            path.rename(path.with_name(f"{(row + 1) / 2:.6f}.jpg"))
    arguments = ("--model", model, "--vio", tmp_path / "vio.tum", "--images", recording / "images")
    code, text, err = run("localize", *arguments, "--out", "-")
    assert code == 0, err
    arguments = (*arguments[:-1], arguments[-1] / "*.jpg")
    code, _, err = run("localize", *arguments, "--out", some)
    assert code == 0, err
    assert text == some.read_text()  # a folder is all its images
    expected, found = rows_of(whole), rows_of(some)
    assert len(found) == FRAMES - 1  # one frame had no image
    for row in range(7):
        assert found[row]["status"] == expected[row]["status"]
        left, right = ([float(r[row][k]) for k in "xyz"] for r in (found, expected))
        np.testing.assert_allclose(left, right, atol=1e-4)


def test_it_runs_where_pytorch_cannot_be_imported(model, recording, tmp_path):
    code = (
        "import sys\n"
        "class Blocked:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('torch', 'onnx', 'onnxscript', 'safetensors'):\n"
        "            raise ModuleNotFoundError(name)\n"
        "sys.meta_path.insert(0, Blocked())\n"
        "from vioapr.cli import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    arguments = ["--model", model, "--recording", recording, "--out", tmp_path / "f.csv"]
    command = [sys.executable, "-c", code, "localize", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert len(rows_of(tmp_path / "f.csv")) == FRAMES
    command = [sys.executable, "-c", code, "bench", str(model), "--repeats", "2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "parts are not measured" in done.stdout


def test_bench_prints_every_part(run, model, tmp_path):
    code, out, err = run(
        "bench", model, "--repeats", "5", "--threads", "1", "--json", tmp_path / "b.json"
    )
    assert code == 0, err
    for part in ("whole localizer", "image to network input", "regressor", "fusion"):
        assert part in out
    found = json.loads((tmp_path / "b.json").read_text())
    parts = [found["ms"][name]["p50"] for name in ("preprocess", "network", "fusion")]
    assert all(ms > 0 for ms in parts)
    assert found["ms"]["whole"]["p50"] <= found["ms"]["whole"]["p99"]
    assert found["file_mb"] == pytest.approx(model.stat().st_size / 1e6)


def test_view_and_rerun_say_what_is_missing(fails, model, recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.setitem(sys.modules, "rerun", None)
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert "pip install 'vioapr[viser]'" in fails(*base, "--view")
    assert "pip install 'vioapr[rerun]'" in fails(*base, "--rrd", tmp_path / "walk.rrd")


def test_onnxruntime_is_missing(fails, model, recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert "pip install 'vioapr[runtime]'" in fails(*base)


def test_arguments_that_do_not_fit(fails, model, recording, tmp_path):
    base = ("localize", "--model", model, "--out", tmp_path / "f.csv")
    assert "either --recording or --images with --vio" in fails(*base)
    assert "give --vio" in fails(*base, "--images", "*.jpg")
    assert "has poses of its own" in fails(*base, "--recording", recording, "--vio", "v.tum")
    assert "found no file" in fails(*base, "--images", tmp_path / "*.jpg", "--vio", "v.tum")
    assert "--threads: expected at least 1, got 0" in fails(*base, "--threads", 0)
    (tmp_path / "empty").mkdir()
    assert "found no file" in fails(*base, "--images", tmp_path / "empty", "--vio", "v.tum")
    assert "--repeats" in fails("bench", model, "--repeats", "0")


def altered(model, path, change):
    import onnx

    content = onnx.load(model)
    change(content)
    path.write_bytes(content.SerializeToString())
    return path


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("truncated", "truncated, damaged or something"),
        ("text", "truncated, damaged or something"),
        ("empty", "truncated, damaged or something"),
        ("missing", "found none of this name"),
        ("foreign", "found an ONNX file without the metadata 'vioapr'"),
        ("future", "contract: expected version 2, got 99"),
        ("garbled", "contract: expected JSON"),
        ("renamed", "expected the contract's inputs"),
    ],
)
def test_a_bad_model_is_one_line(fails, model, recording, tmp_path, damage, message):
    path = tmp_path / "bad.onnx"

    def set_contract(text):
        def change(content):
            (entry,) = content.metadata_props
            assert entry.key == METADATA_KEY
            entry.value = text(entry.value)

        return change

    def rename(content):
        from vioapr.export.onnx_graph import rename_input

        rename_input(content, "timestamp_s", "time")

    if damage == "truncated":
        path.write_bytes(model.read_bytes()[: model.stat().st_size // 2])
    elif damage in ("text", "empty"):
        path.write_text("not a model" * (damage == "text"))
    elif damage == "foreign":
        altered(model, path, lambda content: content.metadata_props.pop())
    elif damage == "future":
        altered(model, path, set_contract(lambda t: t.replace('"version": 2', '"version": 99')))
    elif damage == "garbled":
        altered(model, path, set_contract(lambda t: t[:50]))
    elif damage == "renamed":
        altered(model, path, rename)
    base = ("localize", "--model", path, "--recording", recording, "--out", tmp_path / "f.csv")
    assert message in fails(*base)
    assert not (tmp_path / "f.csv").exists()


def test_a_broken_image_is_one_line(fails, model, recording, tmp_path):
    image = recording / "images" / "0003.jpg"
    image.write_bytes(image.read_bytes()[:200])
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert "0003.jpg: expected an image" in fails(*base)


def test_grey_and_transparent_images_are_read(run, model, recording, tmp_path):
    Image.new("L", (30, 20), 99).save(recording / "images" / "0003.jpg")
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert run(*base)[0] == 0


def test_the_file_runs_in_an_environment_without_pytorch(model, recording, tmp_path):
    """A new virtual environment that sees numpy and the like, but no PyTorch and no onnx."""
    home = tmp_path / "venv"
    venv.create(home, with_pip=False)
    packages = Path(np.__file__).parents[1]
    target = next(home.glob("lib/python*/site-packages"))
    hidden = ("torch", "onnx-", "onnxscript", "onnx_ir", "functorch", "safetensors")
    for entry in packages.iterdir():
        if not entry.name.startswith(hidden) and entry.name != "onnx":
            (target / entry.name).symlink_to(entry)
    source = Path(sys.modules["vioapr"].__file__).parents[1]
    python = home / "bin" / "python"
    probe = [python, "-c", "import torch"]
    assert subprocess.run(probe, capture_output=True, env={}).returncode != 0
    arguments = ["--model", model, "--recording", recording, "--out", tmp_path / "f.csv"]
    command = [python, "-m", "vioapr", "localize", *map(str, arguments)]
    environment = {"PYTHONPATH": str(source), "HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 0, done.stderr
    assert len(rows_of(tmp_path / "f.csv")) == FRAMES


def test_tum_ground_truth_may_be_given(run, model, recording, tmp_path, scene):
    gt = tmp_path / "gt.tum"
    tum.write(gt, scene.gt("walk"))
    scene.gt_path("walk").unlink()
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert "all frames" not in run(*base)[1]
    assert "all frames" in run(*base, "--overwrite", "--gt", gt)[1]


def test_without_ground_truth_there_is_no_report(fails, model, recording, tmp_path, scene):
    scene.gt_path("walk").unlink()
    base = ("localize", "--model", model, "--recording", recording, "--out", tmp_path / "f.csv")
    assert "--report needs ground truth: give --gt" in fails(*base, "--report", tmp_path / "report")


def test_errors_are_the_projects_own():
    from vioapr.errors import ContractError

    assert issubclass(ContractError, VioAprError)


def test_a_scene_is_calibrated_with_an_exported_file(run, fails, model_of, scene, tmp_path):
    out = tmp_path / "calibration.toml"
    words = ("calibrate", scene.folder, "--model", model_of("vio-apr"), "--out", out)
    code, _, err = run(*words)
    assert code == 0, err
    (pair,) = read_calibration(out).pairs
    assert (pair.tracker, pair.regressor) == ("arkit", "tiny")
    assert pair.made_from.walks == ("Place/walk",)
    assert 15 <= pair.made_from.frames <= FRAMES
    scene.gt_path("walk").unlink()
    assert "expected recordings with ground truth in the split 'test'" in fails(
        *words, "--overwrite"
    )


def test_another_calibration_is_tried_without_a_new_export(
    run, fails, model_of, recording, tmp_path
):
    given = tmp_path / "own.toml", tmp_path / "other.toml"
    regressor = open_session(model_of("chain"))[1].regressor.model
    for path, setting in zip(given, (UNCALIBRATED, SETTING), strict=True):
        write_calibration(path, Calibration(pairs=(pair_of("arkit", regressor, setting=setting),)))

    def localize(*flags):
        out = tmp_path / f"{len(flags)}{Path(flags[-1]).stem if flags else ''}.csv"
        words = ("--model", model_of("chain"), "--recording", recording, "--out", out)
        code, _, err = run("localize", *words, *flags)
        assert code == 0, err
        return np.array([[float(row["x"]), float(row["sigma_position_m"])] for row in rows_of(out)])

    plain, own, other = localize(), *(localize("--calibration", path) for path in given)
    np.testing.assert_allclose(own, plain, rtol=1e-2, atol=1e-3)
    assert not np.allclose(other[-1, 1], plain[-1, 1], rtol=0.05)
    words = ("--model", model_of("vio-apr"), "--recording", recording, "--out", tmp_path / "x.csv")
    assert "--calibration: expected method chain, which it is for, got vio-apr" in fails(
        "localize", *words, "--calibration", given[0]
    )
