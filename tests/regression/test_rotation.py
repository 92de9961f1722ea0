"""Codes of rotations: each is the inverse of its own reading, and agrees with SciPy."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from vioapr.geometry import quaternion
from vioapr.geometry.quaternion import from_matrix, to_matrix, to_rotvec
from vioapr.regression.networks.rotation import ROTATION_CODES, quat_of_log


def log_of_quat(quat_xyzw):
    return to_rotvec(quat_xyzw) / 2


def angle_rad(left_xyzw, right_xyzw):
    return torch.deg2rad(quaternion.angle_between_deg(left_xyzw, right_xyzw))


@pytest.fixture
def quats():
    random = Rotation.random(50, rng=np.random.default_rng(0)).as_quat()
    half_turns = np.eye(4)
    return torch.as_tensor(np.concatenate([random, half_turns, -random]))


def test_log_quaternion_by_hand():
    """A quarter turn about z: the axis times half of 90 degrees."""
    quarter = torch.tensor([[0.0, 0.0, 2**-0.5, 2**-0.5]])
    expected = torch.tensor([[0.0, 0.0, torch.pi / 4]])
    torch.testing.assert_close(log_of_quat(quarter), expected)
    torch.testing.assert_close(log_of_quat(-quarter), expected)
    torch.testing.assert_close(quat_of_log(expected), quarter)


def test_log_and_back(quats):
    assert angle_rad(quat_of_log(log_of_quat(quats)), quats).max() < 1e-5


def test_matrix_is_scipys(quats):
    expected = Rotation.from_quat(quats.numpy()).as_matrix()
    torch.testing.assert_close(to_matrix(quats), torch.as_tensor(expected))


def test_quaternion_of_matrix_at_half_turns_too(quats):
    assert angle_rad(from_matrix(to_matrix(quats)), quats).max() < 1e-5


@pytest.mark.parametrize("name", ROTATION_CODES)
def test_residual_is_zero_at_the_truth_and_only_there(name, quats):
    code = ROTATION_CODES[name]
    true = quats[:50]
    says = {
        "log-quat": log_of_quat(true),
        "quat": 3 * true,
        "6d": to_matrix(true)[:, :, :2].transpose(1, 2).flatten(1) * 2,
    }[name]
    assert angle_rad(code.to_quat(says), true).max() < 1e-5
    assert code.residual(says, true).abs().max() < 1e-6
    assert (code.residual(says, true.roll(1, 0)).norm(dim=-1) > 0.1).all()


@pytest.mark.parametrize("name", ROTATION_CODES)
def test_untrained_heads_say_no_rotation(name):
    code = ROTATION_CODES[name]
    quat = code.to_quat(torch.tensor([code.start]))
    assert angle_rad(quat, torch.tensor([[0.0, 0.0, 0.0, 1.0]])) < 1e-5
    assert len(code.start) == code.size


def test_6d_has_no_jump_at_half_turns():
    """Just below and just above a half turn, log-quaternions are far apart, 6-D is not."""
    turns = [Rotation.from_euler("z", degrees, degrees=True) for degrees in (179, 181)]
    below, above = (torch.as_tensor(turn.as_quat()[None]) for turn in turns)
    assert (log_of_quat(below) - log_of_quat(above)).norm() > 3
    columns = [to_matrix(quat)[:, :, :2] for quat in (below, above)]
    assert (columns[0] - columns[1]).norm() < 0.06


def test_angle_by_hand():
    none, quarter = torch.tensor([[0.0, 0, 0, 1]]), torch.tensor([[0.0, 0, 2**-0.5, 2**-0.5]])
    torch.testing.assert_close(angle_rad(none, quarter), torch.tensor([torch.pi / 2]))
    torch.testing.assert_close(angle_rad(none, -quarter), torch.tensor([torch.pi / 2]))
