import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.matching import match_descriptors
from vioapr.mapping.verification import chance_of_fit, log10_false_alarms, make_view, verify

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")

WIDTH, HEIGHT, FOCAL = 480, 360, 300.0
FIRST_FROM_SECOND = Rigid3(
    np.array([1.0, 0.1, 0.2]), Rotation.from_euler("y", -8, degrees=True).as_quat()
)


def view_of(pixels):
    camera = pycolmap.Camera.create_from_model_name(1, "PINHOLE", FOCAL, WIDTH, HEIGHT)
    return make_view(camera, pixels)


def two_views(rng, common, different):
    """Two images with some common points, and others in different places; noise of 0.4 px."""
    points = rng.uniform([-4, -3, 6], [4, 3, 12], (common, 3))
    seen = []
    for each in (points, FIRST_FROM_SECOND.inverse().apply(points)):
        pixels = FOCAL * each[:, :2] / each[:, 2:] + [WIDTH / 2, HEIGHT / 2]
        noisy = pixels + 0.4 * rng.standard_normal(pixels.shape)
        other = rng.uniform(0, [WIDTH, HEIGHT], (different, 2))
        seen.append(view_of(np.concatenate([noisy, other])))
    rows = np.arange(common + different, dtype=np.uint32)
    return *seen, np.column_stack([rows, rows])


def inliers(geometry):
    return np.asarray(geometry.inlier_matches).reshape(-1, 2)[:, 0]


@pytest.mark.parametrize("guesses", [[], [FIRST_FROM_SECOND]])
def test_what_is_common_is_found(rng, guesses):
    first, second, matches = two_views(rng, common=80, different=20)
    found = inliers(verify(first, second, matches, guesses, seed=0))
    assert np.isin(found, np.arange(80)).mean() > 0.9
    assert len(found) > 70


def test_a_guess_that_fits_is_kept_as_it_is(rng):
    first, second, matches = two_views(rng, common=80, different=20)
    geometry = verify(first, second, matches, [FIRST_FROM_SECOND], seed=0)
    expected = FIRST_FROM_SECOND.inverse().translation_m
    np.testing.assert_allclose(geometry.cam2_from_cam1.translation, expected)


def test_a_wrong_guess_does_no_harm(rng):
    first, second, matches = two_views(rng, common=80, different=20)
    wrong = Rigid3(np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.2, 0.0, 0.98]))
    assert len(inliers(verify(first, second, matches, [wrong], seed=0))) > 70


@pytest.mark.parametrize("count", [20, 60, 200, 600])
def test_matches_by_chance_are_no_common_view(count):
    """However many there are, no geometry that some of them agree on counts."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        first, second, matches = two_views(rng, common=0, different=count)
        assert not len(inliers(verify(first, second, matches, [FIRST_FROM_SECOND], seed=0)))


def test_features_of_one_place_count_once(rng):
    """Eight places with features of several orientations each are no fifteen matches."""
    first, second, _ = two_views(rng, common=8, different=0)
    again = [view_of(np.repeat(view.pixels, 3, axis=0)) for view in (first, second)]
    rows = np.arange(24, dtype=np.uint32)
    assert not len(inliers(verify(*again, np.column_stack([rows, rows]), [], seed=0)))


def test_false_alarms_by_hand():
    """Ten of ten matches on a line each with chance 0.1: 10 * 1 * C(10, 5) * 0.1^5."""
    assert log10_false_alarms(10, 10, 0.1) == pytest.approx(np.log10(10 * 252 * 1e-5))
    assert log10_false_alarms(100, 5, 0.1) == 2.0
    assert chance_of_fit(2.0, 300, 400) == pytest.approx(4 * 500 / 120000)


def test_descriptors_match_both_ways(rng):
    first = rng.standard_normal((30, 128)).astype(np.float32)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.concatenate([first[10:20][::-1], -first[:5]])
    expected = np.column_stack([np.arange(10, 20), np.arange(10)[::-1]])
    np.testing.assert_array_equal(match_descriptors(first, second), expected)
    # Two that are equally near are no match, nor is one that is nearer to another.
    assert not len(match_descriptors(first[:1], np.concatenate([first[:1], first[:1]])))
    near = first[:2] + 0.02 * first[2]
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    pair = np.concatenate([near[:1], first[:1]])
    assert match_descriptors(pair, first[[0, 3]]).tolist() == [[1, 0]]


@pytest.mark.parametrize("counts", [(0, 5), (5, 0), (5, 1)])
def test_too_few_descriptors(counts):
    first, second = (np.ones((count, 128), np.float32) for count in counts)
    assert match_descriptors(first, second).shape == (0, 2)
