"""Every runtime answers as tests/golden/ says."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from vioapr.fusion.methods import METHODS

GOLDEN = Path(__file__).parents[1] / "golden"
EXPORTED = ("vio-apr", "consensus")


def load(name):
    return json.loads((GOLDEN / f"{name}.json").read_text())["frames"]


def maker():
    spec = importlib.util.spec_from_file_location("golden_make", GOLDEN / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def feed_of(inputs, param_values):
    unknown = {name: [np.nan] for name in inputs if "sigma" in name}
    unknown |= dict.fromkeys(("apr_world_from_cam", "vio_from_cam"), [0.0] * 6 + [1.0])
    feed = {k: unknown[k] if v is None else np.reshape(v, -1) for k, v in inputs.items()}
    if param_values:
        feed["params"] = param_values
    return {k: np.array(v, dtype=np.float32) for k, v in feed.items()}


def check(found, expected):
    for name, values in expected.items():
        got = np.reshape(np.array(found[name], dtype=float), -1)
        want = np.reshape(np.array(values, dtype=float), -1)
        if name.startswith("world_from") and got @ want < -0.5:
            got[3:] *= -1  # the same rotation
        # Positions in m, quaternions; deviations relative to their size.
        rtol = 1e-3 if name.startswith("sigma") else 0
        np.testing.assert_allclose(got, want, rtol=rtol, atol=1e-4, err_msg=name)


@pytest.mark.parametrize("name", EXPORTED)
def test_numpy(name):
    frames = load(name)
    answers = maker().answer(name, [frame["inputs"] for frame in frames])
    for answer, frame in zip(answers, frames, strict=True):
        check(answer, frame["outputs"])
    assert len({frame["outputs"]["status"] for frame in frames}) >= 4


@pytest.mark.parametrize("name", EXPORTED)
def test_eager_pytorch(name):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    from vioapr.export.graph import FusionGraph

    method = METHODS[name]
    graph = FusionGraph(method, method.params_type())
    values = [float(getattr(graph.params, param)) for param in graph.param_names]
    state = torch.zeros(graph.layout.size)
    for frame in load(name):
        feed = {k: torch.from_numpy(v) for k, v in feed_of(frame["inputs"], values).items()}
        with torch.no_grad():
            outputs = graph(**feed, state=state)
        state = outputs["next_state"]
        check({k: v.numpy() for k, v in outputs.items()}, frame["outputs"])


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPORTED)
def test_onnxruntime(name, exporter_of, tmp_path):
    from vioapr.runtime.localizer import open_session

    path = tmp_path / "fusion.onnx"
    path.write_bytes(exporter_of(name).export_split()[1].content)
    session, contract = open_session(path)
    values = [spec.default for spec in contract.params]
    state = np.zeros(contract.state_size, dtype=np.float32)
    for frame in load(name):
        feed = feed_of(frame["inputs"], values) | {"state": state}
        outputs = dict(zip(contract.output_names, session.run(None, feed), strict=True))
        state = outputs["next_state"]
        check(outputs, frame["outputs"])
