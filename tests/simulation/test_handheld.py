import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.simulation.handheld import look_at, looking, smooth_noise

AXES = np.eye(3)


def axes_of(quat_xyzw):
    """Right, down and forward of a camera in the world."""
    return [quaternion.rotate(quat_xyzw, axis) for axis in AXES]


@pytest.mark.parametrize(
    ("heading_deg", "forward", "right"), [(0, [1, 0, 0], [0, -1, 0]), (90, [0, 1, 0], [1, 0, 0])]
)
def test_level_cameras_look_along_their_heading(heading_deg, forward, right):
    found = axes_of(looking(np.deg2rad(heading_deg)))
    np.testing.assert_allclose(found, [right, [0, 0, -1], forward], atol=1e-12)


def test_pitch_is_downwards_and_roll_lowers_the_right_side():
    angle = np.deg2rad(np.array([10.0]))
    pitched = looking(np.zeros(1), np.outer(angle, [0, 1, 0]))
    assert axes_of(pitched)[2][0, 2] == pytest.approx(-np.sin(angle[0]))
    rolled = looking(np.zeros(1), np.outer(angle, [1, 0, 0]))
    assert axes_of(rolled)[0][0, 2] == pytest.approx(-np.sin(angle[0]))
    # The last tilt is made first: a roll about the level axis keeps the view where pitch put it.
    both = looking(np.zeros(1), np.outer(angle, [0, 1, 0]), np.outer(angle, [1, 0, 0]))
    np.testing.assert_allclose(axes_of(both)[2], axes_of(pitched)[2], atol=1e-12)


def test_a_camera_looks_at_its_target(rng):
    position, target = rng.normal(size=(2, 20, 3))
    camera_from_world = look_at(position, target).inverse()
    seen = camera_from_world.apply(target)
    np.testing.assert_allclose(seen[:, :2], 0, atol=1e-12)
    np.testing.assert_allclose(seen[:, 2], np.linalg.norm(target - position, axis=1))
    right, down, _ = axes_of(look_at(position, target).quat_xyzw)
    np.testing.assert_allclose(right[:, 2], 0, atol=1e-12)
    assert (down[:, 2] < 0).all()


@pytest.mark.parametrize("width_s", [0.5, 5.0])
def test_smooth_noise_has_its_deviation_and_its_width(rng, width_s):
    times = np.arange(0, 5000, 0.25)
    noise = smooth_noise(rng, times, width_s)
    assert noise.std() == pytest.approx(1, abs=0.1)
    # White noise through a Gaussian of width w has a correlation of exp(-lag^2 / 4 w^2).
    lag = round(width_s / 0.25)
    assert np.corrcoef(noise[lag:], noise[:-lag])[0, 1] == pytest.approx(np.exp(-0.25), abs=0.08)
