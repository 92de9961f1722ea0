"""`vioapr export`: from a checkpoint to files that run."""

import sys

import numpy as np
import pytest
from msgspec.structs import asdict
from tests.calibrations import SETTING, pair_of
from tests.localizers import images

pytestmark = pytest.mark.slow
torch = pytest.importorskip("torch", reason="PyTorch is not installed")
for package in ("onnx", "onnxscript", "onnxruntime", "safetensors"):
    pytest.importorskip(package, reason=f"{package} is not installed")

from vioapr.fusion.calibrated import write_calibration  # noqa: E402
from vioapr.geometry.rigid import Rigid3  # noqa: E402
from vioapr.runtime.localizer import OnnxLocalizer  # noqa: E402
from vioapr.runtime.session import open_session  # noqa: E402
from vioapr.scene.frames import Tracking  # noqa: E402
from vioapr.scene.scene import Scene  # noqa: E402
from vioapr.scene.writer import RecordingWriter  # noqa: E402
from vioapr.schemas.calibration import Calibration  # noqa: E402
from vioapr.schemas.contract import Regressor  # noqa: E402
from vioapr.schemas.recording import RecordingInfo  # noqa: E402


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    from vioapr.regression.checkpoint import save_regressor
    from vioapr.regression.networks import build
    from vioapr.schemas.regressor import RegressorSpec

    torch.manual_seed(0)
    spec = RegressorSpec("mobile", ("courtyard",), resize=64, crop=56)
    path = tmp_path_factory.mktemp("checkpoint") / "regressor.safetensors"
    save_regressor(path, build(spec), spec)
    return path


@pytest.fixture
def scene(tmp_path):
    scene = Scene.create(tmp_path / "scene", "Courtyard", is_outdoor=True)
    with RecordingWriter(scene.recording_folder("walk"), RecordingInfo(tracker="ARKit")) as writer:
        for row, image in enumerate(images(6)):
            pose = Rigid3(np.array([row, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
            writer.add_frame(row, f"{row}.jpg", image, Tracking.NORMAL, pose)
    scene = scene.with_recording("walk", "train")
    scene.save()
    return scene.folder


def test_a_checkpoint_becomes_one_file(run, checkpoint, tmp_path):
    from vioapr.export.preprocess import Preprocessor
    from vioapr.regression.checkpoint import load

    out = tmp_path / "localizer.onnx"
    code, text, err = run(
        "export", checkpoint, "--method", "vio-apr", "--n", "3", "--out", out,
        "--precision", "fp16w",
    )  # fmt: skip
    assert code == 0, err
    assert "MB" in text
    localizer = OnnxLocalizer(out)
    assert localizer.contract.precision == "fp16w"
    assert localizer.contract.regressor == Regressor("mobile", ("courtyard",))
    assert localizer.params["run_pairs"] == 3
    image = next(images(1))
    located = localizer.update(0.0, image, Rigid3.identity())
    with torch.no_grad():
        expected = load(checkpoint).network(Preprocessor(64, 56)(torch.from_numpy(image)))
    found = located.apr_world_from_cam.translation_m
    np.testing.assert_allclose(found, expected.position_m[0], atol=2e-2)


def test_int8_is_calibrated_on_the_scene_and_split(run, checkpoint, scene, tmp_path):
    code, _, err = run(
        "export", checkpoint, "--method", "vio-apr", "--out", tmp_path / "pair.onnx", "--split",
        "--precision", "int8-qdq", "--quantize-by", scene,
    )  # fmt: skip
    assert code == 0, err
    session, contract = open_session(tmp_path / "pair.apr.onnx")
    assert (contract.part, contract.precision) == ("apr", "int8-qdq")
    for part in ("fusion", "carry"):
        assert open_session(tmp_path / f"pair.{part}.onnx")[1].part == part
    feed = {"image": next(images(1)), "has_image": np.ones(1, dtype=np.float32)}
    assert all(np.isfinite(output).all() for output in session.run(None, feed))


def test_a_file_carries_its_calibration(run, fails, checkpoint, tmp_path):
    path, out = tmp_path / "calibration.toml", tmp_path / "fusion.onnx"
    pairs = pair_of("arkit", "mobile"), pair_of("arkit", "other")
    write_calibration(path, Calibration(pairs=pairs))
    words = ("export", checkpoint, "--method", "chain", "--out", out, "--calibration", path)
    code, _, err = run(*words, "--gravity", "none")
    assert code == 0, err
    fixed = open_session(out)[1].fixed_params
    for name, value in asdict(SETTING).items():
        assert fixed[name] == (value if name != "gravity" else "none")
    assert "--calibration: expected method chain" in fails(
        "export", checkpoint, "--method", "vio-apr", "--out", out, "--calibration", path,
        "--overwrite",
    )  # fmt: skip
    write_calibration(path, Calibration(pairs=(pairs[1], pairs[1])))
    line = fails(*words, "--overwrite")
    assert "none for any tracker with mobile" in line


def test_what_cannot_be_exported(fails, checkpoint, tmp_path, monkeypatch):
    out = ("--out", tmp_path / "x.onnx")
    refusal = fails("export", checkpoint, *out, "--method", "pose-graph")
    assert "--method: expected" in refusal
    assert "got 'pose-graph'" in refusal
    line = fails("export", checkpoint, *out, "--precision", "int4")
    assert "--precision: expected one of fp32, fp16w, int8w, int8-qdq, got 'int4'" in line
    assert "--precision int8-qdq and --quantize-by go together" in fails(
        "export", checkpoint, *out, "--precision", "int8-qdq"
    )
    assert "found no file" in fails("export", tmp_path / "none.safetensors", *out)
    (tmp_path / "torn.safetensors").write_bytes(checkpoint.read_bytes()[:1000])
    assert "half-written" in fails("export", tmp_path / "torn.safetensors", *out)
    monkeypatch.setitem(sys.modules, "onnx", None)
    monkeypatch.delitem(sys.modules, "vioapr.export.exporter", raising=False)
    monkeypatch.delitem(sys.modules, "vioapr.export.onnx_graph", raising=False)
    assert "pip install 'vioapr[export]'" in fails("export", checkpoint, *out)
