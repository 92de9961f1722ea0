"""Poses from points and pixels, by steps without branches."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from scipy.spatial.transform import Rotation  # noqa: E402

from vioapr.regression.points.robust_pose import (  # noqa: E402
    Matches,
    Poses,
    information_of,
    inverse,
    project,
    refine,
    rotation_of,
    score,
)

CAMERA = torch.tensor([250.0, 300.0, 140.0, 150.0])


def truth():
    rotation = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    return Poses(torch.tensor(rotation).float()[None], torch.tensor([[0.2, -0.1, 0.4]]))


def matches_of(pose, count=60, outliers=0, noise_px=0.0, seed=0):
    """Points in front of a camera, some of them shown somewhere else."""
    rng = np.random.default_rng(seed)
    cam_m = rng.uniform([-2, -2, 2], [2, 2, 8], (count, 3)).astype(np.float32)
    pixel = CAMERA[:2].numpy() * cam_m[:, :2] / cam_m[:, 2:] + CAMERA[2:].numpy()
    pixel += rng.normal(0, noise_px, pixel.shape)
    pixel[:outliers] = rng.uniform(0, 288, (outliers, 2))
    world_m = (torch.from_numpy(cam_m) - pose.translation_m) @ pose.rotation[0]
    return Matches(world_m[None], torch.from_numpy(pixel).float()[None], torch.ones(1, count))


def near(pose, turn, shift):
    change = rotation_of(torch.tensor([turn]))
    return Poses(change @ pose.rotation, pose.translation_m + torch.tensor([shift]))


def test_the_true_pose_leaves_no_gap():
    pose = truth()
    residuals = project(CAMERA, pose, matches_of(pose))
    assert residuals.gap.abs().max() < 1e-3
    assert (residuals.is_in_front == 1).all()


@pytest.mark.parametrize("outliers", [0, 30])
def test_a_pose_is_found_from_nearby_among_outliers(outliers):
    pose = truth()
    matches = matches_of(pose, outliers=outliers)
    found = refine(
        CAMERA, near(pose, [0.1, 0.15, -0.1], [0.4, -0.3, 0.2]), matches,
        steps=20, kernel_px=(100.0, 2.0),
    )  # fmt: skip
    torch.testing.assert_close(found.rotation, pose.rotation, atol=1e-4, rtol=0)
    torch.testing.assert_close(found.translation_m, pose.translation_m, atol=1e-3, rtol=0)
    fit, inliers = score(CAMERA, found, matches, 2.0)
    assert 60 - outliers <= float(inliers) <= 60 - outliers + 2
    assert float(fit) == pytest.approx(60 - outliers, abs=2)


def test_hypotheses_are_solved_side_by_side():
    pose = truth()
    matches = matches_of(pose)
    starts = [near(pose, [0.05 * k, 0.0, 0.0], [0.1 * k, 0.0, 0.0]) for k in range(1, 4)]
    together = Poses(*(torch.cat(parts) for parts in zip(*starts, strict=True)))
    found = refine(CAMERA, together, matches, steps=15, kernel_px=(50.0, 2.0))
    for row in range(3):
        torch.testing.assert_close(found.rotation[row], pose.rotation[0], atol=1e-4, rtol=0)


def test_points_behind_the_camera_do_not_count():
    pose = truth()
    matches = matches_of(pose, count=10)
    behind = Matches(*(part.clone() for part in matches))
    cam_m = torch.tensor([[0.0, 0.0, -3.0]])
    behind.world_m[0, 0] = (cam_m - pose.translation_m) @ pose.rotation[0]
    assert float(score(CAMERA, pose, behind, 4.0)[1]) == 9


def test_without_matches_a_pose_stays():
    pose = truth()
    nothing = matches_of(pose)._replace(weight=torch.zeros(1, 60))
    found = refine(CAMERA, pose, nothing, steps=5, kernel_px=(10.0, 2.0))
    torch.testing.assert_close(found.translation_m, pose.translation_m)


def test_the_covariance_is_that_of_many_draws():
    """Of the same points with a pixel of noise, drawn 300 times."""
    pose, changes = truth(), []
    for seed in range(300):
        clean = matches_of(pose, count=40)
        rng = np.random.default_rng(seed)
        noise = torch.from_numpy(rng.normal(0, 1, clean.pixel.shape)).float()
        drawn = clean._replace(pixel=clean.pixel + noise)
        found = refine(CAMERA, pose, drawn, steps=4, kernel_px=(1e4, 1e4))
        turn = Rotation.from_matrix((found.rotation @ pose.rotation.mT)[0].numpy()).as_rotvec()
        changes.append(np.concatenate([turn, (found.translation_m - pose.translation_m)[0]]))
    stated = inverse(information_of(CAMERA, pose, matches_of(pose, count=40), 1e4))[0]
    measured = np.std(changes, axis=0)
    # The shift is not exactly the one on the left: 25 % of the deviation.
    np.testing.assert_allclose(torch.sqrt(torch.diagonal(stated)), measured, rtol=0.25)


def test_an_inverse_is_one():
    rng = np.random.default_rng(1)
    rows = torch.from_numpy(rng.normal(size=(3, 20, 6)) * [100, 100, 100, 1, 1, 1]).float()
    matrix = rows.mT @ rows
    unit = matrix.double() @ inverse(matrix).double()
    torch.testing.assert_close(unit, torch.eye(6).double().expand(3, 6, 6), atol=2e-3, rtol=0)


def test_rotations_are_those_of_scipy():
    rotvec = np.array([[0.0, 0.0, 0.0], [0.1, -0.4, 0.3], [2.0, 1.0, -1.0]])
    expected = Rotation.from_rotvec(rotvec).as_matrix()
    np.testing.assert_allclose(rotation_of(torch.from_numpy(rotvec)), expected, atol=1e-6)
