"""What is measured on simulated walks is what they were drawn with."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from tests.helpers import frames_of

from vioapr.errors import ParameterError
from vioapr.evaluation.calibration.calibrate import calibrate
from vioapr.evaluation.calibration.choice import UNCALIBRATED
from vioapr.evaluation.calibration.regressor import look_at_m, measure_regressor, view_length_m
from vioapr.evaluation.calibration.sigmas import PROMISED, coverage_of, fit_factor
from vioapr.evaluation.calibration.thinning import thin
from vioapr.evaluation.calibration.tracker import measure_tracker, measure_walk, read_odometer
from vioapr.evaluation.calibration.trials import Trials, judge, mean_ratios
from vioapr.evaluation.cases import Case
from vioapr.fusion.calibrated import params_from_calibration
from vioapr.fusion.chain.method import METHOD
from vioapr.fusion.offline import run_steps
from vioapr.fusion.pairing import PairedFrames
from vioapr.geometry import quaternion
from vioapr.geometry.frames import y_up_from_z_up, z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.calibration import ChainSetting
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.trackers import TrackerErrors
from vioapr.simulation.walks import WalkParams, simulate_walk


def case_of(params, seed, vio="sim"):
    walk = simulate_walk(params, seed)
    frames = PairedFrames(frames_of(walk))
    return Case("Set", f"walk-{seed}", vio, "net", frames, walk.gt.target_from_source)


def with_vio(case, vio_from_cam):
    inputs = case.frames.inputs._replace(vio_from_cam=vio_from_cam)
    return dataclasses.replace(case, frames=PairedFrames(inputs))


def metres_per_second(case):
    metres, _ = read_odometer(case)
    return metres[-1] / np.ptp(case.frames.timestamp_s)


@pytest.fixture(scope="module")
def drifting():
    errors = TrackerErrors(heading_drift_deg=1.0, scale_error=0.0, step_noise_m=0.05)
    return [case_of(WalkParams(tracker=errors), seed) for seed in range(4)]


@pytest.mark.parametrize("heading_drift_deg", [0.3, 2.0])
def test_the_headings_drift_is_found(heading_drift_deg):
    errors = TrackerErrors(heading_drift_deg, scale_error=0.0)
    cases = [case_of(WalkParams(tracker=errors), seed) for seed in range(4)]
    drift = measure_tracker(cases)
    true = np.deg2rad(heading_drift_deg) ** 2 / np.mean([metres_per_second(c) for c in cases])
    assert true / 2 < drift.heading_rad2_per_m < 2 * true
    assert drift.tilt_rad2_per_m < true / 100
    assert drift.shares_up


@pytest.mark.parametrize("step_noise_m", [0.02, 0.2])
def test_the_positions_drift_is_found(step_noise_m):
    errors = TrackerErrors(0.0, 0.0, step_noise_m)
    cases = [case_of(WalkParams(tracker=errors), seed) for seed in range(4)]
    drift = measure_tracker(cases)
    true = step_noise_m**2 / np.mean([metres_per_second(c) for c in cases])
    assert true / 2 < drift.position_m2_per_m < 2 * true


def test_the_scale_is_found_and_is_no_drift():
    case = case_of(WalkParams(tracker=TrackerErrors(0.0, 0.0, 0.001)), 1)
    plain = measure_tracker([case])
    vio = case.frames.inputs.vio_from_cam
    shrunk = measure_tracker([with_vio(case, Rigid3(0.8 * vio.translation_m, vio.quat_xyzw))])
    assert shrunk.scale == pytest.approx(1.25, rel=0.02)
    assert plain.scale == pytest.approx(1.0, rel=0.02)
    assert shrunk.position_m2_per_m < 4 * plain.position_m2_per_m


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, 90.0])
def test_whether_map_and_tracker_share_up_is_found(drifting, tilt_deg):
    turn = Rigid3(np.zeros(3), quaternion.from_rotvec(np.deg2rad([tilt_deg, 0.0, 0.0])))
    vio = z_up_from_y_up(drifting[0].frames.inputs.vio_from_cam)
    drift = measure_tracker([with_vio(drifting[0], y_up_from_z_up(turn @ vio))])
    assert drift.tilt_deg == pytest.approx(tilt_deg, abs=0.5)
    assert drift.shares_up == (tilt_deg == 0)


def test_no_stretch_spans_a_new_tracking_world(drifting):
    case = drifting[0]
    inputs = case.frames.inputs
    later = np.arange(len(case.frames)) >= len(case.frames) // 2
    turn = Rigid3(np.array([50.0, 0.0, 0.0]), quaternion.from_rotvec(np.array([0.0, 2.0, 0.0])))
    moved = turn @ inputs.vio_from_cam
    vio = Rigid3(
        *(np.where(later[:, None], b, a) for a, b in zip(inputs.vio_from_cam, moved, strict=True))
    )
    reset = np.zeros(len(later), dtype=bool)
    reset[np.argmax(later)] = True
    broken = with_vio(case, vio)
    told = dataclasses.replace(
        broken, frames=PairedFrames(broken.frames.inputs._replace(tracking_reset=reset))
    )
    plain = measure_walk(case).rates
    np.testing.assert_allclose(measure_walk(told).rates, plain, rtol=0.3, atol=1e-12)


def test_walks_that_are_too_short_are_refused():
    short = case_of(WalkParams(duration_s=3.0), 1)
    assert measure_tracker([short]) is None
    still = case_of(WalkParams(duration_s=10.0, speed_m_s=0.01), 1)
    with pytest.raises(ParameterError, match="walk-1: expected walks of at least 4 m"):
        calibrate([still])
    with pytest.raises(ParameterError, match="at least 10 frames that have both a prediction"):
        calibrate([short])
    with pytest.raises(ParameterError, match="at least one walk"):
        calibrate([])


def test_the_regressors_noise_is_found():
    errors = RegressorErrors(0.0, 0.0, 0.3, 1.0, 0.0)
    found = measure_regressor([case_of(WalkParams(regressor=errors), seed) for seed in range(3)])
    assert all(0.15 < axis < 0.6 for axis in found.position_axes_m)
    assert all(0.5 < np.rad2deg(axis) < 2 for axis in found.orientation_axes_rad)
    assert found.position_tail > 2  # it is heavy-tailed


def test_view_length_and_look_at_depth_are_found():
    rng = np.random.default_rng(0)
    along = np.linspace(0, 60, 400)
    gt = Rigid3(np.outer(along, [1.0, 0, 0]), np.tile([0.0, 0, 0, 1], (400, 1)))
    # Errors that are made of bumps 4 m wide.
    centres = rng.uniform(-10, 70, 300)
    bumps = np.exp(-0.5 * ((along[:, None] - centres) / 4.0) ** 2)
    wrong_m = bumps @ rng.normal(size=(300, 3)) * 0.1
    apr = Rigid3(gt.translation_m + wrong_m, gt.quat_xyzw)
    assert 2.0 < view_length_m([(gt, apr)]) < 12.0
    turns = quaternion.from_rotvec(rng.normal(size=(400, 3)) * 0.05)
    gaze = quaternion.rotate(turns, np.array([0.0, 0, 1]))
    swung = Rigid3(gt.translation_m - 7.0 * (gaze - [0, 0, 1.0]), turns)
    assert look_at_m(gt, swung) == pytest.approx(7.0, rel=0.01)
    assert look_at_m(gt, gt) == 0.0


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_the_factor_makes_sigmas_true(factor):
    rng = np.random.default_rng(1)
    scales = np.sqrt(1 / rng.gamma(1.0, 1.0, size=(4, 3000, 1)))  # Student's t of 2 degrees
    in_sigmas = factor * np.linalg.norm(scales * rng.normal(size=(4, 3000, 3)), axis=-1)
    fitted = fit_factor(list(in_sigmas))
    assert fitted == pytest.approx(factor, rel=0.1)
    np.testing.assert_allclose(coverage_of(list(in_sigmas / fitted)), PROMISED, atol=0.02)
    np.testing.assert_allclose(PROMISED, stats.f(3, 2).cdf(np.array([1, 4, 9]) / 3))


def test_without_answers_the_factor_is_one():
    assert fit_factor([np.full(5, np.nan)]) == 1.0


def test_walks_together_are_run_as_each_alone(drifting):
    setting = ChainSetting("known", 1e-6, 1e-4, 1e-3, 0.02)
    trials = Trials()
    trials.run("", [(case, s) for case in drifting[:2] for s in (setting, UNCALIBRATED)])
    for given in (setting, UNCALIBRATED):
        alone = run_steps(METHOD, params_from_calibration(given), drifting[1].frames.inputs)
        expected = judge(drifting[1], alone)
        np.testing.assert_allclose(
            trials.of(drifting[1], given).errors.position_m, expected.errors.position_m, rtol=1e-6
        )


def test_what_is_not_answered_counts_as_the_raw_prediction(drifting):
    case = drifting[0]
    estimates = run_steps(METHOD, METHOD.params_type(), case.frames.inputs)
    nowhere = estimates._replace(
        world_from_cam=Rigid3(*(np.full_like(part, np.nan) for part in estimates.world_from_cam))
    )
    trial = judge(case, nowhere)
    np.testing.assert_array_equal(trial.errors.position_m, trial.raw.position_m)
    np.testing.assert_allclose(mean_ratios([trial]), 1.0)


def test_long_walks_are_thinned_and_keep_losses(drifting):
    case = drifting[0]
    assert thin(case, most=len(case.frames)) is case
    count = len(case.frames)
    ok, reset, has_apr = np.ones(count, bool), np.zeros(count, bool), np.arange(count) % 3 == 0
    ok[100], reset[200] = False, True
    inputs = case.frames.inputs._replace(tracking_ok=ok, tracking_reset=reset, has_apr=has_apr)
    names = tuple(map(str, range(count)))
    told = dataclasses.replace(case, frames=PairedFrames(inputs, names))
    thinned = thin(told, most=50)
    kept = np.array(list(map(int, thinned.frames.names)))
    assert set(kept) == {*range(0, count, 9), 100, 200}
    np.testing.assert_array_equal(thinned.frames.timestamp_s, case.frames.timestamp_s[kept])
    np.testing.assert_array_equal(
        thinned.gt_world_from_cam.translation_m, case.gt_world_from_cam.translation_m[kept]
    )


@pytest.fixture(scope="module")
def minutes():
    """Walks of a minute."""
    errors = TrackerErrors(heading_drift_deg=1.0, scale_error=0.0, step_noise_m=0.05)
    return [case_of(WalkParams(duration_s=60.0, tracker=errors), seed) for seed in range(3)]


@pytest.fixture(scope="module")
def calibration(minutes):
    return calibrate(minutes)


def test_a_calibration_gains_on_walks_left_out(calibration):
    (pair,) = calibration.pairs
    assert (pair.tracker, pair.regressor) == ("sim", "net")
    assert pair.made_from.walks == ("Set/walk-0", "Set/walk-1", "Set/walk-2")
    assert 3 * 40 < pair.made_from.metres < 3 * 100
    assert pair.made_from.frames == 3 * 120
    assert pair.left_out.walks == 3
    own, other = pair.left_out.calibrated, pair.left_out.uncalibrated
    assert own.median_m < 0.8
    assert own.median_m * own.median_deg < 1.1 * other.median_m * other.median_deg
    assert abs(pair.left_out.position.two - PROMISED[1]) < 0.2


def test_one_walk_is_enough(minutes):
    others = [dataclasses.replace(case, vio="other7") for case in minutes[:1]]
    pairs = calibrate([*minutes[:1], *others]).pairs
    assert [(pair.tracker, pair.regressor) for pair in pairs] == [("sim", "net"), ("other", "net")]
    for pair in pairs:
        assert pair.left_out is None
        assert pair.setting.gravity != "none"
        assert pair.setting == pairs[0].setting


def test_walks_that_mislead_each_other_leave_drift_to_be_learned(minutes):
    lost = TrackerErrors(heading_drift_deg=40.0, scale_error=0.0, step_noise_m=2.0)
    bad = case_of(WalkParams(duration_s=60.0, tracker=lost), 7)
    good = case_of(WalkParams(duration_s=60.0, tracker=TrackerErrors(0.05, 0.0, 0.002)), 8)
    (pair,) = calibrate([good, bad]).pairs
    assert pair.setting.position_drift_m2_per_m == -1
    assert pair.left_out.calibrated == pair.left_out.uncalibrated
    assert pair.setting.sigma_position_factor != 1
