"""Exported files in onnxruntime against the same computation in eager PyTorch."""

import numpy as np
import pytest
from tests.localizers import EXPORTED, events, images, pictures, vio_pose

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.types import Status
from vioapr.schemas.contract import METADATA_KEY, parse

pytestmark = pytest.mark.slow
onnx = pytest.importorskip("onnx", reason="onnx is not installed")
torch = pytest.importorskip("torch", reason="PyTorch is not installed")
ort = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from vioapr.errors import ParameterError  # noqa: E402
from vioapr.export.operators import ALLOWED, find_forbidden  # noqa: E402
from vioapr.runtime.localizer import OnnxLocalizer  # noqa: E402
from vioapr.runtime.session import open_session  # noqa: E402


def feed_of(row, image, walk, contract):
    has_image, is_ok, is_reset = events(row)
    pose = np.concatenate([*vio_pose(walk, row)]).astype(np.float32)
    flags = {"has_image": has_image, "tracking_ok": is_ok, "tracking_reset": is_reset}
    time_s = np.array([row / 2])
    feed = {"image": image, "vio_from_cam": pose, "timestamp_s": time_s}
    feed |= {"image_timestamp_s": time_s, "image_vio_from_cam": pose}
    feed |= {name: np.array([flag]) for name, flag in flags.items()}
    if contract.params:
        feed["params"] = np.array([spec.default for spec in contract.params])
    return {k: v if k == "image" else v.astype(np.float32) for k, v in feed.items()}


def eager(module, feed, state):
    order = ("image", "has_image", "vio_from_cam", "timestamp_s", "tracking_ok", "tracking_reset",
             "image_timestamp_s", "image_vio_from_cam")  # fmt: skip
    tensors = [torch.from_numpy(feed[name]) for name in order]
    params = [torch.from_numpy(feed["params"])] if "params" in feed else []
    with torch.no_grad():
        outputs = module(*tensors, torch.from_numpy(state), *params)
    return {name: value.numpy() for name, value in outputs.items()}


@pytest.mark.parametrize("name", EXPORTED)
def test_the_file_equals_eager_pytorch_and_the_numpy_localizer(name, model_of, exporter_of, walk):
    session, contract = open_session(model_of(name), threads=1)
    module, localizer = exporter_of(name).eager, Localizer(name)
    states = [np.zeros(contract.state_size, dtype=np.float32) for _ in range(2)]
    statuses = set()
    for row, image in enumerate(pictures(walk)):
        feed = feed_of(row, image, walk, contract)
        found = dict(
            zip(
                contract.output_names,
                session.run(contract.output_names, feed | {"state": states[0]}),
                strict=True,
            )
        )
        expected = eager(module, feed, states[1])
        assert set(found) == set(expected)
        states = [found["next_state"], expected["next_state"]]
        for key in found:
            np.testing.assert_allclose(found[key], expected[key], rtol=1e-5, atol=5e-4, err_msg=key)
        estimate = localizer.update(
            row / 2,
            from_flat(found["apr_world_from_cam"]) if feed["has_image"][0] else None,
            vio_pose(walk, row),
            bool(feed["tracking_ok"][0]),
            tracking_reset=bool(feed["tracking_reset"][0]),
            apr_sigma_m=float(found["apr_sigma_position_m"][0]),
            apr_sigma_deg=float(found["apr_sigma_orientation_deg"][0]),
        )
        assert found["status"][0] == expected["status"][0] == estimate.status
        pose = np.concatenate([*estimate.world_from_cam])
        np.testing.assert_allclose(found["world_from_cam"], pose, atol=1e-4)
        statuses.add(estimate.status)
        if feed["has_image"][0]:  # the picture's two digits a number
            shown = walk.apr.position_m[row]
            np.testing.assert_allclose(found["apr_world_from_cam"][:3], shown, atol=2e-3)
    assert len(statuses) >= 3


def from_flat(flat):
    from vioapr.geometry.rigid import Rigid3

    return Rigid3(flat[:3].astype(float), flat[3:].astype(float))


@pytest.mark.parametrize("name", EXPORTED)
def test_only_portable_operators_without_branches(name, model_of):
    model = onnx.load(model_of(name))
    used = {node.op_type for node in model.graph.node}
    assert not used - ALLOWED
    assert not used & {"If", "Loop", "Scan", "QuantizeLinear", "DequantizeLinear"}
    assert all(node.domain == "" for node in model.graph.node)
    assert [entry.version for entry in model.opset_import if entry.domain == ""] == [18]
    assert [entry.key for entry in model.metadata_props] == [METADATA_KEY]


def test_the_list_of_operators_refuses():
    assert find_forbidden(["Add", "If", "QuantizeLinear"]) == ["If", "QuantizeLinear"]
    assert find_forbidden(["Add", "If", "QuantizeLinear"], is_quantized=True) == ["If"]


@pytest.mark.parametrize("name", EXPORTED)
def test_the_contract_is_complete(name, model_of, exporter_of):
    session, contract = open_session(model_of(name))
    for spec, value in zip(contract.inputs, session.get_inputs(), strict=True):
        assert (spec.name, list(spec.shape)) == (value.name, value.shape)
        assert value.type == {"float32": "tensor(float)", "uint8": "tensor(uint8)"}[spec.dtype]
    for spec, value in zip(contract.outputs, session.get_outputs(), strict=True):
        assert (spec.name, list(spec.shape)) == (value.name, value.shape)
        assert value.type == {"float32": "tensor(float)", "int32": "tensor(int32)"}[spec.dtype]
    assert contract.method == name
    assert parse(contract.to_json(), "again") == contract
    offsets = [1]
    for entry in contract.state_layout:
        assert entry.offset == offsets[-1]
        offsets.append(entry.offset + int(np.prod(entry.shape)))
    assert offsets[-1] == contract.state_size


@pytest.mark.parametrize("name", EXPORTED)
def test_the_split_set_equals_the_whole(name, model_of, exporter_of, tmp_path, walk):
    whole, contract = open_session(model_of(name))
    sessions = []
    parts = ("apr", "fusion", "carry")
    for part, exported in zip(parts, exporter_of(name).export_split(), strict=True):
        (tmp_path / f"{part}.onnx").write_bytes(exported.content)
        sessions.append(open_session(tmp_path / f"{part}.onnx"))
        assert sessions[-1][1].part == part
    (apr, apr_contract), (fusion, fusion_contract), (carry, carry_contract) = sessions
    state = np.zeros(contract.state_size, dtype=np.float32)
    for row, image in enumerate(images(12)):
        feed = feed_of(row, image, walk, contract) | {"state": state}
        expected = dict(zip(contract.output_names, whole.run(None, feed), strict=True))
        raw = apr.run(None, {name: feed[name] for name in ("image", "has_image")})
        feed |= dict(zip(apr_contract.output_names, raw, strict=True))
        feed["has_apr"] = feed["has_image"]
        fused = fusion.run(None, {spec.name: feed[spec.name] for spec in fusion_contract.inputs})
        found = dict(zip(apr_contract.output_names, raw, strict=True))
        found |= dict(zip(fusion_contract.output_names, fused, strict=True))
        for key in expected:
            np.testing.assert_allclose(found[key], expected[key], atol=1e-6, err_msg=key)
        if not feed["has_image"][0]:
            fed = {spec.name: feed[spec.name] for spec in carry_contract.inputs}
            carried = dict(zip(carry_contract.output_names, carry.run(None, fed), strict=True))
            for key in carried:
                np.testing.assert_allclose(carried[key], expected[key], atol=1e-5, err_msg=key)
        state = expected["next_state"]
    with pytest.raises(Exception, match="export without --split"):
        OnnxLocalizer(tmp_path / "apr.onnx")


@pytest.fixture(scope="module")
def wide(exporter_of):
    """An exporter whose network has many weights; it traces once for all precisions."""
    from tests.export.networks import TinySpec, WideNetwork

    from vioapr.export.exporter import Exporter

    base = exporter_of("vio-apr")
    return Exporter(WideNetwork().eval(), TinySpec(), base.fusion.method, base.fusion.params)


@pytest.mark.parametrize(("precision", "share"), [("fp16w", 0.55), ("int8w", 0.35)])
def test_smaller_weights(precision, share, wide):
    plain, small = wide.export_apr(), wide.export_apr(precision)
    assert len(small.content) < share * len(plain.content)
    assert small.contract.precision == precision
    image = next(images(1))
    poses = [
        ort.InferenceSession(f.content, providers=["CPUExecutionProvider"]).run(
            None, {"image": image, "has_image": np.ones(1, dtype=np.float32)}
        )[0]
        for f in (plain, small)
    ]
    assert 0 < np.abs(poses[0] - poses[1]).max() < 0.05


def test_static_quantization_keeps_the_pose(wide):
    def calibration():
        return [wide.preprocess(torch.from_numpy(image)).numpy() for image in images(20)]

    plain = wide.export_apr()
    quantized = wide.export_apr("int8-qdq", calibration)
    used = {node.op_type for node in onnx.load_from_string(quantized.content).graph.node}
    assert {"QuantizeLinear", "DequantizeLinear"} <= used
    feed = {"image": next(images(1, seed=9)), "has_image": np.ones(1, dtype=np.float32)}
    poses = [
        ort.InferenceSession(f.content, providers=["CPUExecutionProvider"]).run(None, feed)[0]
        for f in (plain, quantized)
    ]
    assert 0 < np.abs(poses[0] - poses[1]).max() < 0.2


def test_unportable_networks_and_methods_are_refused(exporter_of):
    from tests.export.networks import TinyNetwork, TinySpec

    from vioapr.errors import VioAprError
    from vioapr.export.exporter import Exporter
    from vioapr.fusion.methods import METHODS

    class Unportable(TinyNetwork):
        def forward(self, images):
            return super().forward(torch.asinh(images))

    method = METHODS["vio-apr"]
    exporter = Exporter(Unportable().eval(), TinySpec(), method, method.params_type())
    with pytest.raises(VioAprError, match="Asinh"):
        exporter.export_apr()
    graph = METHODS["pose-graph"]
    with pytest.raises(ParameterError, match="method: expected .* got 'pose-graph'"):
        Exporter(TinyNetwork(), TinySpec(), graph, graph.params_type())


def test_a_frame_without_image_says_so(model_of, walk):
    localizer = OnnxLocalizer(model_of("chain"))
    located = localizer.update(0.0, None, vio_pose(walk, 0))
    assert located.status == Status.UNLOCALIZED
    assert np.isnan(located.apr_world_from_cam.translation_m).all()
    assert np.isnan(located.world_from_cam.translation_m).all()
