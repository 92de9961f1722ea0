"""An exported localizer with another fusion step: the same network, the same answers."""

import numpy as np
import onnx
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")
onnxruntime = pytest.importorskip("onnxruntime")

from vioapr.export.refit import replace_fusion  # noqa: E402
from vioapr.fusion.methods import get_method  # noqa: E402
from vioapr.schemas.contract import METADATA_KEY, parse  # noqa: E402


def contract_of(content):
    model = onnx.load_from_string(content)
    return parse({e.key: e.value for e in model.metadata_props}[METADATA_KEY], "refit")


def run(content, frames=3):
    """Outputs of some frames of noise, one after the other."""
    session = onnxruntime.InferenceSession(content)
    rng, outputs = np.random.default_rng(0), []
    state = np.zeros(contract_of(content).state_size, np.float32)
    for row in range(frames):
        feed = {
            "image": rng.integers(0, 255, (48, 64, 3), dtype=np.uint8),
            "vio_from_cam": np.array([row, 0, 0, 0, 0, 0, 1], np.float32),
            "timestamp_s": np.array([row / 2], np.float32),
            "state": state,
        }
        feed |= {f"image_{name}": feed[name] for name in ("timestamp_s", "vio_from_cam")}
        for name, flag in (("has_image", 1), ("tracking_ok", 1), ("tracking_reset", 0)):
            feed[name] = np.array([flag], np.float32)
        if contract_of(content).params:
            values = contract_of(content).fill_params({}).values()
            feed["params"] = np.array([*values], np.float32)
        names = [output.name for output in session.get_outputs()]
        outputs.append(dict(zip(names, session.run(names, feed), strict=True)))
        state = outputs[-1].pop("next_state")
    return outputs


@pytest.mark.slow
def test_a_replaced_fusion_answers_as_an_exported_one_and_names_do_not_grow(model_of):
    method = get_method("apr")
    exported = model_of("vio-apr").read_bytes()
    once = replace_fusion(exported, method, method.params_type())
    assert once.contract.method == contract_of(once.content).method == "apr"
    for found, known in zip(run(once.content), run(exported), strict=True):
        np.testing.assert_array_equal(found["apr_world_from_cam"], known["apr_world_from_cam"])
        np.testing.assert_allclose(
            found["world_from_cam"][:3], found["apr_world_from_cam"][:3], atol=1e-6
        )
    twice = replace_fusion(once.content, method, method.params_type())
    assert twice.content == once.content
