"""What 8-bit arithmetic covers, and where its ranges come from."""

import numpy as np
import pytest
from tests.localizers import images

pytestmark = pytest.mark.slow
onnx = pytest.importorskip("onnx", reason="onnx is not installed")
torch = pytest.importorskip("torch", reason="PyTorch is not installed")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")


@pytest.fixture(scope="module")
def quantize():
    from tests.export.networks import WideNetwork

    from vioapr.export.graph import AprPose, NetworkGraph
    from vioapr.export.onnx_graph import trace
    from vioapr.export.preprocess import Preprocessor
    from vioapr.export.quantize import change_precision

    preprocess = Preprocessor(64, 56)
    example = {"network_input": torch.zeros(1, 3, 56, 56), "has_image": torch.ones(1)}
    network = trace(NetworkGraph(WideNetwork().eval()).eval(), example, AprPose._fields)

    def quantized(pictures):
        inputs = [preprocess(torch.from_numpy(picture)).numpy() for picture in pictures]
        return change_precision(network, "int8-qdq", lambda: inputs).graph

    return quantized


def test_8_bits_end_at_the_last_convolution(quantize):
    types = [node.op_type for node in quantize(images(20)).node]
    last = len(types) - 1 - types[::-1].index("Conv")
    assert "QuantizeLinear" in types[:last]
    # The last convolution's own result is still rounded, once.
    assert types[last + 1 :].count("QuantizeLinear") == 1


def test_weights_after_it_are_stored_in_8_bits(quantize):
    large = [tensor for tensor in quantize(images(20)).initializer if np.prod(tensor.dims) > 1024]
    assert {tensor.data_type for tensor in large} == {onnx.TensorProto.INT8}
    assert len(large) == 2  # of the convolution and the head


def test_one_odd_image_does_not_take_the_resolution(quantize):
    usual = [picture // 8 for picture in images(20)]
    odd = np.full_like(usual[0], 255)
    plain, with_odd = (_coarsest_step(quantize(p)) for p in (usual, [*usual, odd]))
    assert with_odd < 1.5 * plain


def _coarsest_step(graph):
    scales = (t for t in graph.initializer if t.name.endswith("_scale") and not t.dims)
    return max(float(onnx.numpy_helper.to_array(scale)) for scale in scales)
