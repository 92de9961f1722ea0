import numpy as np
import pytest
from tests.helpers import random_rigid

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping import pairs
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.params import MappingParams
from vioapr.mapping.retrieval import describe_images

FORWARD = np.array([0.0, 0.0, 0.0, 1.0])
BACKWARD = np.array([0.0, 1.0, 0.0, 0.0])


def images_at(x_m, recording=None, world=None, quats=None):
    count = len(x_m)
    zeros = np.zeros(count, dtype=np.intp)
    yes = np.ones(count, dtype=bool)
    positions = np.column_stack([x_m, np.zeros((count, 2))]).astype(float)
    return MapImages(
        tuple(f"{k}.jpg" for k in range(count)),
        zeros if recording is None else np.array(recording), ("a", "b"), np.arange(count) / 2.0,
        zeros if world is None else np.array(world),
        Rigid3(positions, np.tile(FORWARD, (count, 1)) if quats is None else np.array(quats)),
        yes, yes, yes, zeros, (), "", np.arange(count), {},
    )  # fmt: skip


def test_sequences_stay_within_a_recording():
    images = images_at(np.zeros(5), recording=[0, 0, 0, 1, 1])
    found = pairs.sequential_pairs(images, np.arange(5), 2)
    assert pairs.unique_pairs(found).tolist() == [[0, 1], [0, 2], [1, 2], [3, 4]]
    assert len(pairs.sequential_pairs(images, np.arange(5), 0)) == 0


def test_neighbours_in_space_look_the_same_way():
    """A walk there and back: the images of the way back that look as those of the way there."""
    x = [0, 1, 2, 3, 30, 2.1, 1.1]
    quats = [FORWARD] * 5 + [FORWARD, BACKWARD]
    images = images_at(x, quats=quats)
    found = pairs.spatial_pairs(images, np.arange(7), images.vio_from_cam, 1, apart=2)
    assert pairs.unique_pairs(found).tolist() == [[0, 3], [0, 5], [1, 5], [2, 5]]
    assert len(pairs.spatial_pairs(images, np.arange(7), images.vio_from_cam, 0, apart=2)) == 0


def test_images_that_look_alike_across_worlds():
    images = images_at(np.zeros(4), world=[0, 0, 1, 1])
    likeness = np.array([[1, 0.9, 0.2, 0.1], [0.9, 1, 0.3, 0.8], [0.2, 0.3, 1, 0.9],
                         [0.1, 0.8, 0.9, 1]], dtype=np.float32)  # fmt: skip
    found = pairs.loop_pairs(images, np.arange(4), likeness, 1, apart=1)
    assert pairs.unique_pairs(found).tolist() == [[0, 2], [1, 2], [1, 3]]


def test_alike_images_of_one_world_must_be_possible_by_vio():
    """Two identical facades 200 m apart are not compared, two that VIO may confuse are."""
    likeness = np.ones((3, 3), dtype=np.float32)
    far = pairs.loop_pairs(images_at([0, 100, 200]), np.arange(3), likeness, 2, apart=1)
    near = pairs.loop_pairs(images_at([0, 5, 10]), np.arange(3), likeness, 2, apart=1)
    assert (len(far), pairs.unique_pairs(near).tolist()) == (0, [[0, 2]])
    unknown = images_at([0, 100, 200])
    unknown.vio_from_cam.translation_m[:] = np.nan
    assert len(pairs.loop_pairs(unknown, np.arange(3), likeness, 2, apart=1)) == 2


def test_no_pair_comes_twice():
    images = images_at(np.arange(12) % 6 / 2, recording=[0] * 6 + [1] * 6, world=[0] * 6 + [1] * 6)
    likeness = np.ones((12, 12), dtype=np.float32)
    rows, params = np.arange(12), MappingParams()
    for found in (
        pairs.first_pairs(images, rows, likeness, params),
        pairs.near_pairs(images, rows, images.vio_from_cam, np.zeros(12, dtype=np.intp), params),
    ):
        assert len(np.unique(found, axis=0)) == len(found) > 0
        assert (found[:, 0] < found[:, 1]).all()


def test_near_images_of_one_world():
    """Two walks on one line; only in one world is it known that they are near each other."""
    images = images_at([0, 1, 2, 0, 1, 2], recording=[0] * 3 + [1] * 3, world=[0] * 3 + [1] * 3)
    poses, rows = images.vio_from_cam, np.arange(6)
    params = MappingParams(sequential=2, spatial=1)
    together = pairs.near_pairs(images, rows, poses, np.zeros(6, dtype=np.intp), params)
    assert together.tolist() == [[0, 3], [1, 4], [2, 5]]
    assert len(pairs.near_pairs(images, rows, poses, images.tracking_world, params)) == 0
    poses.translation_m[4] = np.nan
    together = pairs.near_pairs(images, rows, poses, np.zeros(6, dtype=np.intp), params)
    assert 4 not in together


def test_queries_get_their_best():
    score = np.array([[0.1, 0.9, -np.inf], [0.5, 0.4, 0.3]])
    found = pairs.query_pairs(np.array([7, 8]), np.array([1, 2, 3]), score, 2)
    assert found.tolist() == [[7, 2], [7, 1], [8, 1], [8, 2]]


@pytest.mark.parametrize("features", [5, 400])
def test_views_of_one_place_look_alike(rng, features):
    """Three places of descriptors of their own, each seen twice with a third of it changed."""

    def unit(vectors):
        return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)

    places = [unit(rng.random((features, 128))) for _ in range(3)]
    changed = [np.concatenate([p[features // 3 :], unit(rng.random((features // 3, 128)))])
               for p in places]  # fmt: skip
    views = dict(enumerate([*places, *changed]))
    vectors = describe_images(lambda name: views[int(name)], "012345", seed=0)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, rtol=1e-5)
    likeness = vectors @ vectors.T - 2 * np.eye(6)
    assert likeness.argmax(axis=1).tolist() == [3, 4, 5, 0, 1, 2]


def test_viewing_directions(rng):
    quats = random_rigid(rng, (3,)).quat_xyzw
    np.testing.assert_allclose(np.linalg.norm(pairs.viewing_directions(quats), axis=1), 1)
    np.testing.assert_allclose(pairs.viewing_directions(BACKWARD[None]), [[0, 0, -1]], atol=1e-12)
