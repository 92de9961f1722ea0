"""The sigmas that chain states are those of its true errors, over many simulated walks.

They are scales of Student's t with two degrees of freedom (docs/results/accuracy.md, Calibration).
The band is as wide as it may be for sigmas that are off by a factor of two to fall outside of it,
whichever way, wherever in the band the right ones lie.
"""

import numpy as np
import pytest
from scipy import stats
from tests.helpers import frames_of

from vioapr.fusion.chain import method as chain
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.offline import run_steps, stack_walks
from vioapr.fusion.pairing import PairedFrames
from vioapr.geometry import quaternion, rigid
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.trackers import TrackerErrors
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow

WALKS = 32
SETTLED = 20
"""Frames after which a walk is counted: in the first ones the noise is not yet known."""

LOWEST, HIGHEST = np.sqrt(0.5), np.sqrt(2)
DEGREES = 2
SETTINGS = {
    "typical": WalkParams(),
    "poor regressor": WalkParams(
        regressor=RegressorErrors(bias_m=2.0, bias_deg=6.0, noise_m=0.6, noise_deg=2.0)
    ),
    "many look-alikes": WalkParams(regressor=RegressorErrors(lookalike_share=0.2)),
    "poor tracker": WalkParams(tracker=TrackerErrors(step_noise_m=0.1)),
}


CAUTION = 0.45
"""Without a calibration, sigmas are a compromise between sets of real walks; on these simulated
ones they are too large, by less than this."""


def run_walks(params, first_seed, chain_params=None):
    """Estimates and true poses, shape (frames, walks)."""
    walks = [simulate_walk(params, seed) for seed in range(first_seed, first_seed + WALKS)]
    frames = stack_walks([PairedFrames(frames_of(walk)) for walk in walks])
    gt = rigid.stack([walk.gt.target_from_source for walk in walks], axis=1)
    return run_steps(chain.METHOD, chain_params or ChainParams(), frames), gt


@pytest.fixture(scope="module", params=SETTINGS)
def setting(request):
    """Walks with and without factors that other walks of the setting have given."""
    params = SETTINGS[request.param]
    estimates, gt = run_walks(params, 0)
    calibrated = ChainParams(
        sigma_position_factor=position_ratio(estimates, gt),
        sigma_orientation_factor=heading_ratio(estimates, gt),
    )
    return run_walks(params, WALKS, calibrated), (estimates, gt)


def typical_ratio(errors, sigmas, promised):
    """The median error in sigmas, over the median that the stated distribution has."""
    return float(np.nanmedian(errors[SETTLED:] / sigmas[SETTLED:])) / promised


def assert_calibrated(ratio_of, setting):
    (estimates, gt), uncalibrated = setting
    assert LOWEST < ratio_of(estimates, gt) < HIGHEST
    for factor in (0.5, 2.0):  # the test can tell
        assert not LOWEST < ratio_of(estimates, gt) / factor < HIGHEST
    assert CAUTION < ratio_of(*uncalibrated) < HIGHEST


def position_ratio(estimates, gt):
    errors = rigid.distance_m(gt, estimates.world_from_cam)
    median = np.sqrt(3 * stats.f(3, DEGREES).ppf(0.5))  # of a vector of three components
    return typical_ratio(errors, estimates.sigma_position_m, median)


def horizontal_ratio(estimates, gt):
    errors = np.abs(estimates.world_from_cam.translation_m - gt.translation_m)
    sigmas = estimates.sigma_position_axes_m
    return typical_ratio(errors[..., :2], sigmas[..., :2], stats.t(DEGREES).ppf(0.75))


def heading_ratio(estimates, gt):
    turn = quaternion.multiply(estimates.world_from_cam.quat_xyzw, quaternion.inverse(gt.quat_xyzw))
    errors_deg = np.abs(np.rad2deg(quaternion.to_rotvec(turn)[..., 2]))
    sigmas_deg = estimates.sigma_orientation_axes_deg[..., 2]
    return typical_ratio(errors_deg, sigmas_deg, stats.t(DEGREES).ppf(0.75))


def test_position_sigmas_are_the_errors_scale(setting):
    assert_calibrated(position_ratio, setting)


def test_horizontal_sigmas_are_the_errors_scale(setting):
    assert_calibrated(horizontal_ratio, setting)


def test_heading_sigmas_are_the_errors_scale(setting):
    """The simulated trackers know gravity exactly, so heading is the only angle that errs."""
    assert_calibrated(heading_ratio, setting)
