"""The parts of method `consensus`, each against what can be worked out by hand."""

import numpy as np
import pytest

from vioapr.fusion.consensus import columns
from vioapr.fusion.consensus.drift import CORRELATED_PART, LOG10_RATES, Samples, weigh_drifts
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.position import fit_position
from vioapr.fusion.consensus.robust import Ballot, newest, typical_of
from vioapr.fusion.consensus.rotation import _nearness as rotation_nearness
from vioapr.fusion.consensus.rotation import fit_rotation
from vioapr.fusion.consensus.tracker import new_tracker
from vioapr.fusion.consensus.views import negative_half_gaps, view_exponents, view_shares
from vioapr.fusion.consensus.votes import RECENT, empty_votes, new_vote
from vioapr.fusion.types import FrameInput
from vioapr.geometry import frames, quaternion
from vioapr.geometry.rigid import Rigid3

PARAMS = ConsensusParams()
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
ZERO = np.asarray(0.0)


def column_at(position, quat=IDENTITY):
    return columns.column(Rigid3(np.asarray(position, float), np.asarray(quat, float)))


def votes_at(positions, predictions, quats=None):
    """Votes of cameras at places, in a tracking world that is the map; the first is newest."""
    count = len(positions)
    turns = np.tile(IDENTITY, (count, 1)) if quats is None else quats
    votes = empty_votes((), count, ZERO)
    for row in reversed(range(count)):
        vote = new_vote(
            column_at(predictions[row], turns[row]),
            column_at(positions[row]),
            np.zeros((3, 1)),
            np.ones((2, 1)),
        )
        votes = votes.add(vote, np.array([[True]]))
    return votes


def number(value):
    return np.full((1, 1), float(value))


def shares_of(votes):
    return view_shares(PARAMS, votes, number(1.0))


def fit(votes, shares):
    count = shares.shape[-1]
    typical, doubting = (typical_of(counts) for counts in (shares * 0 + 1, newest(shares) * 0 + 1))
    ballots = [
        Ballot(votes, shares, np.ones((rows, count)), typical, doubting, number(s), number(s))
        for rows, s in ((2, 0.05), (1, 0.5))
    ]
    rotation, _ = fit_rotation(PARAMS, ballots[0])
    matrix = columns.rotation_matrix(rotation.mean)
    place = votes.vio_place_m[..., :1]
    return rotation, fit_position(PARAMS, ballots[1], matrix, place, rotation)


def test_columns_agree_with_quaternions_and_frames(rng):
    quats = quaternion.normalize(rng.standard_normal((2, 5, 4)))
    left, right = (Rigid3(rng.standard_normal((5, 3)), q) for q in quats)
    turned = columns.z_up_column(left)
    np.testing.assert_allclose(turned[..., 0], np.concatenate(frames.z_up_from_y_up(left), -1))
    a, b = (pose.quat_xyzw[..., None] for pose in (left, right))
    np.testing.assert_allclose(columns.product(a, b)[..., 0], quaternion.multiply(*quats))
    np.testing.assert_allclose(columns.rotation_matrix(a), quaternion.to_matrix(quats[0]))
    quarter = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    y_up = columns.y_up_turn(a)[..., 0]
    np.testing.assert_allclose(y_up, quaternion.multiply(quats[0], quarter))
    compared = columns.compare(columns.column(left), columns.column(right))[..., 0]
    expected = quaternion.multiply(quats[0], quaternion.inverse(quats[1]))
    np.testing.assert_allclose(compared[:, :4], expected, atol=1e-12)
    for start, quat in ((4, quats[0]), (7, quats[1])):
        forward = quaternion.rotate(quat, np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(compared[:, start : start + 3], forward, atol=1e-12)


def test_views_far_apart_have_a_share_each_and_equal_views_share_one():
    votes = votes_at([[0, 0, 0], [0, 0, 0], [0, 0, 0], [50, 0, 0]], np.zeros((4, 3)))
    np.testing.assert_allclose(shares_of(votes), [[1 / 3, 1 / 3, 1 / 3, 1]], atol=1e-12)


def test_a_vote_that_is_not_there_has_no_share():
    votes = votes_at(np.zeros((3, 3)), np.zeros((3, 3)))
    votes = votes._replace(is_valid=np.array([[1.0, 1, 0]]))
    np.testing.assert_allclose(shares_of(votes), [[0.5, 0.5, 0]])


def test_gaps_between_views_in_metres_and_along_the_unit_sphere():
    places = np.array([[0.0, 3.0], [0.0, 4.0], [0.0, 0.0]])
    gazes = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])  # a quarter turn: chord^2 is 2
    exponents = view_exponents(places, gazes, number(5.0), 2.0)
    np.testing.assert_allclose(-2 * exponents, [[0, 1.5], [1.5, 0]], atol=1e-12)


def test_gaps_of_points(rng):
    points = rng.standard_normal((3, 5))
    gaps = ((points[:, :, None] - points[:, None]) ** 2).sum(axis=0)
    np.testing.assert_allclose(negative_half_gaps(points), -gaps / 2, atol=1e-12)


def test_the_median_is_of_the_values_that_count():
    counts = np.array([[1.0, 0, 1, 1, 1, 0], [1.0, 1, 1, 1, 1, 1]])
    values = np.array([[5.0, -100, 1, 9, 3, 100]])
    typical = typical_of(counts)
    assert typical.row(0).median(values) == 3  # the lower one of 1, 3, 5, 9
    assert typical.row(1).median(values) == 3
    np.testing.assert_array_equal(typical.is_few, [[True], [False]])


def test_the_position_is_where_most_votes_agree():
    positions = np.array([[x, 0.0, 0.0] for x in range(9)])
    predictions = positions + np.array([1.0, 2.0, 3.0])
    predictions[6:] += [40.0, 0.0, 0.0]
    rotation, position = fit(votes_at(positions, predictions), np.ones((1, 9)))
    np.testing.assert_allclose(position.mean[:, 0], [1, 2, 3], atol=1e-2)
    np.testing.assert_allclose(rotation.mean[:, 0], IDENTITY, atol=1e-9)
    assert (position.excess[:, 6:] > 100).all()
    assert (position.excess[:, :6] == 0).all()


def test_the_rotation_is_where_most_votes_agree():
    turns = quaternion.from_rotvec(np.array([[0, 0, 0.2]] * 6 + [[0, 0, -1.0]] * 3))
    positions = np.array([[x, 0.0, 0.0] for x in range(9)])
    rotation, _ = fit(votes_at(positions, positions, turns), np.ones((1, 9)))
    np.testing.assert_allclose(quaternion.to_rotvec(rotation.mean[:, 0]), [0, 0, 0.2], atol=2e-3)
    np.testing.assert_allclose(rotation.mean.T @ rotation.mean, 1, atol=1e-12)


def test_regressors_that_err_about_what_they_look_at_are_corrected(rng):
    """Errors that keep a point 4 m ahead in place: the pivot's depth is found, and the truth."""
    turns = quaternion.from_rotvec(rng.normal(0, 0.05, (20, 3)) * [1, 1, 0])
    ahead = np.array([0.0, 0.0, 4.0])
    positions = np.array([[3.0 * x, 0.0, 0.0] for x in range(20)])
    predictions = positions + ahead - quaternion.rotate(turns, ahead)
    _, corrected = fit(votes_at(positions, predictions, turns), np.ones((1, 20)))
    raw = np.abs(predictions - positions)[:, :2].mean()
    assert np.abs(corrected.mean).max() < 0.2 * raw


def samples_of(values, exponents, ages, is_valid=None):
    count = values.shape[-1]
    nothing = np.zeros((1, count))
    valid = nothing + 1 if is_valid is None else is_valid
    return Samples(values, valid, exponents, ages, nothing, nothing)


@pytest.mark.parametrize("true_index", [1, 3])
def test_the_drift_that_the_samples_have_is_found(rng, true_index):
    age = np.arange(40.0)[None]
    rate = CORRELATED_PART * 10.0 ** LOG10_RATES[true_index]
    exponents = -0.5 * (100 * (age.T - age)) ** 2
    scores = 0
    for _ in range(20):
        drift = np.cumsum(rng.standard_normal((6, 40)) * np.sqrt(rate), axis=-1)
        values = 0.3 * (drift + rng.standard_normal((6, 40)))
        evidence = weigh_drifts(samples_of(values, exponents, age), np.full((3, 1), 0.3))
        scores = scores + evidence.log_likelihood
        variance = evidence.variance[:, true_index]
        assert ((np.sqrt(variance) > 0.1) & (np.sqrt(variance) < 0.6)).all()
    assert (np.abs(np.argmax(scores, axis=-1) - true_index) <= 1).all()


def test_samples_that_are_not_there_change_nothing(rng):
    values, age = rng.standard_normal((6, 12)), np.arange(12.0)[None]
    exponents = -0.5 * (age.T - age) ** 2

    def score(count, total):
        valid = (np.arange(total) < count).astype(float)[None]
        part = samples_of(values[:, :total], exponents[:total, :total], age[:, :total], valid)
        return weigh_drifts(part, np.ones((3, 1)))

    for full, short in zip(score(8, 12), score(8, 8), strict=True):
        np.testing.assert_allclose(full, short, atol=1e-9)


def test_the_newest_votes_stay_and_older_ones_only_if_asked():
    votes = empty_votes((), 6, ZERO)
    for count in range(8):
        pose = column_at([count, 0.0, 0.0])
        vote = new_vote(pose, pose, np.zeros((3, 1)), np.ones((2, 1)))
        votes = votes.add(vote, np.array([[count % 2 == 0]]))
    np.testing.assert_array_equal(votes.vio_place_m[0, :RECENT], [7, 6, 5])
    # When 4 and 6 came, the oldest of the recent ones were 1 and 3.
    np.testing.assert_array_equal(votes.place_m[0, RECENT : RECENT + 2], [3, 1])


def test_a_view_is_new_if_the_camera_moved_or_turned_but_not_if_it_rolled():
    def is_novel(position, rotvec):
        """Of the third newest vote, beside the one before."""
        poses = [column_at([0, 0, 0])] * 6
        poses[2] = column_at(position, quaternion.from_rotvec(np.asarray(rotvec, float)))
        votes = empty_votes((), 6, ZERO)
        for pose in reversed(poses):
            vote = new_vote(pose, pose, np.zeros((3, 1)), np.ones((2, 1)))
            votes = votes.add(vote, np.array([[True]]))
        return votes.is_novel(number(1.0), 0.26, 0.8).item()

    assert is_novel([0.9, 0, 0], [0, 0, 0])
    assert is_novel([0, 0, 0], [0, 0.3, 0])
    assert not is_novel([0, 0, 0], [0, 0, 0.3])
    assert not is_novel([0.5, 0, 0], [0, 0, 0])


def follow(*steps, seconds=0.5):
    """A tracker that starts at the identity and makes steps, in m along x and rad about y."""
    tracker = new_tracker((), ZERO)
    place, turn = 0.0, 0.0
    yes, no = np.asarray(True), np.asarray(False)
    for index, (distance, angle) in enumerate([(0.0, 0.0), *steps]):
        place, turn = place + distance, turn + angle
        quat = quaternion.from_rotvec(np.array([0.0, turn, 0.0]))
        vio = Rigid3(np.array([place, 0.0, 0.0]), quat)
        frame = FrameInput(np.asarray(index * seconds), vio, yes, vio, yes, no)
        tracker, _ = tracker.follow(frame, columns.column(vio))
    return tracker


def test_a_step_that_nobody_makes_is_a_jump():
    moved, jumps_rad2, jumps_m2 = follow((1.0, 0.0)).odometer[:, 0]
    np.testing.assert_allclose(moved, 1 + 0.01 * 0.5)
    assert jumps_rad2 == jumps_m2 == 0
    _, jumps_rad2, jumps_m2 = follow((5.0, 0.1)).odometer[:, 0]
    np.testing.assert_allclose([jumps_m2, jumps_rad2], [25, 0.01])


def test_the_odometer_counts_turns_and_takes_the_shorter_way_round():
    np.testing.assert_allclose(follow((0.0, 0.4)).odometer[0], 0.3 * 0.4 + 0.01 * 0.5)
    nearly_round = follow((0.0, 2.5), (0.0, 2.5), seconds=1.0)  # quaternions change their sign
    np.testing.assert_allclose(nearly_round.odometer[0], 2 * (0.3 * 2.5 + 0.01), rtol=1e-6)


def test_the_usual_speed_follows_slowly_and_not_at_all_without_time():
    np.testing.assert_allclose(follow((1.0, 0.0)).speed_m_s, 0.9 * 1 + 0.1 * 2)
    np.testing.assert_allclose(follow().speed_m_s, 1.0)


def test_pairs_in_single_precision_keep_their_digits():
    # Graphs on phones compute so: what cancels would let them start from other votes.
    rng = np.random.default_rng(0)
    points = (np.array([[60.0], [20.0], [1.0]]) + 0.02 * rng.normal(size=(3, 28))).astype("f4")
    exact = negative_half_gaps(points.astype(float))
    assert negative_half_gaps(points).dtype == np.float32
    np.testing.assert_allclose(negative_half_gaps(points), exact, rtol=1e-5)
    quats = quaternion.from_rotvec([1.0, 0.5, 2.0] + 0.02 * rng.normal(size=(28, 3)))
    signs = rng.choice([-1.0, 1.0], size=28)  # both mean the same rotation
    rotations, scale = (quats * signs[:, None]).T, number(0.01)
    exact = rotation_nearness(rotations, scale)
    found = rotation_nearness(rotations.astype("f4"), scale.astype("f4"))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact, rtol=1e-4)
