"""The iSAM2 baseline on exact, noisy, interrupted and sparse walks."""

import sys

import numpy as np
import pytest
from tests.helpers import frames_of, random_rigid

from vioapr.errors import MissingExtraError, ParameterError
from vioapr.fusion import mapnet_pgo
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import get_method
from vioapr.fusion.offline import fuse_walk, run_steps
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.pose_graph import METHOD, PoseGraphParams, init
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3, angle_deg, distance_m
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS
from vioapr.simulation.trackers import NO_TRACKER_ERRORS
from vioapr.simulation.walks import WalkParams, simulate_walk

EXACT = WalkParams(duration_s=20.0, tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS)


@pytest.fixture
def gtsam():
    return pytest.importorskip("gtsam", reason="method pose-graph needs gtsam")


@pytest.fixture
def exact():
    """Frames of an exact walk, and its true poses."""
    walk = simulate_walk(EXACT, seed=1)
    return frames_of(walk), walk.gt.target_from_source


def assert_same_poses(left, right, atol_m=1e-6, atol_deg=1e-5):
    assert distance_m(left, right).max() < atol_m
    assert angle_deg(left, right).max() < atol_deg


@pytest.mark.usefixtures("gtsam")
class TestExactWalks:
    def test_exact_inputs_give_exact_poses(self, exact):
        frames, gt_world_from_cam = exact
        estimate = run_steps(METHOD, PoseGraphParams(), frames)
        assert (estimate.status == Status.OPTIMIZED).all()
        assert_same_poses(estimate.world_from_cam, gt_world_from_cam)
        assert_same_poses(estimate.world_from_vio @ frames.vio_from_cam, gt_world_from_cam)

    def test_arrays_are_double_and_scalar(self, exact):
        state = init(PoseGraphParams(), (), np.zeros(()))
        _, estimate = METHOD.step(PoseGraphParams(), state, exact[0].at(0))
        assert estimate.world_from_cam.translation_m.dtype == np.float64
        assert estimate.world_from_cam.quat_xyzw.dtype == np.float64
        assert estimate.status.shape == estimate.confirmed_run.shape == ()
        assert estimate.sigma_position_m.shape == estimate.sigma_orientation_deg.shape == ()

    def test_frames_without_prediction_are_carried_by_vio(self, exact):
        frames, gt_world_from_cam = exact
        has_apr = np.arange(len(frames.timestamp_s)) % 4 == 2
        estimate = run_steps(METHOD, PoseGraphParams(), frames._replace(has_apr=has_apr))
        expected = np.where(has_apr, Status.OPTIMIZED, Status.TRACKED)
        expected[:2] = Status.UNLOCALIZED
        np.testing.assert_array_equal(estimate.status, expected)
        known = slice(2, None)
        assert_same_poses(estimate.world_from_cam.at(known), gt_world_from_cam.at(known))
        for values in (*estimate.world_from_cam, *estimate.world_from_vio):
            assert np.isnan(values[:2]).all()

    def test_nothing_is_known_without_predictions(self, exact):
        frames = exact[0]._replace(has_apr=np.zeros(40, dtype=bool))
        assert (run_steps(METHOD, PoseGraphParams(), frames).status == Status.UNLOCALIZED).all()


@pytest.mark.usefixtures("gtsam")
class TestSegments:
    @pytest.mark.parametrize("how", ["lost", "reset"])
    def test_a_new_segment_is_a_new_graph(self, exact, how):
        frames, gt_world_from_cam = exact
        moved = random_rigid(np.random.default_rng(0)) @ frames.vio_from_cam
        is_old = (np.arange(40) < 15)[:, None]
        vio = Rigid3(*map(lambda a, b: np.where(is_old, a, b), frames.vio_from_cam, moved))
        tracking_ok, tracking_reset, has_apr = np.ones(40, bool), np.zeros(40, bool), frames.has_apr
        (tracking_ok if how == "lost" else tracking_reset)[15] = how == "reset"
        has_apr = has_apr & (np.arange(40) != 16)
        frames = frames._replace(
            vio_from_cam=vio,
            tracking_ok=tracking_ok,
            tracking_reset=tracking_reset,
            has_apr=has_apr,
        )
        estimate = run_steps(METHOD, PoseGraphParams(), frames)
        expected = np.full(40, Status.OPTIMIZED)
        # Lost: frame 16 is tracked again, but only frame 17 says where.
        expected[15:17] = Status.UNLOCALIZED if how == "lost" else expected[15:17]
        expected[16] = Status.UNLOCALIZED if how == "lost" else Status.TRACKED
        np.testing.assert_array_equal(estimate.status, expected)
        known = expected != Status.UNLOCALIZED
        assert_same_poses(estimate.world_from_cam.at(known), gt_world_from_cam.at(known))
        np.testing.assert_array_equal(np.isnan(estimate.sigma_position_m), ~known)
        np.testing.assert_array_equal(np.isnan(estimate.sigma_orientation_deg), ~known)

    def test_segments_do_not_share_predictions(self):
        frames = frames_of(simulate_walk(WalkParams(duration_s=15.0), seed=2))
        tracking_reset = np.arange(30) == 12
        whole = run_steps(METHOD, PoseGraphParams(), frames._replace(tracking_reset=tracking_reset))
        second = run_steps(METHOD, PoseGraphParams(), frames.at(slice(12, None)))
        assert_same_poses(whole.world_from_cam.at(slice(12, None)), second.world_from_cam)
        np.testing.assert_allclose(whole.sigma_position_m[12:], second.sigma_position_m)

    def test_offline_gives_nan_sigmas_only_where_unlocalized(self):
        walk = simulate_walk(WalkParams(duration_s=10.0), seed=2)
        frames = pair_frames(walk.apr.at_rows(slice(4, None)), walk.vio)
        fused = fuse_walk(METHOD, PoseGraphParams(), frames)
        assert fused.sigma_position_m is not None
        np.testing.assert_array_equal(np.isfinite(fused.sigma_position_m), fused.is_localized)
        fused = fuse_walk(METHOD, PoseGraphParams(sigmas=False), frames)
        assert fused.sigma_position_m is None
        assert fused.sigma_orientation_deg is None


@pytest.mark.usefixtures("gtsam")
class TestSigmas:
    def test_one_prediction_alone_has_the_priors_sigmas(self, exact):
        frames = exact[0].at(slice(0, 1))
        params = PoseGraphParams(prior_sigma_m=0.5, prior_sigma_deg=2.0)
        estimate = run_steps(METHOD, params, frames)
        np.testing.assert_allclose(estimate.sigma_position_m, [0.5])
        np.testing.assert_allclose(estimate.sigma_orientation_deg, [2.0])

    def test_grow_while_vio_carries_and_shrink_with_predictions(self, exact):
        frames = exact[0]._replace(has_apr=(np.arange(40) < 20))
        estimate = run_steps(METHOD, PoseGraphParams(), frames)
        for sigma in (estimate.sigma_position_m, estimate.sigma_orientation_deg):
            assert (np.diff(sigma[:10]) < 0).all()
            assert (np.diff(sigma[19:]) > 0).all()

    def test_standing_still_for_two_frames_halves_the_variance(self, exact):
        frames = exact[0].at(np.zeros(2, dtype=int))
        params = PoseGraphParams(between_sigma_m=1e-4, between_sigma_deg=1e-3)
        estimate = run_steps(METHOD, params, frames)
        expected = np.sqrt(0.5) * np.array([1.0, 3.0])
        np.testing.assert_allclose(estimate.sigma_position_m[1], expected[0], rtol=1e-3)
        np.testing.assert_allclose(estimate.sigma_orientation_deg[1], expected[1], rtol=1e-3)

    def test_do_not_change_the_poses(self):
        frames = frames_of(simulate_walk(WalkParams(duration_s=15.0), seed=3))
        with_sigmas = run_steps(METHOD, PoseGraphParams(), frames)
        without = run_steps(METHOD, PoseGraphParams(sigmas=False), frames)
        assert without.sigma_position_m is None
        assert_same_poses(with_sigmas.world_from_cam, without.world_from_cam, 1e-12, 1e-9)


@pytest.mark.usefixtures("gtsam")
class TestNoisyWalks:
    def test_finds_the_optimum_of_the_whole_graph(self, gtsam):
        frames = frames_of(simulate_walk(WalkParams(duration_s=10.0), seed=4))
        params = PoseGraphParams(updates=20)
        state = METHOD.init(params, (), frames.timestamp_s)
        for row in range(20):
            state, estimate = METHOD.step(params, state, frames.at(row))
        factors = state.graph.getFactorsUnsafe()
        optimizer = gtsam.LevenbergMarquardtOptimizer(factors, state.graph.calculateEstimate())
        optimum = optimizer.optimize().atPose3(19)
        found = estimate.world_from_cam.translation_m
        np.testing.assert_allclose(found, optimum.translation(), atol=0.02)

    def test_shrugs_off_an_outlier_that_mapnet_does_not(self, exact):
        frames, gt_world_from_cam = exact
        frames.apr_world_from_cam.translation_m[20] += [8.0, -6.0, 0.0]
        robust = run_steps(METHOD, PoseGraphParams(), frames)
        plain = run_steps(mapnet_pgo.METHOD, mapnet_pgo.MapnetPgoParams(), frames)
        errors = [distance_m(e.world_from_cam, gt_world_from_cam)[20] for e in (robust, plain)]
        assert errors[0] < 0.1
        assert errors[1] > 1.0

    def test_beats_the_raw_predictions(self):
        walk = simulate_walk(WalkParams(duration_s=60.0), seed=5)
        frames = frames_of(walk)
        fused = run_steps(METHOD, PoseGraphParams(), frames).world_from_cam
        truth = walk.gt.target_from_source
        raw_m = np.median(distance_m(frames.apr_world_from_cam, truth))
        assert np.median(distance_m(fused, truth)) < 0.8 * raw_m

    def test_localizer_gives_the_same_as_offline(self):
        frames = frames_of(simulate_walk(WalkParams(duration_s=5.0), seed=6))
        offline = run_steps(METHOD, PoseGraphParams(), frames)
        localizer = Localizer("pose-graph")
        for _ in range(2):  # the second time shows that `reset` starts a new graph
            for row, time in enumerate(frames.timestamp_s):
                apr, vio = frames.apr_world_from_cam.at(row), frames.vio_from_cam.at(row)
                live = localizer.update(float(time), apr, vio)
                assert live.status is Status.OPTIMIZED
                assert_same_poses(live.world_from_cam, offline.world_from_cam.at(row))
            localizer.reset()


def test_is_registered_with_its_extra():
    method = get_method("pose-graph")
    assert (method.extra, method.is_batched) == ("pose-graph", False)


def test_missing_gtsam_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'vioapr\[pose-graph\]'"):
        init(PoseGraphParams(), (), np.zeros(()))


def test_batches_are_refused():
    with pytest.raises(ParameterError, match=r"expected one walk, got a batch of \(3,\)"):
        init(PoseGraphParams(), (3,), np.zeros(()))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("prior_sigma_m", 0.0),
        ("prior_sigma_deg", -1.0),
        ("between_sigma_m", float("inf")),
        ("between_sigma_deg", float("nan")),
        ("cauchy_k", 0.0),
        ("updates", 0),
        ("updates", 1.5),
    ],
)
def test_impossible_parameters_are_refused(name, value):
    with pytest.raises(
        ParameterError, match=rf"^PoseGraphParams\.{name}: expected .*, got {value}"
    ):
        PoseGraphParams(**{name: value})
