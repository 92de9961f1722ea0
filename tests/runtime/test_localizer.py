"""What the runtime refuses, and what it promises."""

import numpy as np
import pytest
from tests.localizers import images, vio_pose

from vioapr.errors import ContractError, ParameterError
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3

pytestmark = pytest.mark.slow
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
