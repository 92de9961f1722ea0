"""What the runtime refuses, and what it promises."""

import json

import numpy as np
import pytest
from tests.localizers import images, pictures, vio_pose

from vioapr.errors import ContractError, ParameterError
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3

pytestmark = pytest.mark.slow
onnx = pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from vioapr.runtime.localizer import OnnxLocalizer  # noqa: E402

POSE = Rigid3(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
IMAGE = np.zeros((20, 30, 3), dtype=np.uint8)


@pytest.fixture
def localizer(model_of):
    return OnnxLocalizer(model_of("vio-apr"))


@pytest.mark.parametrize(
    "image",
    [
        IMAGE.astype(np.float32),
        IMAGE[..., 0],
        np.zeros((20, 30, 4), dtype=np.uint8),
        IMAGE[None],
        np.zeros((0, 30, 3), dtype=np.uint8),
    ],
)
def test_a_wrong_image_is_refused(localizer, image):
    with pytest.raises(ContractError, match=r"image: expected RGB of shape \(height, width, 3\)"):
        localizer.update(0.0, image, POSE)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (Rigid3(np.array([0.0, np.nan, 0.0]), POSE.quat_xyzw), "finite numbers"),
        (Rigid3(np.zeros(3), np.full(4, np.inf)), "finite numbers"),
        (Rigid3(np.zeros(3), np.zeros(4)), "unit quaternion"),
        (Rigid3(np.zeros((2, 3)), np.zeros((2, 4))), "one pose"),
    ],
)
def test_a_pose_that_is_none_is_refused(localizer, pose, message):
    with pytest.raises(ContractError, match=message):
        localizer.update(0.0, IMAGE, pose)


@pytest.mark.parametrize("time_s", [5.0, 4.0, np.nan])
def test_time_goes_on(localizer, time_s):
    localizer.update(5.0, IMAGE, POSE)
    with pytest.raises(ContractError, match="timestamp_s: expected a finite time after"):
        localizer.update(time_s, IMAGE, POSE)


def test_states_of_other_models_are_refused(model_of, localizer):
    other = OnnxLocalizer(model_of("chain"))
    for one in (localizer, other):
        one.update(0.0, IMAGE, POSE)
    with pytest.raises(ContractError, match="is it of another model"):
        localizer.state = other.state
    foreign = localizer.state
    foreign[0] += 1
    with pytest.raises(ContractError, match="of this model in element 0"):
        localizer.state = foreign
    foreign[0] = np.nan
    with pytest.raises(ContractError, match="expected finite numbers"):
        localizer.state = foreign
    localizer.state = np.zeros(localizer.contract.state_size)


def test_a_stored_state_goes_on_where_it_was(model_of, walk):
    whole, first, second = (OnnxLocalizer(model_of("vio-apr")) for _ in range(3))
    for row, image in enumerate(images(20)):
        expected = whole.update(row, image, vio_pose(walk, row))
        if row == 10:
            second.state = first.state
        found = (first if row < 10 else second).update(row, image, vio_pose(walk, row))
        assert found.status == expected.status
        np.testing.assert_array_equal(found.world_from_cam[0], expected.world_from_cam[0])


def test_seconds_since_1970_do_not_lose_their_fractions(model_of, walk):
    answers = []
    for start_s in (0.0, 1.7e9):
        localizer = OnnxLocalizer(model_of("chain"))
        for row, image in enumerate(images(20)):
            time_s = start_s + row / 4
            located = localizer.update(time_s, image, vio_pose(walk, row))
        answers.append(np.concatenate([*located.world_from_cam]))
    np.testing.assert_array_equal(*answers)


def test_parameters_are_those_of_the_file(model_of):
    path = model_of("vio-apr")
    assert OnnxLocalizer(path, {"run_pairs": 8}).params["run_pairs"] == 8
    for name, value in (("run_pairs", 9), ("distance_threshold_m", -1), ("run_pairs", np.nan)):
        with pytest.raises(ParameterError, match=f"{name}: expected a number from"):
            OnnxLocalizer(path, {name: value})
    with pytest.raises(ParameterError, match="window: expected one of the file's parameters"):
        OnnxLocalizer(path, {"window": 3})
    with pytest.raises(ParameterError, match="it has none"):
        OnnxLocalizer(model_of("chain"), {"window": 3})


@pytest.mark.parametrize("name", ["vio-apr", "chain"])
def test_no_pose_without_saying_so(model_of, walk, name):
    wide = {"distance_threshold_m": 100.0, "angle_threshold_deg": 180.0}
    localizer = OnnxLocalizer(model_of(name), wide if name == "vio-apr" else None)
    statuses = set()
    for row, image in enumerate(images(40)):
        pose = None if row % 9 == 5 else vio_pose(walk, row)
        located = localizer.update(row, None if row % 4 == 0 else image, pose)
        statuses.add(located.status)
        is_lost = located.status == Status.UNLOCALIZED
        assert np.isnan(np.concatenate([*located.world_from_cam])).all() == is_lost
    assert Status.UNLOCALIZED in statuses
    assert len(statuses) > 1


@pytest.mark.parametrize("name", ["vio-apr", "chain"])
def test_a_state_that_overflowed_does_not_live_on(model_of, walk, name):
    localizer = OnnxLocalizer(model_of(name))
    pictures = list(images(2))
    localizer.update(0.0, pictures[0], vio_pose(walk, 0))
    state = localizer.state
    state[1:] = 3e38
    localizer.state = state
    located = localizer.update(1.0, pictures[1], vio_pose(walk, 1))
    is_lost = located.status == Status.UNLOCALIZED
    assert np.isnan(np.concatenate([*located.world_from_cam])).any() == is_lost
    assert np.isfinite(localizer.state).all()


def test_an_image_of_an_earlier_frame(model_of, walk):
    late, in_time = (OnnxLocalizer(model_of("chain")) for _ in range(2))
    shown = list(pictures(walk))
    for row in range(14):
        vio, earlier = vio_pose(walk, row), max(row - 2, 0)
        given = {"image_timestamp_s": earlier / 2, "image_vio_from_cam": vio_pose(walk, earlier)}
        found = late.update(row / 2, shown[earlier] if row >= 2 else None, vio, **given)
        expected = in_time.update(row / 2, shown[row], vio)
    assert found.status == expected.status == Status.OPTIMIZED
    # The same predictions, but for the last two, carried on by VIO that drifts little.
    gap_m = found.world_from_cam.translation_m - expected.world_from_cam.translation_m
    assert np.linalg.norm(gap_m) < 0.5
    assert found.display_from_vio is not None


def test_time_and_pose_of_an_image_go_together(localizer):
    with pytest.raises(ContractError, match="go together"):
        localizer.update(0.0, IMAGE, POSE, image_timestamp_s=0.0)
    not_unit = Rigid3(np.zeros(3), np.zeros(4))
    with pytest.raises(ContractError, match="image_vio_from_cam: expected a unit quaternion"):
        localizer.update(0.0, IMAGE, POSE, image_timestamp_s=0.0, image_vio_from_cam=not_unit)


def as_version_1(path, out):
    """The same file as the first version had it: without the inputs and outputs that came later."""
    model = onnx.load(path)
    entry = model.metadata_props[0]
    contract = json.loads(entry.value)
    for new, old in (
        ("image_timestamp_s", "timestamp_s"),
        ("image_vio_from_cam", "vio_from_cam"),
    ):
        for node in model.graph.node:
            node.input[:] = [old if name == new else name for name in node.input]
    for values, kind in ((model.graph.input, "inputs"), (model.graph.output, "outputs")):
        kept = [one for one in values if not one.name.startswith(("image_", "display_"))]
        del values[:]
        values.extend(kept)
        names = [one.name for one in kept]
        contract[kind] = [spec for spec in contract[kind] if spec["name"] in names]
    for key in ("localization_states", "easing"):
        del contract[key]
    entry.value = json.dumps(contract | {"version": 1})
    onnx.save(model, out)


def test_a_file_of_version_1_still_runs(model_of, walk, tmp_path):
    as_version_1(model_of("chain"), tmp_path / "old.onnx")
    old, new = OnnxLocalizer(tmp_path / "old.onnx"), OnnxLocalizer(model_of("chain"))
    for row, image in enumerate(images(6)):
        found, expected = (one.update(row, image, vio_pose(walk, row)) for one in (old, new))
    assert found.status == expected.status
    np.testing.assert_allclose(
        found.world_from_cam.translation_m, expected.world_from_cam.translation_m, atol=1e-5
    )
    assert found.display_from_vio is None
    with pytest.raises(ContractError, match="contract version 1, .* export it again"):
        old.update(9.0, IMAGE, POSE, image_timestamp_s=8.0, image_vio_from_cam=vio_pose(walk, 6))


def test_images_of_another_camera_are_named(model_of, tmp_path):
    from msgspec import UNSET, structs

    from vioapr.runtime.walk import frames_of_recording
    from vioapr.runtime.walk_checks import check_camera
    from vioapr.scene.frames import Intrinsics, Tracking
    from vioapr.scene.writer import RecordingWriter
    from vioapr.schemas.recording import RecordingInfo

    with RecordingWriter(tmp_path / "walk", RecordingInfo(tracker="none")) as writer:
        camera = Intrinsics(64, 48, 60, 60, 32, 24)
        writer.add_frame(0.0, "", None, Tracking.NORMAL, POSE, camera)
    frames = frames_of_recording(tmp_path / "walk")
    contract = OnnxLocalizer(model_of("chain")).contract
    assert contract.regressor.camera is UNSET
    assert check_camera(frames, contract) == []
    known = structs.replace(contract.regressor, camera=(0.7, 1.0, 0.5, 0.5))
    (found,) = check_camera(frames, structs.replace(contract, regressor=known))
    assert "of another camera" in str(found)
