import numpy as np
from tests.court import make_court

from vioapr.mapping.overlap import describe_gaps, describe_overlaps, find_islands, find_overlaps
from vioapr.schemas.map_summary import Overlap
from vioapr.simulation.court import crossing_rows, sequential_rows


def matched(rng, crossing_inliers):
    """Both walks in themselves, and some pairs between them."""
    images, _ = make_court(rng)
    crossing = crossing_rows(1)[: len(crossing_inliers)]
    pairs = np.array([*sequential_rows(), *crossing])
    inliers = np.array([50] * (len(pairs) - len(crossing)) + crossing_inliers)
    return images, pairs, inliers


def test_recordings_that_share_views_are_one_island(rng):
    found = matched(rng, [3, 40, 20])
    assert find_islands(*found, ["a", "b"]) == [["a", "b"]]
    (overlap,) = find_overlaps(*found, ["a", "b"])
    assert (overlap.compared, overlap.good) == (3, 2)
    images, pairs, _ = found
    assert overlap.best == [images.names[row] for row in pairs[-2]]


def test_too_few_matches_are_no_shared_view(rng):
    found = matched(rng, [3, 14])
    assert find_islands(*found, ["a", "b"]) == [["a"], ["b"]]
    (overlap,) = find_overlaps(*found, ["a", "b"])
    assert overlap == Overlap(recordings=["a", "b"], compared=2, good=0, best=[])


def test_what_is_missing_is_said():
    overlaps = [
        Overlap(recordings=["a", "b"], compared=9, good=9, best=["x", "y"]),
        Overlap(recordings=["a", "c"], compared=4, good=0, best=[]),
        Overlap(recordings=["b", "c"], compared=3, good=0, best=[]),
        Overlap(recordings=["a", "d"], compared=5, good=2, best=["x", "z"]),
    ]
    text = describe_gaps([["a", "b"], ["c"], ["d"]], overlaps)
    assert text.startswith("recordings share no view: a, b | c | d. Record a walk that sees both")
    assert "from the place of a or b to that of c; from the place of a or b to that of d" in text
    assert "of 7 pairs of images of a or b and c none sees the same things" in text
    assert "of 5 pairs of images of a or b and d only 2 see the same things" in text
    assert describe_overlaps(["c", "d"], overlaps) == "c: 0 of 7, d: 2 of 5"
