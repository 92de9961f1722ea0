"""EfficientNet-Lite0 as a graph: TensorFlow's padding costs no operator, 8 bits keep features."""

import numpy as np
import pytest
import torch

pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnxscript", reason="onnxscript is not installed")
ort = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from vioapr.export.onnx_graph import trace  # noqa: E402
from vioapr.export.quantize import quantize  # noqa: E402
from vioapr.regression import pretrained  # noqa: E402
from vioapr.regression.checkpoint import read_state_dict  # noqa: E402
from vioapr.regression.networks.efficientnet_lite import EfficientNetLite0  # noqa: E402


class Features(torch.nn.Module):
    """The backbone with the second input of a regressor's graph."""

    def __init__(self, backbone):
        super().__init__()
        self.backbone = backbone

    def forward(self, images, has_image):
        return self.backbone(images) * has_image


def traced(backbone, size):
    example = {"network_input": torch.zeros(1, 3, size, size), "has_image": torch.ones(1)}
    return trace(Features(backbone).eval(), example, ["features"])


def outputs_of(model, images):
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    flag = np.ones(1, dtype=np.float32)
    feeds = ({"network_input": image, "has_image": flag} for image in images)
    return [session.run(None, feed)[0] for feed in feeds]


@pytest.mark.parametrize("size", [64, 72])
def test_the_graph_gives_what_pytorch_gives(size):
    """Also where a stride meets an odd size: 72, 36, 18, 9."""
    torch.manual_seed(0)
    backbone = EfficientNetLite0()
    model = traced(backbone, size)
    kinds = [node.op_type for node in model.graph.node]
    assert kinds.count("Conv") == 49
    assert "Pad" not in kinds
    image = torch.randn(1, 3, size, size)
    with torch.inference_mode():
        expected = backbone(image).numpy()
    (found,) = outputs_of(model, [image.numpy()])
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.skipif(not pretrained.has_pretrained(), reason="the extra pretrained is missing")
def test_features_survive_eight_bits():
    backbone = EfficientNetLite0()
    weights = read_state_dict(pretrained.find_pretrained("a test"))
    backbone.load_state_dict(backbone.select(weights))
    rng = np.random.default_rng(0)
    # Smooth blobs: noise of single pixels is no picture.
    coarse = torch.from_numpy(rng.normal(size=(6, 3, 8, 8)).astype(np.float32))
    images = torch.nn.functional.interpolate(coarse, size=(128, 128), mode="bicubic").numpy()
    model = traced(backbone, 128)
    quantized = quantize(model, [image[None] for image in images[:4]])
    assert {node.op_type for node in quantized.graph.node} >= {"QuantizeLinear", "Conv"}
    exact, rounded = (
        np.stack(outputs_of(m, [i[None] for i in images[4:]])) for m in (model, quantized)
    )
    for one, other in zip(exact, rounded, strict=True):
        cosine = np.sum(one * other) / np.linalg.norm(one) / np.linalg.norm(other)
        assert cosine > 0.95
