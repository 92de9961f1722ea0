"""What regressors state of their errors: it helps where it says something, and never harms."""

import numpy as np
import pytest
from tests.helpers import frames_of

from vioapr.fusion.chain import method as chain
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import fuse_walks, run_steps, stack_walks
from vioapr.fusion.pairing import PairedFrames
from vioapr.geometry import rigid
from vioapr.simulation.walks import WalkParams, simulate_walk

WALKS = 32


@pytest.fixture(scope="module")
def walks():
    return [simulate_walk(WalkParams(), seed) for seed in range(WALKS)]


def errors_of_apr(walk):
    """Per axis, m and rad."""
    gt, apr = walk.gt.target_from_source, walk.apr.target_from_source
    errors = rigid.distance_m(gt, apr), np.deg2rad(rigid.angle_deg(gt, apr))
    return [error / np.sqrt(3) for error in errors]


def fuse(walks, state=None):
    """Median errors over walks, m and deg; `state` gives each walk's sigmas."""
    frames = [frames_of(walk) for walk in walks]
    if state is not None:
        pairs = [state(walk) for walk in walks]
        frames = [
            f._replace(apr_sigma_m=m, apr_sigma_rad=rad)
            for f, (m, rad) in zip(frames, pairs, strict=True)
        ]
    found = run_steps(chain.METHOD, ChainParams(), stack_walks([PairedFrames(f) for f in frames]))
    errors = [
        (rigid.distance_m(gt, pose), rigid.angle_deg(gt, pose))
        for index, walk in enumerate(walks)
        for gt, pose in [
            (walk.gt.target_from_source, found.world_from_cam.at((slice(None), index)))
        ]
    ]
    medians = [[np.median(m), np.median(deg)] for m, deg in errors]
    return np.exp(np.log(medians).mean(axis=0))


@pytest.fixture(scope="module")
def without(walks):
    return fuse(walks)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_informative_sigmas_help_whatever_their_scale(walks, without, rng, scale):
    def state(walk):
        noise = np.exp(0.5 * rng.standard_normal((2, len(walk.gt))))
        m, rad = errors_of_apr(walk)
        return scale * (m + 0.2) * noise[0], scale * (rad + 0.02) * noise[1]

    assert (fuse(walks, state) < 0.98 * without).all()


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.3, 1.0])
def test_uninformative_sigmas_do_no_harm(walks, without, rng, spread):
    def state(walk):
        m, rad = np.exp(spread * rng.standard_normal((2, len(walk.gt))))
        return m, 0.1 * rad

    assert (fuse(walks, state) < 1.03 * without).all()


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf, 0.3])
def test_sigmas_that_are_unknown_or_all_alike_change_nothing(walks, value):
    frames = frames_of(walks[0]).at(slice(0, 60))
    stated = frames._replace(apr_sigma_m=np.full(60, value), apr_sigma_rad=np.full(60, value))
    plain, other = (run_steps(chain.METHOD, ChainParams(), f) for f in (frames, stated))
    np.testing.assert_allclose(
        other.world_from_cam.translation_m, plain.world_from_cam.translation_m, atol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, m in METHODS.items() if m.is_batched and n != "chain"])
def test_other_methods_ignore_them(walks, name):
    frames = frames_of(walks[0]).at(slice(0, 40))
    stated = frames._replace(apr_sigma_m=np.arange(40.0), apr_sigma_rad=np.arange(40.0))
    method = METHODS[name]
    plain, other = (run_steps(method, method.params_type(), f) for f in (frames, stated))
    np.testing.assert_array_equal(
        other.world_from_cam.translation_m, plain.world_from_cam.translation_m
    )


def test_streaming_takes_them_and_equals_the_batch(walks, rng):
    frames = [frames_of(walk).at(slice(0, 50)) for walk in walks[:2]]
    sigmas = rng.uniform(0.1, 2, 50)
    frames[0] = frames[0]._replace(apr_sigma_m=sigmas, apr_sigma_rad=0.1 * sigmas)
    # The other walk has none, and is not the worse for sharing a batch.
    both = fuse_walks(chain.METHOD, ChainParams(), [PairedFrames(f) for f in frames])
    for frame, fused, stated in zip(frames, both, (sigmas, None), strict=True):
        localizer = Localizer("chain")
        for row in range(50):
            given = {} if stated is None else {
                "apr_sigma_m": stated[row], "apr_sigma_deg": np.rad2deg(0.1 * stated[row])
            }  # fmt: skip
            estimate = localizer.update(
                frame.timestamp_s[row],
                frame.apr_world_from_cam.at(row),
                frame.vio_from_cam.at(row),
                **given,
            )
        np.testing.assert_allclose(
            estimate.world_from_cam.translation_m, fused.world_from_cam.translation_m[-1], atol=1e-9
        )
