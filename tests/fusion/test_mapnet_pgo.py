"""Window optimization checked by finite differences, SciPy's solver and exact walks."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from tests.helpers import convert_frames, to_numpy

from vioapr.errors import ParameterError
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.mapnet_pgo import (
    METHOD,
    MapnetPgoParams,
    Window,
    init,
    linearize,
    optimize,
    step,
)
from vioapr.fusion.offline import run_steps
from vioapr.fusion.types import FrameInput, Status
from vioapr.geometry.pose_graph import perturb, to_dense
from vioapr.geometry.rigid import Rigid3, angle_deg, distance_m

PARAMS = MapnetPgoParams()


def dense(params, window):
    """All residuals and their derivatives."""
    return to_dense(linearize(params, window), window.world_from_cam.batch_shape[-1])


def random_poses(rng, shape, scale_m=2.0):
    quat = rng.normal(size=(*shape, 4))
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    return Rigid3(rng.normal(scale=scale_m, size=(*shape, 3)), quat)


def noisy(rng, poses, sigma_m, sigma_deg):
    sigmas = np.repeat([sigma_m, np.deg2rad(sigma_deg)], 3)
    return perturb(poses, rng.normal(size=(*poses.batch_shape, 6)) * sigmas)


def walk(rng, count, batch=(), sigma_m=0.0, sigma_deg=0.0):
    """Frames of a smooth random walk of shape (count, *batch), and its true poses."""
    turns = np.cumsum(rng.normal(scale=0.05, size=(count, *batch, 3)), axis=0)
    quat = Rotation.from_rotvec(turns.reshape(-1, 3)).as_quat().reshape(*turns.shape[:-1], 4)
    positions = np.cumsum(rng.normal(scale=0.1, size=(count, *batch, 3)), axis=0)
    gt_world_from_cam = Rigid3(positions, quat)
    vio_from_world = random_poses(rng, batch)
    frames = FrameInput(
        np.arange(count).reshape(-1, *[1] * len(batch)) * 0.1 + np.zeros(batch),
        noisy(rng, gt_world_from_cam, sigma_m, sigma_deg),
        np.ones((count, *batch), dtype=bool),
        vio_from_world @ gt_world_from_cam,
        np.ones((count, *batch), dtype=bool),
        np.zeros((count, *batch), dtype=bool),
    )
    return frames, gt_world_from_cam


def random_window(rng, size=7, length=None, batch=()):
    """A window whose predictions and VIO disagree by about their sigmas."""
    truth = random_poses(rng, (*batch, size), scale_m=1.0)
    vio_from_world = random_poses(rng, (*batch, 1))
    length = np.full(batch, float(size if length is None else length))
    return Window(
        noisy(rng, truth, 0.3, 5.0),
        noisy(rng, truth, 1.0, 5.0),
        noisy(rng, vio_from_world @ truth, 0.05, 0.5),
        length,
    )


class TestLinearize:
    @pytest.mark.parametrize("length", [1, 2, 4])
    def test_jacobian_is_the_derivative_of_the_residuals(self, length):
        rng = np.random.default_rng(length)
        window = random_window(rng, size=4, length=length)
        _, jacobian = dense(PARAMS, window)
        step_size = 1e-6
        valid = slice(0, 6 * length)
        for column in range(6 * length):
            tangent = np.zeros(24)
            tangent[column] = step_size
            plus, minus = (
                dense(
                    PARAMS,
                    window._replace(
                        world_from_cam=perturb(window.world_from_cam, s * tangent.reshape(4, 6))
                    ),
                )[0]
                for s in (1.0, -1.0)
            )
            numeric = (plus - minus) / (2 * step_size)
            scale = max(1.0, np.abs(numeric).max())
            np.testing.assert_allclose(jacobian[:, column], numeric, atol=1e-6 * scale)
        assert np.linalg.matrix_rank(jacobian[:, valid]) == 6 * length

    def test_jacobian_near_zero_and_near_half_turns(self):
        rng = np.random.default_rng(3)
        for angle in (1e-9, 1e-4, 1.9e-3, 2.1e-3, 3.1):
            truth = random_poses(rng, (1,))
            axis = np.array([[0.0, 0, 0, 0.6, 0, 0.8]])
            window = Window(perturb(truth, angle * axis), truth, truth, np.array(1.0))
            jacobian = dense(PARAMS, window)[1] * np.deg2rad(PARAMS.prior_sigma_deg)
            # Turning further about the same axis changes the rotation vector one to one.
            np.testing.assert_allclose(jacobian[3:, 3:] @ axis[0, 3:], axis[0, 3:], atol=1e-9)

    def test_residuals_checkable_by_hand(self):
        identity = Rigid3.identity((2,))
        apr = identity._replace(translation_m=np.array([[3.0, 0, 0], [0, 0, 0]]))
        vio = identity._replace(translation_m=np.array([[0.0, 0.06, 0], [0, 0, 0]]))
        residuals, _ = dense(PARAMS, Window(identity, apr, vio, np.array(2.0)))
        assert residuals[0] == pytest.approx(-3.0)  # 3 m against a sigma of 1 m
        assert residuals[13] == pytest.approx(-2.0)  # 6 cm against 3 cm
        assert np.count_nonzero(np.abs(residuals) > 1e-12) == 2


class TestOptimize:
    @pytest.mark.slow
    @pytest.mark.parametrize("seed", range(3))
    @pytest.mark.parametrize(("size", "length"), [(7, 7), (7, 3), (1, 1)])
    def test_finds_the_optimum_that_scipy_finds(self, seed, size, length):
        rng = np.random.default_rng(seed)
        window = random_window(rng, size, length)
        ours = optimize(MapnetPgoParams(window=size, iterations=30), window).world_from_cam

        def residuals(tangent):
            moved = perturb(window.world_from_cam, tangent.reshape(size, 6))
            return dense(PARAMS, window._replace(world_from_cam=moved))[0]

        tolerances = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-13}
        found = least_squares(residuals, np.zeros(6 * size), method="trf", **tolerances)
        theirs = perturb(window.world_from_cam, found.x.reshape(size, 6))
        valid = slice(0, length)
        assert distance_m(ours.at(valid), theirs.at(valid)).max() < 1e-6
        assert np.deg2rad(angle_deg(ours.at(valid), theirs.at(valid))).max() < 1e-6

    def test_leaves_poses_that_do_not_count(self):
        window = random_window(np.random.default_rng(0), 5, length=2)
        after = optimize(PARAMS, window).world_from_cam
        before = window.world_from_cam
        np.testing.assert_array_equal(after.translation_m[2:], before.translation_m[2:])
        np.testing.assert_allclose(after.quat_xyzw[2:], before.quat_xyzw[2:], atol=1e-15)

    def test_rigid_odometry_averages_the_predictions(self):
        # Standing still, with VIO that is nearly certain: the mean of the positions.
        rng = np.random.default_rng(1)
        apr = Rigid3(rng.normal(size=(7, 3)), Rigid3.identity((7,)).quat_xyzw)
        window = Window(apr, apr, Rigid3.identity((7,)), np.array(7.0))
        params = MapnetPgoParams(between_sigma_m=1e-5)
        newest = optimize(params, window).world_from_cam.translation_m[0]
        np.testing.assert_allclose(newest, apr.translation_m.mean(axis=0), atol=1e-6)

    @pytest.mark.slow
    def test_default_iterations_suffice_on_a_walk(self):
        frames, _ = walk(np.random.default_rng(2), 40, (4,), sigma_m=1.0, sigma_deg=8.0)
        few, many = (
            run_steps(METHOD, MapnetPgoParams(iterations=n), frames).world_from_cam
            for n in (PARAMS.iterations, 20)
        )
        assert distance_m(few, many).max() < 1e-6


class TestWalks:
    def test_exact_inputs_give_exact_poses(self):
        frames, truth = walk(np.random.default_rng(0), 40)
        estimate = run_steps(METHOD, PARAMS, frames)
        assert (estimate.status == Status.OPTIMIZED).all()
        assert distance_m(estimate.world_from_cam, truth).max() < 1e-9
        assert angle_deg(estimate.world_from_cam, truth).max() < 1e-9
        assert estimate.sigma_position_m is None

    def test_world_from_vio_places_the_camera(self):
        frames, _ = walk(np.random.default_rng(0), 10, sigma_m=0.5, sigma_deg=3.0)
        estimate = run_steps(METHOD, PARAMS, frames)
        placed = estimate.world_from_vio @ frames.vio_from_cam
        assert distance_m(placed, estimate.world_from_cam).max() < 1e-9
        assert angle_deg(placed, estimate.world_from_cam).max() < 1e-6

    @pytest.mark.slow
    def test_smooths_noise(self):
        frames, truth = walk(np.random.default_rng(0), 200, sigma_m=0.5, sigma_deg=5.0)
        fused = run_steps(METHOD, PARAMS, frames).world_from_cam
        raw = frames.apr_world_from_cam
        assert distance_m(fused, truth).mean() < 0.6 * distance_m(raw, truth).mean()
        assert angle_deg(fused, truth).mean() < 0.6 * angle_deg(raw, truth).mean()

    def test_frames_without_prediction_are_carried_by_vio(self):
        frames, truth = walk(np.random.default_rng(0), 30)
        has_apr = np.arange(30) % 3 == 1
        estimate = run_steps(METHOD, PARAMS, frames._replace(has_apr=has_apr))
        expected = np.where(has_apr, Status.OPTIMIZED, Status.TRACKED)
        expected[0] = Status.UNLOCALIZED
        np.testing.assert_array_equal(estimate.status, expected)
        assert np.isnan(estimate.world_from_cam.translation_m[0]).all()
        after = slice(1, None)
        assert distance_m(estimate.world_from_cam.at(after), truth.at(after)).max() < 1e-9

    def test_predictions_without_tracking_are_not_used(self):
        frames, _ = walk(np.random.default_rng(0), 4)
        estimate = run_steps(METHOD, PARAMS, frames._replace(tracking_ok=np.zeros(4, dtype=bool)))
        assert (estimate.status == Status.UNLOCALIZED).all()
        assert np.isnan(estimate.world_from_vio.translation_m).all()

    @pytest.mark.parametrize("how", ["tracking_ok", "tracking_reset"])
    def test_a_new_segment_forgets_the_old_one(self, how):
        rng = np.random.default_rng(4)
        frames, _ = walk(rng, 20, sigma_m=0.5, sigma_deg=3.0)
        flags = getattr(frames, how).copy()
        flags[8] = how == "tracking_reset"
        has_apr = np.ones(20, dtype=bool)
        has_apr[9] = False
        jump = random_poses(rng, ())
        vio = Rigid3(
            *(
                np.concatenate([old[:8], new[8:]])
                for old, new in zip(frames.vio_from_cam, jump @ frames.vio_from_cam, strict=True)
            )
        )
        frames = frames._replace(vio_from_cam=vio, has_apr=has_apr, **{how: flags})
        estimate = run_steps(METHOD, PARAMS, frames)
        first = 8 if how == "tracking_reset" else 10
        alone = run_steps(METHOD, PARAMS, frames.at(slice(first, None)))
        np.testing.assert_array_equal(estimate.status[first:], alone.status)
        assert distance_m(estimate.world_from_cam.at(slice(first, None)), alone[0]).max() < 1e-12
        if how == "tracking_ok":
            assert (estimate.status[8:10] == Status.UNLOCALIZED).all()

    def test_old_predictions_leave_the_window(self):
        frames, truth = walk(np.random.default_rng(0), 20)
        apr = frames.apr_world_from_cam
        apr.translation_m[3] += 50.0
        errors = distance_m(run_steps(METHOD, PARAMS, frames).world_from_cam, truth)
        assert (errors[3:10] > 1).all()  # not robust: the outlier counts while it is inside
        assert errors[:3].max() < 1e-9
        assert errors[10:].max() < 1e-6

    def test_outlier_by_a_half_turn_stays_finite(self):
        frames, truth = walk(np.random.default_rng(0), 30)
        apr = frames.apr_world_from_cam
        apr.quat_xyzw[10] = (Rotation.from_quat(apr.quat_xyzw[10]) * _half_turn()).as_quat()
        estimate = run_steps(METHOD, PARAMS, frames)
        assert np.isfinite(estimate.world_from_cam.quat_xyzw).all()
        assert angle_deg(estimate.world_from_cam, truth)[17:].max() < 1e-6


def _half_turn():
    return Rotation.from_rotvec([0, np.pi, 0])


class TestBackends:
    @pytest.mark.slow
    @pytest.mark.parametrize("batch", [(), (1,), (3, 4)])
    @pytest.mark.parametrize("backend", ["torch", "array_api_strict"])
    def test_backends_agree_for_every_batch_shape(self, backend, batch):
        xp = pytest.importorskip({"torch": "array_api_compat.torch"}.get(backend, backend))
        rng = np.random.default_rng(5)
        frames, _ = walk(rng, 12, batch, sigma_m=0.5, sigma_deg=5.0)
        frames = frames._replace(
            has_apr=rng.random((12, *batch)) < 0.7,
            tracking_ok=rng.random((12, *batch)) < 0.9,
            tracking_reset=rng.random((12, *batch)) < 0.1,
        )
        ours = run_steps(METHOD, PARAMS, frames)
        theirs = run_steps(METHOD, PARAMS, convert_frames(frames, xp))
        np.testing.assert_array_equal(ours.status, to_numpy(theirs.status))
        assert ours.world_from_cam.batch_shape == (12, *batch)
        for left, right in zip(
            (*ours.world_from_cam, *ours.world_from_vio),
            (*theirs.world_from_cam, *theirs.world_from_vio),
            strict=True,
        ):
            np.testing.assert_allclose(left, to_numpy(right), atol=1e-9)

    def test_batched_walks_are_those_walked_alone(self):
        frames, _ = walk(np.random.default_rng(6), 12, (3, 4), sigma_m=0.5, sigma_deg=5.0)
        together = run_steps(METHOD, PARAMS, frames)
        alone = run_steps(METHOD, PARAMS, frames.at((slice(None), 2, 1)))
        one = together.world_from_cam.at((slice(None), 2, 1))
        np.testing.assert_allclose(one.translation_m, alone.world_from_cam.translation_m, atol=1e-9)


class TestStreaming:
    def test_localizer_gives_the_same_as_offline(self):
        frames, _ = walk(np.random.default_rng(8), 15, sigma_m=0.5, sigma_deg=5.0)
        offline = run_steps(METHOD, PARAMS, frames)
        localizer = Localizer("mapnet-pgo")
        for row in range(15):
            apr, vio = frames.apr_world_from_cam.at(row), frames.vio_from_cam.at(row)
            live = localizer.update(float(frames.timestamp_s[row]), apr, vio)
            expected = offline.world_from_cam.at(row)
            np.testing.assert_allclose(
                live.world_from_cam.translation_m, expected.translation_m, atol=1e-12
            )

    def test_state_does_not_grow(self):
        frames, _ = walk(np.random.default_rng(9), 50)
        state = init(PARAMS, (), frames.timestamp_s)
        sizes = set()
        for row in range(50):
            state, _ = step(PARAMS, state, frames.at(row))
            sizes.add(sum(array.nbytes for pose in state[:3] for array in pose))
        assert sizes == {3 * 7 * 7 * 8}  # three windows of 7 poses of 7 doubles
        assert state.length == 7


@pytest.mark.parametrize(
    ("name", "value", "flag"),
    [
        ("window", 0, "--mapnet-window"),
        ("iterations", 1.5, "--mapnet-iterations"),
        ("prior_sigma_m", 0.0, "--mapnet-prior-sigma-m"),
        ("prior_sigma_deg", float("inf"), "--mapnet-prior-sigma-deg"),
        ("between_sigma_m", -1.0, "--mapnet-between-sigma-m"),
        ("between_sigma_deg", float("nan"), "--mapnet-between-sigma-deg"),
    ],
)
def test_impossible_parameters_are_refused(name, value, flag):
    with pytest.raises(ParameterError, match=rf"{flag}: expected .*, got {value}"):
        MapnetPgoParams(**{name: value})
