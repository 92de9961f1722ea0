"""Points where pictures with known poses agree."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from scipy.spatial.transform import Rotation  # noqa: E402

from vioapr.regression.points.keypoints import Keypoints  # noqa: E402
from vioapr.regression.points.triangulation import (  # noqa: E402
    Picture,
    match_mutually,
    nearest_views,
    triangulate,
)

CAMERA = torch.tensor([250.0, 250.0, 144.0, 144.0])
COUNT = 40


def scene(seed=0):
    """Points 3 to 6 m ahead, and a descriptor of each."""
    rng = np.random.default_rng(seed)
    world_m = rng.uniform([-1, -1, 3], [1, 1, 6], (COUNT, 3))
    descriptor = rng.normal(size=(COUNT, 64))
    return world_m, descriptor / np.linalg.norm(descriptor, axis=1, keepdims=True)


def picture(world_m, descriptor, centre_m, turn=(0.0, 0.0, 0.0), order=None):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    cam_m = (world_m - centre_m) @ rotation.T
    pixel = 250 * cam_m[:, :2] / cam_m[:, 2:] + 144
    rows = np.arange(COUNT) if order is None else order
    keypoints = Keypoints(
        torch.from_numpy(pixel[rows]).float(),
        torch.from_numpy(descriptor[rows]).float(),
        torch.ones(COUNT),
    )
    tensors = (torch.from_numpy(np.asarray(part)).float() for part in (rotation, centre_m))
    return Picture(keypoints, *tensors, CAMERA)


def others_of(world_m, descriptor):
    shuffled = np.random.default_rng(5).permutation(COUNT)
    return [
        picture(world_m, descriptor, np.array([0.6, 0.0, 0.1]), (0.0, -0.1, 0.0), shuffled),
        picture(world_m, descriptor, np.array([-0.5, 0.3, 0.0]), (0.1, 0.0, 0.2)),
        picture(world_m, descriptor, np.array([0.1, -0.5, 0.3])),
    ]


def test_matches_are_each_others_best():
    world_m, descriptor = scene()
    order = np.random.default_rng(2).permutation(COUNT)
    left = picture(world_m, descriptor, np.zeros(3)).keypoints
    right = picture(world_m, descriptor, np.zeros(3), order=order).keypoints
    row, is_match = match_mutually(left, right)
    assert is_match.all()
    np.testing.assert_array_equal(order[row.numpy()], np.arange(COUNT))
    without = right._replace(score=torch.zeros(COUNT))
    assert not match_mutually(left, without)[1].any()


def test_points_are_where_lines_of_sight_meet():
    world_m, descriptor = scene()
    found = triangulate(picture(world_m, descriptor, np.zeros(3)), others_of(world_m, descriptor))
    assert (found.others == 3).all()
    np.testing.assert_allclose(found.world_m.numpy(), world_m, atol=2e-3)


def test_a_wrong_match_off_the_line_is_left_out():
    world_m, descriptor = scene()
    others = others_of(world_m, descriptor)
    others[2].keypoints.xy[4] += torch.tensor([0.0, 60.0])
    others[2].keypoints.xy[9] += torch.tensor([60.0, 0.0])
    found = triangulate(picture(world_m, descriptor, np.zeros(3)), others)
    assert found.others[4] == found.others[9] == 2
    np.testing.assert_allclose(found.world_m.numpy(), world_m, atol=5e-3)


def test_two_pictures_are_not_enough():
    world_m, descriptor = scene()
    others = others_of(world_m, descriptor)[:1]
    found = triangulate(picture(world_m, descriptor, np.zeros(3)), others)
    assert (found.others == 0).all()


def test_pictures_from_one_place_say_no_depth():
    world_m, descriptor = scene()
    same = [
        picture(world_m, descriptor, np.full(3, 1e-3 * k), (0.0, 0.05 * k, 0.0)) for k in (1, 2)
    ]
    assert (triangulate(picture(world_m, descriptor, np.zeros(3)), same).others == 0).all()


def test_the_nearest_views_look_the_same_way():
    position_m = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [5.0, 0, 0]])
    direction = np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, 1]])
    found = nearest_views(position_m, direction, np.array([0, 3]), 2, size_m=1.0)
    np.testing.assert_array_equal(found[0], [2, 1])  # turned by half a turn, but near
    np.testing.assert_array_equal(found[1], [2, 0])
