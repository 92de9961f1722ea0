"""Predictions that come late, and localizers that are saved and go on."""

import logging

import numpy as np
import pytest

from vioapr.errors import ParameterError
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.types import LocalizationState, Status
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS
from vioapr.simulation.trackers import NO_TRACKER_ERRORS
from vioapr.simulation.walks import WalkParams, simulate_walk

EXACT = WalkParams(duration_s=20, tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS)


def at(walk, row):
    return (
        float(walk.gt.timestamp_s[row]),
        *(track.target_from_source.at(row) for track in (walk.gt, walk.apr, walk.vio)),
    )


def median_error_m(walk, delay, seed=0):
    """With every fourth frame's prediction, some frames late, out of order."""
    localizer, waiting, errors = Localizer(), [], []
    shuffle = np.random.default_rng(seed)
    for row in range(len(walk.gt)):
        time_s, gt, apr, vio = at(walk, row)
        estimate = localizer.update(time_s, None, vio)
        if row % 4 == 0:
            waiting.append((row + delay + int(shuffle.integers(0, 2)) * (delay > 0), time_s, apr))
        for ready in [one for one in waiting if one[0] <= row][::-1]:
            waiting.remove(ready)
            estimate = localizer.predict(*ready[1:])
        errors.append(float(rigid.distance_m(gt, estimate.world_from_cam)))
    return np.nanmedian(errors[20:])


@pytest.mark.parametrize("method", ["chain", "vio-apr", "apr", "pose-filter"])
def test_a_prediction_for_the_newest_frame_is_as_if_in_time(method):
    walk = simulate_walk(WalkParams(duration_s=15), seed=4)
    in_time, late = Localizer(method), Localizer(method)
    for row in range(len(walk.gt)):
        time_s, _, apr, vio = at(walk, row)
        expected = in_time.update(time_s, apr, vio)
        late.update(time_s, None, vio)
        found = late.predict(time_s, apr)
        np.testing.assert_allclose(
            found.world_from_cam.translation_m, expected.world_from_cam.translation_m, atol=1e-9
        )


def test_exact_predictions_are_exact_however_late():
    walk = simulate_walk(EXACT, seed=1)
    localizer = Localizer()
    for row in range(len(walk.gt)):
        time_s, gt, _, vio = at(walk, row)
        localizer.update(time_s, None, vio)
        if row >= 4:
            between_frames = 0.5 * (walk.gt.timestamp_s[row - 4] + walk.gt.timestamp_s[row - 3])
            assert localizer.predict(between_frames, gt) is None  # frames are 0.5 s apart
            then_s, then, _, _ = at(walk, row - 4)
            estimate = localizer.predict(then_s, then)
            assert rigid.distance_m(gt, estimate.world_from_cam) < 1e-9


@pytest.mark.parametrize("delay", [1, 4])  # frames of 0.5 s
def test_late_predictions_cost_little(delay):
    ratios = []
    for seed in range(6):
        walk = simulate_walk(WalkParams(), seed)
        ratios.append(median_error_m(walk, delay) / median_error_m(walk, 0))
    assert np.exp(np.log(ratios).mean()) < 1.1


def test_predictions_from_before_a_loss_are_dropped_and_that_is_said(caplog):
    walk = simulate_walk(WalkParams(duration_s=20), seed=2)
    localizer = Localizer()
    for row in range(10):
        time_s, _, apr, vio = at(walk, row)
        localizer.update(time_s, apr, None if row == 6 else vio, tracking_reset=row == 8)
    with caplog.at_level(logging.WARNING):
        for row in (5, 6, 7):
            assert localizer.predict(at(walk, row)[0], at(walk, row)[2]) is None
    assert caplog.text.count("is dropped: the tracker's pose of that time is not known") == 3
    assert localizer.predict(at(walk, 8)[0], at(walk, 8)[2]).status == Status.OPTIMIZED
    assert localizer.predict(at(walk, 15)[0], at(walk, 8)[2]) is None  # of the future
    with pytest.raises(ParameterError, match="timestamp_s: expected a finite number"):
        localizer.predict(np.nan, Rigid3.identity())


def test_a_saved_localizer_goes_on_as_if_nothing_had_been():
    walk = simulate_walk(WalkParams(duration_s=40), seed=3)
    localizer, other = Localizer(), None
    for row in range(len(walk.gt)):
        time_s, _, apr, vio = at(walk, row)
        expected = localizer.update(time_s, apr, vio)
        if other is not None:
            found = other.update(time_s, apr, vio)
            for ours, theirs in zip(found.world_from_cam, expected.world_from_cam, strict=True):
                np.testing.assert_array_equal(ours, theirs)
            assert found.localization_state == LocalizationState.LOCALIZED
        if row == 30:
            saved = localizer.save()
            other = Localizer()
            other.restore(saved)
            with pytest.raises(ParameterError, match="timestamp_s: expected a time after"):
                other.update(time_s, apr, vio)
    assert len(saved) < 60_000


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Localizer("vio-apr"), "saved: expected method 'vio-apr', got 'chain'"),
        (lambda: Localizer(params=ChainParams(gravity="known")), "saved: expected params"),
    ],
)
def test_what_was_saved_by_another_localizer_is_refused(make, message):
    with pytest.raises(ParameterError, match=message):
        make().restore(Localizer().save())


@pytest.mark.parametrize("saved", [b"", b"nonsense", b"PK\x03\x04 torn"])
def test_nonsense_is_refused(saved):
    with pytest.raises(ParameterError, match="saved: expected what `save` gave"):
        Localizer().restore(saved)
