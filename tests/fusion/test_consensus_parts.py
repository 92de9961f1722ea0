"""The parts of method `consensus`, each against what can be worked out by hand."""

import numpy as np
import pytest

from vioapr.fusion.consensus.drift import CORRELATED_PART, LOG10_RATES, Channel, weigh_drifts
from vioapr.fusion.consensus.fit import fit_position, fit_rotation, view_shares
from vioapr.fusion.consensus.params import ConsensusParams
from vioapr.fusion.consensus.votes import (
    RECENT,
    Odometer,
    ViewGaps,
    empty_votes,
    usual_speed,
    view_gaps,
    view_gaps_within,
    viewing_direction,
)
from vioapr.fusion.types import FrameInput
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

PARAMS = ConsensusParams()
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
ZERO = np.asarray(0.0)


def votes_at(positions, predictions, quats=None):
    """Votes of cameras at places, in a tracking world that is the map."""
    positions, predictions = np.asarray(positions, float), np.asarray(predictions, float)
    turns = np.tile(IDENTITY, (len(positions), 1)) if quats is None else quats
    votes = empty_votes((), len(positions), ZERO)
    return votes._replace(
        apr_world_from_cam=Rigid3(predictions, turns),
        vio_from_cam=Rigid3(positions, np.tile(IDENTITY, (len(positions), 1))),
        is_valid=np.ones(len(positions)),
    )


def no_age(count):
    return Odometer(*(np.zeros(count) for _ in range(3)))


def shares_of(votes):
    directions = viewing_direction(votes.vio_from_cam)
    gaps = view_gaps_within(votes.vio_from_cam.translation_m, directions)
    return view_shares(PARAMS, votes.is_valid, gaps, np.asarray(1.0), 0.3)


def fit(votes, shares):
    count = len(shares)
    rotation = fit_rotation(
        PARAMS, votes, no_age(count), shares, (ZERO, ZERO), np.asarray(0.05), np.asarray(0.05)
    )
    newest = votes.vio_from_cam.at(0)
    directions, half = viewing_direction(votes.vio_from_cam), np.asarray(0.5)
    position = fit_position(
        PARAMS, votes, directions, newest, no_age(count), shares, ZERO, rotation, half, half
    )
    return rotation, position


def test_views_far_apart_have_a_share_each_and_equal_views_share_one():
    votes = votes_at([[0, 0, 0], [0, 0, 0], [0, 0, 0], [50, 0, 0]], np.zeros((4, 3)))
    shares = shares_of(votes)
    np.testing.assert_allclose(shares, [1 / 3, 1 / 3, 1 / 3, 1], atol=1e-12)


def test_a_vote_that_is_not_there_has_no_share():
    votes = votes_at(np.zeros((3, 3)), np.zeros((3, 3)))._replace(is_valid=np.array([1.0, 1, 0]))
    np.testing.assert_allclose(shares_of(votes), [0.5, 0.5, 0])


def test_gaps_between_views_in_metres_and_along_the_unit_sphere():
    quarter = quaternion.from_rotvec(np.array([0.0, np.pi / 2, 0.0]))
    gaps = view_gaps(Rigid3(np.zeros(3), IDENTITY), Rigid3(np.array([3.0, 4.0, 0.0]), quarter))
    np.testing.assert_allclose([gaps.distance_m2, gaps.chord2], [25, 2])
    np.testing.assert_allclose(gaps.normalized(5.0, 2.0), 1 + 0.5)


def test_rolling_the_camera_does_not_change_the_view():
    roll = quaternion.from_rotvec(np.array([0.0, 0.0, 1.0]))
    gaps = view_gaps(Rigid3(np.zeros(3), IDENTITY), Rigid3(np.zeros(3), roll))
    np.testing.assert_allclose(gaps.chord2, 0, atol=1e-15)


def test_the_position_is_where_most_votes_agree():
    positions = np.array([[x, 0.0, 0.0] for x in range(9)])
    predictions = positions + np.array([1.0, 2.0, 3.0])
    predictions[6:] += [40.0, 0.0, 0.0]
    rotation, position = fit(votes_at(positions, predictions), np.ones(9))
    np.testing.assert_allclose(position.mean, [1, 2, 3], atol=1e-2)
    np.testing.assert_allclose(rotation.mean, IDENTITY, atol=1e-9)
    assert (position.excess[6:] > 100).all()
    assert (position.excess[:6] == 0).all()


def test_regressors_that_err_about_what_they_look_at_are_corrected(rng):
    """Errors that keep a point 4 m ahead in place: the pivot's depth is found, and the truth."""
    turns = quaternion.from_rotvec(rng.normal(0, 0.05, (20, 3)) * [1, 1, 0])
    ahead = np.array([0.0, 0.0, 4.0])
    positions = np.array([[3.0 * x, 0.0, 0.0] for x in range(20)])
    predictions = positions + ahead - quaternion.rotate(turns, ahead)
    votes = votes_at(positions, predictions, turns)
    _, corrected = fit(votes, np.ones(20))
    raw = np.abs(predictions - positions)[:, :2].mean()
    assert np.abs(corrected.mean).max() < 0.2 * raw


@pytest.mark.parametrize("true_index", [1, 3])
def test_the_drift_that_the_samples_have_is_found(rng, true_index):
    age = np.arange(40.0)
    rate = CORRELATED_PART * 10.0 ** LOG10_RATES[true_index]
    gaps = ViewGaps((100 * (age[:, None] - age[None])) ** 2, np.zeros((40, 40)))
    scores = 0
    for _ in range(20):
        drift = np.cumsum(rng.standard_normal((40, 3)) * np.sqrt(rate), axis=0)
        samples = 0.3 * (drift + rng.standard_normal((40, 3)))
        (evidence,) = weigh_drifts(
            samples, np.ones(40), gaps, np.asarray(1.0), age, np.zeros(40), np.zeros(40),
            [Channel(slice(0, 3), np.asarray(0.3))],
        )  # fmt: skip
        scores = scores + evidence.log_likelihood
        assert 0.1 < np.sqrt(evidence.variance[true_index]) < 0.6
    assert abs(int(np.argmax(scores)) - true_index) <= 1


def test_samples_that_are_not_there_change_nothing(rng):
    samples, age = rng.standard_normal((12, 2)), np.arange(12.0)
    gaps = ViewGaps((age[:, None] - age[None]) ** 2, np.zeros((12, 12)))
    channels = [Channel(slice(0, 2), np.asarray(1.0))]

    def score(count, total):
        valid = (np.arange(total) < count).astype(float)
        part = ViewGaps(gaps.distance_m2[:total, :total], gaps.chord2[:total, :total])
        zeros = np.zeros(total)
        return weigh_drifts(
            samples[:total], valid, part, np.asarray(1.0), age[:total], zeros, zeros, channels
        )[0]

    for full, short in zip(score(8, 12), score(8, 8), strict=True):
        np.testing.assert_allclose(full, short, atol=1e-9)


def test_the_newest_votes_stay_and_older_ones_only_if_asked():
    votes = empty_votes((), 6, ZERO)
    for number in range(8):
        pose = Rigid3(np.array([number, 0.0, 0.0]), IDENTITY)
        frame = FrameInput(ZERO, pose, True, pose, True, False)
        votes = votes.add(frame, Odometer(ZERO, ZERO, ZERO), np.asarray(number % 2 == 0))
    x = votes.vio_from_cam.translation_m[:, 0]
    np.testing.assert_array_equal(x[:RECENT], [7, 6, 5])
    # When 4 and 6 came, the oldest of the recent ones were 1 and 3.
    np.testing.assert_array_equal(x[RECENT : RECENT + 2], [3, 1])


def test_a_step_that_nobody_makes_is_a_jump():
    def after(distance, turn_rad=0.0):
        step = Rigid3(
            np.array([distance, 0.0, 0.0]), quaternion.from_rotvec(np.array([0, turn_rad, 0]))
        )
        return Odometer(ZERO, ZERO, ZERO).advance(np.asarray(0.5), step, np.asarray(1.0))

    assert after(1.0).jumps_m2 == 0
    np.testing.assert_allclose(after(5.0, 0.1).jumps_m2, 25)
    np.testing.assert_allclose(after(5.0, 0.1).jumps_rad2, 0.01)
    np.testing.assert_allclose(after(1.0).motion_m, 1 + 0.01 * 0.5)


def test_the_usual_speed_follows_slowly_and_not_at_all_without_time():
    step = Rigid3(np.array([1.0, 0.0, 0.0]), IDENTITY)
    np.testing.assert_allclose(usual_speed(np.asarray(1.0), np.asarray(0.5), step), 1.1)
    np.testing.assert_allclose(usual_speed(np.asarray(1.0), ZERO, step), 1.0)
