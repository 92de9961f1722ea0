import numpy as np
import pytest
from tests.court import error_m, joined, make_court, pairs_of

from vioapr.mapping.joining import join_worlds
from vioapr.mapping.two_view import estimate_distances_m
from vioapr.simulation.court import COUNT, crossing_rows, moved_along, sequential_rows

FIRST = np.arange(COUNT)


def join(images, found):
    return join_worlds(images, found, estimate_distances_m(images, found), seed=0)


def test_worlds_are_joined_by_the_pairs_between_them(rng):
    images, truth = make_court(rng)
    found = joined(pairs_of(truth, sequential_rows()), pairs_of(truth, crossing_rows()))
    poses, world = join(images, found)
    assert set(world) == {0}
    assert error_m(poses, truth, FIRST).max() < 0.7  # 3 deg of drift are 0.4 m at 7 m
    np.testing.assert_allclose(poses.translation_m[FIRST], images.vio_from_cam.translation_m[FIRST])


def test_either_image_of_a_pair_may_be_of_the_world_that_is_placed(rng):
    images, truth = make_court(rng, drift_deg=0.0)
    turned = [(b, a) for a, b in crossing_rows()]
    found = joined(pairs_of(truth, sequential_rows()), pairs_of(truth, turned))
    poses, world = join(images, found)
    assert set(world) == {0}
    assert error_m(poses, truth, FIRST).max() < 0.3


def test_facades_that_repeat_are_outvoted(rng):
    """Two of five pairs are of windows four metres on: every image by its own wall."""
    images, truth = make_court(rng)
    rows = np.array(crossing_rows(every=1))
    wrong = rows[np.arange(len(rows)) % 5 < 2]
    ghosts = moved_along(truth, wrong[:, 1], 4.0)
    right = rows[np.arange(len(rows)) % 5 >= 2]
    found = joined(
        pairs_of(truth, sequential_rows()), pairs_of(truth, right), pairs_of(ghosts, wrong)
    )
    poses, world = join(images, found)
    assert set(world) == {0}
    assert error_m(poses, truth, FIRST).max() < 0.8


@pytest.mark.parametrize(("count", "is_level"), [(2, True), (20, False)])
def test_too_few_pairs_or_no_gravity(rng, count, is_level):
    images, truth = make_court(rng, is_level=is_level)
    found = joined(pairs_of(truth, sequential_rows()), pairs_of(truth, crossing_rows()[:count]))
    poses, world = join(images, found)
    assert world.tolist() == images.tracking_world.tolist()
    np.testing.assert_array_equal(poses.translation_m, images.vio_from_cam.translation_m)


def test_pairs_that_agree_on_nothing(rng):
    images, truth = make_court(rng)
    rows = [(k, COUNT + (k * 7 + 11) % COUNT) for k in range(0, COUNT, 4)]
    random = pairs_of(truth, rows)
    quats = rng.standard_normal((len(rows), 4))
    random = random._replace(second_from_first=quats / np.linalg.norm(quats, axis=1)[:, None])
    _, world = join(images, joined(pairs_of(truth, sequential_rows()), random))
    assert set(world) == {0, 1}


def test_no_pairs(rng):
    images, truth = make_court(rng)
    poses, world = join(images, pairs_of(truth, []))
    assert set(world) == {0, 1}
    assert len(poses.translation_m) == 2 * COUNT
