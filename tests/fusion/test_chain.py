import numpy as np
import pytest
from tests.helpers import convert_frames, frames_of, to_numpy

from vioapr.errors import ParameterError
from vioapr.fusion import vio_apr
from vioapr.fusion.chain import method as chain
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.offline import run_steps
from vioapr.fusion.types import FrameInput, LocalizationState, Status
from vioapr.fusion.vio_apr import VioAprParams
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS
from vioapr.simulation.trackers import NO_TRACKER_ERRORS, TrackerErrors
from vioapr.simulation.walks import WalkParams, simulate_walk

EXACT = WalkParams(duration_s=30, tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS)
SMALL = ChainParams(window=12)
GRAVITIES = ("auto", "known", "estimate", "none")


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(), seed=8)


@pytest.fixture(scope="module")
def estimates(walk):
    return run_steps(chain.METHOD, ChainParams(), frames_of(walk))


def run(frames, **params):
    return run_steps(chain.METHOD, ChainParams(**params), frames)


def errors_m(walk, estimates):
    return rigid.distance_m(walk.gt.target_from_source, estimates.world_from_cam)


def errors_deg(walk, estimates):
    return rigid.angle_deg(walk.gt.target_from_source, estimates.world_from_cam)


def move_tracker(frames, start, transform):
    """The tracking world changes at a frame and stays changed, without notice."""
    after = np.arange(len(frames.timestamp_s)) >= start
    moved = rigid.choose(after, transform @ frames.vio_from_cam, frames.vio_from_cam)
    return frames._replace(vio_from_cam=moved)


@pytest.mark.slow
@pytest.mark.parametrize("gravity", GRAVITIES)
def test_exact_inputs_give_exact_poses_from_the_first_frame(gravity):
    walk = simulate_walk(EXACT, seed=1)
    found = run(frames_of(walk), gravity=gravity)
    assert (found.status == Status.OPTIMIZED).all()
    assert errors_m(walk, found).max() < 1e-6
    assert errors_deg(walk, found).max() < 1e-4


def test_it_answers_every_frame_better_than_the_paper_and_raw():
    ratios = []
    for seed in range(8, 14):
        walk = simulate_walk(WalkParams(), seed)
        ours = errors_m(walk, run(frames_of(walk)))
        raw = rigid.distance_m(walk.gt.target_from_source, walk.apr.target_from_source)
        paper = errors_m(walk, run_steps(vio_apr.METHOD, VioAprParams(), frames_of(walk)))
        assert np.isfinite(ours).all()
        assert np.percentile(ours, 95) < 0.5 * np.percentile(raw, 95)
        ratios.append([np.median(ours) / np.nanmedian(paper), np.median(ours) / np.median(raw)])
    assert (np.exp(np.log(ratios).mean(axis=0)) < 0.7).all()


def test_sigmas_are_of_the_size_of_the_errors(walk, estimates):
    normalized = errors_m(walk, estimates) / estimates.sigma_position_m
    assert 0.5 < np.median(normalized[20:]) / 1.54 < 2
    axes = estimates.sigma_position_axes_m
    np.testing.assert_allclose(
        np.sqrt((axes**2).mean(axis=-1)), estimates.sigma_position_m, rtol=1e-12
    )


@pytest.mark.slow
def test_outliers_are_ignored_and_make_it_less_sure(walk, estimates):
    frames = frames_of(walk)
    wild = frames.apr_world_from_cam.translation_m.copy()
    rows = np.arange(160, 190)
    wild[rows] += np.random.default_rng(0).uniform(-30, 30, (30, 3))
    frames = frames._replace(
        apr_world_from_cam=frames.apr_world_from_cam._replace(translation_m=wild)
    )
    found = run(frames)
    assert errors_m(walk, found)[rows].max() < 3
    assert found.sigma_position_m[180] > 5 * estimates.sigma_position_m[180]


@pytest.mark.slow
def test_a_lookalike_place_for_thirty_frames_is_not_believed(walk):
    frames = frames_of(walk)
    moved = frames.apr_world_from_cam.translation_m.copy()
    rows = np.arange(160, 190)
    moved[rows] += [8.0, 6.0, 0.0]
    frames = frames._replace(
        apr_world_from_cam=frames.apr_world_from_cam._replace(translation_m=moved)
    )
    assert np.median(errors_m(walk, run(frames))[rows]) < 2


@pytest.mark.slow
def test_odometry_that_cannot_be_trusted_is_not():
    """A tracker that drifts as fast as it moves, and predictions that err as usual."""
    ratios = []
    for seed in range(6):
        walk = simulate_walk(WalkParams(tracker=TrackerErrors(step_noise_m=1.0)), seed)
        frames = frames_of(walk)
        raw = rigid.distance_m(walk.gt.target_from_source, walk.apr.target_from_source)
        ours, rigidly = (errors_m(walk, run(frames, estimate_drift=d)) for d in (True, False))
        # It also says rather nothing where motion and predictions contradict each other.
        assert np.isfinite(ours).mean() > 0.6
        medians = [np.nanmedian(ours)] * 2
        ratios.append(medians / np.array([np.median(raw), np.nanmedian(rigidly)]))
    to_raw, to_rigid = np.exp(np.log(ratios).mean(axis=0))
    assert to_raw < 1.5
    assert to_rigid < 0.8


@pytest.mark.slow
def test_a_jump_of_the_tracker_is_recovered_from_within_a_few_predictions(walk):
    jump = Rigid3(np.array([5.0, 0.0, 3.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    found = run(move_tracker(frames_of(walk), 100, jump))
    assert np.median(errors_m(walk, found)[102:122]) < 2.5


@pytest.mark.slow
def test_a_reset_without_notice_is_recovered_from(walk):
    turn = quaternion.from_rotvec(np.array([0.0, 1.5, 0.0]))
    found = run(move_tracker(frames_of(walk), 100, Rigid3(np.array([20.0, 0.0, -7.0]), turn)))
    assert np.median(errors_m(walk, found)[105:125]) < 3
    assert np.median(errors_deg(walk, found)[105:125]) < 6


@pytest.mark.slow
def test_a_tilted_map_is_found_where_the_tracker_knows_up(walk):
    tilt = Rigid3(np.zeros(3), quaternion.from_rotvec(np.array([0.5, -0.4, 0.0])))
    frames = frames_of(walk)
    frames = frames._replace(apr_world_from_cam=tilt @ frames.apr_world_from_cam)
    gt = tilt @ walk.gt.target_from_source
    medians = {
        gravity: np.median(rigid.angle_deg(gt, run(frames, gravity=gravity).world_from_cam)[40:])
        for gravity in ("estimate", "none")
    }
    assert medians["estimate"] < 2
    assert medians["estimate"] < medians["none"]
    # Whoever is told that both know up, and sees that they do not agree, gives no answer.
    told = run(frames, gravity="known")
    assert (told.localization_state[40:] != LocalizationState.LOCALIZED).mean() > 0.9


@pytest.mark.slow
def test_known_gravity_keeps_the_tracker_upright(walk):
    found = run(frames_of(walk), gravity="known")
    up = quaternion.rotate(found.world_from_vio.quat_xyzw, np.array([0.0, 1.0, 0.0]))
    level = np.broadcast_to([0.0, 0.0, 1.0], up.shape)
    np.testing.assert_allclose(up[5:], level[5:], atol=3 * 0.004)  # of a phone's gravity
    sigmas = found.sigma_orientation_axes_deg[5:]
    assert (sigmas[:, 0] < sigmas[:, 2]).all()


def test_a_loss_of_tracking_keeps_what_was_known_and_verifies_it(walk):
    localizer = Localizer("chain")
    for row in range(30):
        apr, vio = (t.target_from_source.at(row) for t in (walk.apr, walk.vio))
        is_lost = row == 20
        before = localizer.update(row / 2, apr, vio, tracking_ok=not is_lost)
        assert before.status == (Status.PREDICTED if is_lost else Status.OPTIMIZED)
        if is_lost:
            np.testing.assert_array_equal(before.world_from_cam.translation_m, apr.translation_m)
            assert before.localization_state == LocalizationState.LOST
        if row == 19:
            assert before.localization_state == LocalizationState.LOCALIZED
            known = before
        if row == 21:
            moved = rigid.distance_m(before.world_from_vio, known.world_from_vio)
            assert moved < 1.0
    back = localizer.update(40.0, None, walk.vio.target_from_source.at(30))
    assert back.status == Status.TRACKED
    assert back.sigma_position_m > before.sigma_position_m  # after a pause of 25 s
    lost = localizer.update(41.0, None, None)
    assert lost.status == Status.UNLOCALIZED
    assert np.isnan(lost.sigma_position_m)


def test_a_reset_forgets_even_if_it_is_reported_while_lost(walk):
    localizer = Localizer("chain")
    for row in range(20):
        apr, vio = (t.target_from_source.at(row) for t in (walk.apr, walk.vio))
        localizer.update(row / 2, apr, vio)
    localizer.update(10.2, None, None, tracking_reset=True)
    new_world = localizer.update(10.5, None, walk.vio.target_from_source.at(21))
    assert new_world.status == Status.UNLOCALIZED
    assert new_world.localization_state == LocalizationState.SEARCHING


def test_frames_without_predictions_are_tracked_and_grow_less_sure(walk):
    localizer = Localizer("chain")
    sigmas = []
    for row in range(60):
        vio = walk.vio.target_from_source.at(row)
        apr = walk.apr.target_from_source.at(row) if row < 30 else None
        estimate = localizer.update(row / 2, apr, vio)
        sigmas.append(float(estimate.sigma_position_m))
        assert estimate.status == (Status.OPTIMIZED if row < 30 else Status.TRACKED)
    assert sigmas[-1] > sigmas[30]


@pytest.mark.slow
def test_standing_still_keeps_the_memory_and_adds_no_certainty(walk):
    frames = frames_of(walk)
    still = np.concatenate([np.arange(80), np.full(200, 80)])
    held = frames.at(still)._replace(timestamp_s=np.arange(280) / 2)
    found = run(held)
    assert found.sigma_position_m[-1] > 0.7 * found.sigma_position_m[85]


@pytest.mark.slow
@pytest.mark.parametrize("switch", ["heavy_tails", "view_weights", "estimate_drift", "look_at"])
def test_every_part_can_be_switched_off(walk, estimates, switch):
    found = run(frames_of(walk), **{switch: False})
    assert np.isfinite(errors_m(walk, found)).all()
    assert not np.allclose(
        found.world_from_cam.translation_m, estimates.world_from_cam.translation_m
    )


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["array_api_compat.torch", "array_api_strict"])
@pytest.mark.parametrize("batch", [(), (1,), (3, 4)])
def test_batches_and_backends_agree(batch, backend):
    xp = pytest.importorskip(backend, reason="the backend is not installed")
    walks = [simulate_walk(WalkParams(duration_s=15), seed) for seed in range(int(np.prod(batch)))]
    alone = [frames_of(walk) for walk in walks]

    def stack(values):
        return np.stack(values, axis=1).reshape(30, *batch, *values[0].shape[1:])

    frames = FrameInput(
        *(
            Rigid3(*(stack([v[i] for v in column]) for i in range(2)))
            if isinstance(column[0], Rigid3)
            else stack(column)
            for column in list(zip(*alone, strict=True))[:6]
        )
    )
    numpy = run_steps(chain.METHOD, SMALL, frames)
    other = run_steps(chain.METHOD, SMALL, convert_frames(frames, xp))
    np.testing.assert_array_equal(numpy.status, to_numpy(other.status))
    for ours, theirs in zip(numpy.world_from_cam, other.world_from_cam, strict=True):
        np.testing.assert_allclose(ours, to_numpy(theirs), atol=1e-9)
    first = run_steps(chain.METHOD, SMALL, alone[0])
    flat = numpy.world_from_cam.translation_m.reshape(30, -1, 3)[:, 0]
    np.testing.assert_allclose(flat, first.world_from_cam.translation_m, atol=1e-9)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"window": 3}, "--window: expected a whole number of more than 3, got 3"),
        ({"window": 8.5}, "--window: expected a whole number of more than 3, got 8.5"),
        ({"drift_prior": -1.0}, "--drift-prior: .* got -1.0"),
        ({"gravity": "maybe"}, "--gravity: expected one of auto, known, .* got 'maybe'"),
    ],
)
def test_bad_parameters_are_refused(kwargs, message):
    with pytest.raises(ParameterError, match=message):
        ChainParams(**kwargs)
