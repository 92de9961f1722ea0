"""Every runtime answers as schema/golden/ says; tests/schemas/test_stale.py has NumPy's turn."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.localizers import EXPORTED

from vioapr.fusion.methods import METHODS
from vioapr.schemas.base import decode
from vioapr.schemas.golden import GoldenVectors

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).parents[2] / "schema" / "golden"
BATCHED = [name for name, method in METHODS.items() if method.is_batched]


def load(name):
    path = GOLDEN / f"{name}.json"
    return decode(path, path.read_text(), GoldenVectors).frames


def feed_of(inputs, param_values):
    values = msgspec.structs.asdict(inputs)
    unknown = {name: [np.nan] for name in values if "sigma" in name}
    unknown |= dict.fromkeys(("apr_world_from_cam", "vio_from_cam"), [0.0] * 6 + [1.0])
    unknown["image_vio_from_cam"] = [np.nan] * 7
    feed = {k: unknown[k] if v is None else np.reshape(v, -1) for k, v in values.items()}
    if param_values:
        feed["params"] = param_values
    return {k: np.array(v, dtype=np.float32) for k, v in feed.items()}


def check(found, outputs):
    for name, values in msgspec.structs.asdict(outputs).items():
        if values is msgspec.UNSET:
            assert name not in found
            continue
        got = np.reshape(np.array(found[name], dtype=float), -1)
        want = np.reshape(np.array(values, dtype=float), -1)
        if "_from_" in name and got @ want < -0.5:
            got[3:] *= -1  # the same rotation
        # Positions in m, quaternions; deviations relative to their size.
        rtol = 1e-3 if name.startswith("sigma") else 0
        np.testing.assert_allclose(got, want, rtol=rtol, atol=1e-4, err_msg=name)


@pytest.mark.parametrize("name", EXPORTED)
def test_the_vectors_have_most_statuses(name):
    assert len({frame.outputs.status for frame in load(name)}) >= 4


@pytest.mark.parametrize("name", BATCHED)
def test_eager_pytorch(name):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    from vioapr.export.graph import FusionGraph

    method = METHODS[name]
    graph = FusionGraph(method, method.params_type())
    values = [float(getattr(graph.params, param)) for param in graph.param_names]
    state = torch.zeros(graph.layout.size)
    for frame in load(name):
        feed = {k: torch.from_numpy(v) for k, v in feed_of(frame.inputs, values).items()}
        with torch.no_grad():
            outputs = graph(**feed, state=state)
        state = outputs["next_state"]
        check({k: v.numpy() for k, v in outputs.items()}, frame.outputs)


@pytest.mark.parametrize("name", ["apr", "pose-filter", *EXPORTED])
def test_onnxruntime(name, exporter_of, tmp_path):
    from vioapr.runtime.session import open_session

    path = tmp_path / "fusion.onnx"
    path.write_bytes(exporter_of(name).export_fusion().content)
    session, contract = open_session(path)
    values = [spec.default for spec in contract.params]
    state = np.zeros(contract.state_size, dtype=np.float32)
    for frame in load(name):
        feed = feed_of(frame.inputs, values) | {"state": state}
        outputs = dict(zip(contract.output_names, session.run(None, feed), strict=True))
        state = outputs["next_state"]
        check(outputs, frame.outputs)
