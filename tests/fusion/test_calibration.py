"""The sigmas that consensus states are those of its true errors, over many simulated walks.

They are scales of Student's t with two degrees of freedom (docs/results/accuracy.md, Calibration).
The band is as wide as it may be for sigmas that are off by a factor of two to fall outside of it,
whichever way, wherever in the band the right ones lie.
"""

import numpy as np
import pytest
from scipy import stats
from tests.helpers import frames_of

from vioapr.fusion.consensus import method as consensus
from vioapr.fusion.consensus.params import ConsensusParams
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


def run_walks(params):
    """Estimates and true poses, shape (frames, walks)."""
    walks = [simulate_walk(params, seed) for seed in range(WALKS)]
    frames = stack_walks([PairedFrames(frames_of(walk)) for walk in walks])
    gt = rigid.stack([walk.gt.target_from_source for walk in walks], axis=1)
    return run_steps(consensus.METHOD, ConsensusParams(), frames), gt


@pytest.fixture(scope="module", params=SETTINGS)
def setting(request):
    return run_walks(SETTINGS[request.param])


def typical_ratio(errors, sigmas, promised):
    """The median error in sigmas, over the median that the stated distribution has."""
    return float(np.median(errors[SETTLED:] / sigmas[SETTLED:])) / promised


def assert_calibrated(errors, sigmas, promised):
    assert LOWEST < typical_ratio(errors, sigmas, promised) < HIGHEST
    for factor in (0.5, 2.0):  # the test can tell
        off = typical_ratio(errors, factor * sigmas, promised)
        assert not LOWEST < off < HIGHEST


def test_position_sigmas_are_the_errors_scale(setting):
    estimates, gt = setting
    errors = rigid.distance_m(gt, estimates.world_from_cam)
    median = np.sqrt(3 * stats.f(3, DEGREES).ppf(0.5))  # of a vector of three components
    assert_calibrated(errors, estimates.sigma_position_m, median)


def test_horizontal_sigmas_are_the_errors_scale(setting):
    estimates, gt = setting
    errors = np.abs(estimates.world_from_cam.translation_m - gt.translation_m)
    sigmas = estimates.sigma_position_axes_m
    assert_calibrated(errors[..., :2], sigmas[..., :2], stats.t(DEGREES).ppf(0.75))


def test_heading_sigmas_are_the_errors_scale(setting):
    """The simulated trackers know gravity exactly, so heading is the only angle that errs."""
    estimates, gt = setting
    turn = quaternion.multiply(estimates.world_from_cam.quat_xyzw, quaternion.inverse(gt.quat_xyzw))
    errors_deg = np.abs(np.rad2deg(quaternion.to_rotvec(turn)[..., 2]))
    sigmas_deg = estimates.sigma_orientation_axes_deg[..., 2]
    assert_calibrated(errors_deg, sigmas_deg, stats.t(DEGREES).ppf(0.75))
