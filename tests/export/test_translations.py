"""What PyTorch's functions become in ONNX gives PyTorch's numbers, by allowed operators."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
pytest.importorskip("onnxscript", reason="onnxscript is not installed")
ort = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from vioapr.errors import VioAprError  # noqa: E402
from vioapr.export.onnx_graph import trace  # noqa: E402
from vioapr.export.operators import find_forbidden  # noqa: E402

pytestmark = pytest.mark.slow


class Functions(torch.nn.Module):
    """Calls what is translated."""

    def forward(self, values, mask, other, matrix, definite):
        flags = torch.where(mask > 0, other > 0, other < 0.5)
        return (
            torch.sort(values)[0],
            torch.sort(values, dim=-1, descending=True, stable=True)[0],
            torch.where(mask > 0, values, -values),
            flags.to(torch.float32),
            torch.linalg.vecdot(values, other),
            torch.linalg.diagonal(matrix),
            torch.linalg.cholesky(definite),
        )


@pytest.fixture(scope="module")
def inputs():
    torch.manual_seed(0)
    root = torch.randn(2, 3, 35, 40)
    return {
        "values": torch.randn(3, 7),
        "mask": torch.randn(3, 7),
        "other": torch.randn(3, 7),
        "matrix": torch.randn(2, 4, 4),
        "definite": root @ root.mT + 0.1 * torch.eye(35),
    }


def test_the_numbers_and_the_operators(inputs):
    names = ("sort", "descending", "where", "flags", "vecdot", "diagonal", "cholesky")
    model = trace(Functions().eval(), inputs, names)
    assert not find_forbidden(node.op_type for node in model.graph.node)
    session = ort.InferenceSession(model.SerializeToString())
    found = session.run(None, {name: value.numpy() for name, value in inputs.items()})
    expected = Functions()(*inputs.values())
    for name, got, want in zip(names, found, expected, strict=True):
        atol = {"cholesky": 3e-5, "vecdot": 1e-6}.get(name, 0)
        np.testing.assert_allclose(got, want.numpy(), rtol=0, atol=atol, err_msg=name)
    assert np.array_equal(found[-1], np.tril(found[-1]))


def test_a_function_that_onnx_does_not_have_is_one_line():
    class Solve(torch.nn.Module):
        def forward(self, matrix):
            return torch.linalg.solve(matrix, torch.ones_like(matrix))

    with pytest.raises(VioAprError, match="cannot be exported to ONNX: .*solve") as caught:
        trace(Solve().eval(), {"matrix": torch.eye(3)}, ["x"])
    assert "\n" not in str(caught.value)
