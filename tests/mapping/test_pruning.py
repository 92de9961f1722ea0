import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.pruning import PairRotations, contradicted, tilt_deg


def about_up(degrees):
    return Rotation.from_euler("y", degrees, degrees=True)


def two_worlds(rng, is_level=True, count=40):
    """A camera that turns about, seen in two tracking worlds of different headings.

    Returns the images and the true orientations in a common y-up world.
    """
    yaw = rng.uniform(0, 360, count)
    tilt = rng.uniform(-20, 20, count)
    true = about_up(yaw[:, None]) * Rotation.from_euler("x", 180 + tilt[:, None], degrees=True)
    world = np.repeat([0, 1], count // 2)
    own_heading = about_up(np.where(world == 0, 15.0, -80.0)[:, None])
    zeros, yes = np.zeros(count, dtype=np.intp), np.ones(count, dtype=bool)
    positions = 10 * rng.standard_normal((count, 3))
    images = MapImages(
        tuple(f"{k}.jpg" for k in range(count)), world, ("a", "b"), np.arange(count) * 1.0, world,
        Rigid3(positions, (own_heading * true).as_quat()), yes, yes, np.full(count, is_level),
        zeros, (), "", np.arange(count), {},
    )  # fmt: skip
    return images, true


def pairs_of(true, rows, wrong=None):
    """True relative rotations; `wrong` turns the first camera of each in the world."""
    first, second = rows.T
    turned = true[first] if wrong is None else wrong * true[first]
    relative = (true[second].inv() * turned).as_quat()
    return PairRotations(rows, np.full(len(rows), 50), relative)


def some_rows(rng, world, other, count=30):
    side = {0: np.arange(20), 1: np.arange(20, 40)}
    rows = np.column_stack([rng.choice(side[world], count), rng.choice(side[other], count)])
    return rows[rows[:, 0] != rows[:, 1]]


@pytest.mark.parametrize("other", [0, 1])
def test_true_pairs_are_kept(rng, other):
    images, true = two_worlds(rng)
    assert not contradicted(images, pairs_of(true, some_rows(rng, 0, other))).any()


def test_within_a_world_rotations_must_be_vios(rng):
    images, true = two_worlds(rng)
    rows = some_rows(rng, 0, 0)
    assert contradicted(images, pairs_of(true, rows, about_up(90))).all()
    assert not contradicted(images, pairs_of(true, rows, about_up(8))).any()
    images.vio_from_cam.translation_m[:] = 0
    images.vio_from_cam.quat_xyzw[:] = [0, 0, 0, 1]  # at one place, one way: sees the same
    assert not contradicted(images, pairs_of(true, rows, about_up(90))).any()


def test_between_worlds_up_must_be_up(rng):
    images, true = two_worlds(rng)
    rows = some_rows(rng, 0, 1)
    tilted = Rotation.from_euler("x", 10, degrees=True)
    assert contradicted(images, pairs_of(true, rows, tilted)).all()
    level, _ = two_worlds(np.random.default_rng(7), is_level=False)
    assert not contradicted(level, pairs_of(true, rows, tilted)).any()


def test_between_worlds_the_heading_of_most_matches_wins(rng):
    """A third of the pairs are facades on the other side of the court: a half turn about up."""
    images, true = two_worlds(rng)
    rows = some_rows(rng, 0, 1)
    is_wrong = np.arange(len(rows)) % 3 == 0
    turns = about_up(np.where(is_wrong, 180.0, 0.0)[:, None])
    assert contradicted(images, pairs_of(true, rows, turns)).tolist() == is_wrong.tolist()
    few = pairs_of(true, rows[:2], turns[:2])._replace(inliers=np.array([20, 20]))
    assert not contradicted(images, few).any()  # too few to say which of the two is right


def test_no_pairs():
    images, true = two_worlds(np.random.default_rng(0))
    assert contradicted(images, pairs_of(true, np.zeros((0, 2), dtype=np.intp))).shape == (0,)


def test_tilt_of_poses(rng):
    """The world is z up; VIO's y up is turned onto it, then by 7 deg off."""
    images, true = two_worlds(rng)
    z_up = Rotation.from_euler("x", 90, degrees=True)
    rows = np.arange(40)
    right = Rigid3(np.zeros((40, 3)), (z_up * true).as_quat())
    assert tilt_deg(images, rows, right).max() < 1e-5
    off = Rotation.from_euler("y", 7, degrees=True) * z_up * true
    wrong = Rigid3(np.zeros((40, 3)), off.as_quat())
    np.testing.assert_allclose(tilt_deg(images, rows, wrong), 7, atol=1e-6)
