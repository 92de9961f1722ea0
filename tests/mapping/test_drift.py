import numpy as np
from tests.court import error_m, joined, make_court, pairs_of

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.drift import correct_drift
from vioapr.mapping.joining import join_worlds
from vioapr.mapping.two_view import estimate_distances_m
from vioapr.simulation.court import COUNT, crossing_rows, moved_along, sequential_rows

FIRST = np.arange(COUNT)


def correct(images, found):
    """Errors before and after."""
    distance_m = estimate_distances_m(images, found)
    poses, _ = join_worlds(images, found, distance_m, seed=0)
    return poses, correct_drift(images, found, distance_m, poses)


def test_drift_and_a_jump_are_taken_out(rng):
    images, truth = make_court(rng, drift_deg=8.0, jump_m=0.6)
    rows = crossing_rows(1) + crossing_rows(1, shift=2)
    found = joined(pairs_of(truth, sequential_rows()), pairs_of(truth, rows))
    before, after = (error_m(poses, truth, FIRST) for poses in correct(images, found))
    assert np.median(before[COUNT:]) > 0.25
    assert np.median(after[COUNT:]) < 0.15
    assert after.max() < 0.4


def test_wrong_pairs_do_not_bend_it(rng):
    """Every fourth pair is of a window four metres on."""
    images, truth = make_court(rng)
    rows = np.array(crossing_rows(1) + crossing_rows(1, shift=2))
    wrong, right = rows[::4], np.delete(rows, np.s_[::4], axis=0)
    ghosts = moved_along(truth, np.unique(wrong[:, 1]), 4.0)
    found = joined(
        pairs_of(truth, sequential_rows()), pairs_of(truth, right), pairs_of(ghosts, wrong)
    )
    _, after = correct(images, found)
    assert error_m(after, truth, FIRST).max() < 0.4


def test_without_pairs_it_stays_as_vio_has_it(rng):
    images, truth = make_court(rng)
    images.vio_from_cam.translation_m[5] = np.nan  # tracking lost
    nothing = pairs_of(truth, [])
    after = correct_drift(images, nothing, np.zeros(0), Rigid3(*images.vio_from_cam))
    np.testing.assert_allclose(after.translation_m, images.vio_from_cam.translation_m, atol=1e-6)
