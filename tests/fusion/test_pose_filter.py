"""The filter of corrections, against means taken by hand and by NumPy and SciPy."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.helpers import convert_frames, random_rigid, to_numpy

from vioapr.errors import ParameterError
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.offline import run_steps
from vioapr.fusion.pose_filter import METHOD, PoseFilterParams, init, mean_without_strays, step
from vioapr.fusion.types import FrameInput, Status
from vioapr.geometry.rigid import Rigid3, angle_deg, distance_m, stack

PARAMS = PoseFilterParams()
UPRIGHT = np.array([0.0, 0, 0, 1])


def frames_with(apr, vio=None, **flags):
    """Frames of shape (n, ...), all with prediction and tracking unless told otherwise."""
    shape = apr.batch_shape
    times = np.arange(shape[0], dtype=float).reshape(-1, *[1] * (len(shape) - 1))
    vio = Rigid3.identity(shape) if vio is None else vio
    given = {"has_apr": True, "tracking_ok": True, "tracking_reset": False} | flags
    masks = {name: np.zeros(shape, dtype=bool) | value for name, value in given.items()}
    return FrameInput(
        times + np.zeros(shape), apr, masks["has_apr"], vio,
        masks["tracking_ok"], masks["tracking_reset"],
    )  # fmt: skip


def at_x(*x):
    """Upright poses along the x axis."""
    positions = np.stack([np.array(x, dtype=float), *np.zeros((2, len(x)))], axis=-1)
    return Rigid3(positions, np.zeros((len(x), 4)) + UPRIGHT)


def headings(*degrees):
    """Poses at the origin, turned about z."""
    turns = Rotation.from_euler("z", np.array(degrees, dtype=float)[:, None], degrees=True)
    return Rigid3(np.zeros((len(degrees), 3)), turns.as_quat())


def filtered_x(params, *x):
    """The last answer along x."""
    estimate = run_steps(METHOD, params, frames_with(at_x(*x)))
    return estimate.world_from_cam.translation_m[-1, 0]


class TestByHand:
    def test_one_correction_is_taken_as_it_is(self):
        assert filtered_x(PARAMS, 3.0) == 3.0

    def test_two_are_averaged_though_both_are_a_deviation_away(self):
        assert filtered_x(PARAMS, 1.0, 3.0) == pytest.approx(2.0)

    def test_a_stray_is_dropped(self):
        # Mean 2.5, deviation sqrt(3 * 2.5^2 + 7.5^2) / 2 = 4.33: only the 10 is beyond.
        assert filtered_x(PARAMS, 0, 0, 10, 0) == pytest.approx(0.0)

    def test_within_more_deviations_it_stays(self):
        # The 10 is 1.73 deviations away.
        assert filtered_x(PoseFilterParams(max_deviations=1.7), 0, 0, 10, 0) == pytest.approx(0)
        assert filtered_x(PoseFilterParams(max_deviations=1.8), 0, 0, 10, 0) == pytest.approx(2.5)

    def test_the_newest_may_be_the_stray(self):
        assert filtered_x(PARAMS, 1, 2, 3, 50) == pytest.approx(2.0)

    def test_the_ninth_pushes_out_the_first(self):
        # 100 is the stray among 8 and gone with the ninth; both ends of the others stray then.
        assert filtered_x(PARAMS, 100, 1, 2, 3, 4, 5, 6, 7) == pytest.approx(4.0)
        # 1 to 8: mean 4.5, deviation sqrt(5.25) = 2.29, so 3 to 6 stay.
        assert filtered_x(PARAMS, 100, 1, 2, 3, 4, 5, 6, 7, 8) == pytest.approx(4.5)
        assert filtered_x(PoseFilterParams(window=2), 100, 1, 2, 3, 4) == pytest.approx(3.5)

    def test_orientation_is_filtered_by_itself(self):
        apr = headings(0, 6, 90, 3)._replace(translation_m=at_x(0, 0, 0, 8).translation_m)
        pose = run_steps(METHOD, PARAMS, frames_with(apr)).world_from_cam.at(-1)
        assert pose.translation_m[0] == pytest.approx(0)  # the last is dropped here
        expected = headings(3).at(0)  # and the third there
        assert angle_deg(pose, expected) == pytest.approx(0, abs=1e-6)

    def test_far_from_where_tracking_began_a_turn_moves_the_camera(self):
        # Twice the same place, 10 m away in VIO; the two predictions differ by 2 deg of heading.
        vio = at_x(10, 10)
        apr = headings(0, 2)._replace(translation_m=vio.translation_m)
        pose = run_steps(METHOD, PARAMS, frames_with(apr, vio)).world_from_cam.at(-1)
        # Corrections: the identity, and 2 deg with -10 (cos 2 deg - 1, sin 2 deg).
        expected = np.array([10 * (1 - np.cos(np.deg2rad(2))), -10 * np.sin(np.deg2rad(2))]) / 2
        expected += 10 * np.array([np.cos(np.deg2rad(1)), np.sin(np.deg2rad(1))])
        np.testing.assert_allclose(pose.translation_m, [*expected, 0], atol=1e-9)


def test_it_equals_plain_means():
    rng = np.random.default_rng(0)
    for count in (1, 2, 3, 5, 8):
        poses = random_rigid(rng, (count,))
        small = Rotation.from_rotvec(0.3 * rng.standard_normal((count, 3)))
        poses = poses._replace(quat_xyzw=small.as_quat())
        position, quat = mean_without_strays(*poses, np.array(float(count)), np.array(1.0))

        distance = np.linalg.norm(poses.translation_m - poses.translation_m.mean(axis=0), axis=1)
        near = distance <= np.sqrt((distance**2).mean()) * 1.0001
        np.testing.assert_allclose(position, poses.translation_m[near].mean(axis=0), atol=1e-12)

        angle = (small.mean().inv() * small).magnitude()
        near = angle <= np.sqrt((angle**2).mean()) * 1.0001
        assert (Rotation.from_quat(quat).inv() * small[near].mean()).magnitude() < 1e-6


class TestWalks:
    def test_exact_inputs_give_exact_poses(self):
        rng = np.random.default_rng(1)
        truth, world_from_vio = random_rigid(rng, (30,)), random_rigid(rng)
        frames = frames_with(truth, world_from_vio.inverse() @ truth)
        estimate = run_steps(METHOD, PARAMS, frames)
        assert (estimate.status == Status.OPTIMIZED).all()
        assert distance_m(estimate.world_from_cam, truth).max() < 1e-9
        assert angle_deg(estimate.world_from_cam, truth).max() < 1e-6
        assert distance_m(estimate.world_from_vio, world_from_vio).max() < 1e-9
        assert estimate.sigma_position_m is None

    def test_frames_without_prediction_are_carried_by_vio(self):
        vio = at_x(0, 1, 2, 3, 4)
        apr = at_x(100, 5, 100, 100, 100)  # only the second is a prediction, 4 m ahead of VIO
        has_apr = np.array([False, True, False, False, False])
        tracking_ok = np.array([True, True, True, False, True])
        frames = frames_with(apr, vio, has_apr=has_apr, tracking_ok=tracking_ok)
        estimate = run_steps(METHOD, PARAMS, frames)
        assert list(estimate.status) == [
            Status.UNLOCALIZED, Status.OPTIMIZED, Status.TRACKED,
            Status.UNLOCALIZED, Status.UNLOCALIZED,
        ]  # fmt: skip
        np.testing.assert_allclose(
            estimate.world_from_cam.translation_m[:, 0], [np.nan, 5, 6, np.nan, np.nan]
        )
        np.testing.assert_allclose(
            estimate.world_from_vio.translation_m[:, 0], [np.nan, 4, 4, np.nan, np.nan]
        )

    def test_a_new_tracking_world_forgets_the_old_one(self):
        frames = frames_with(
            at_x(1, 1, 1, 7, 9), tracking_reset=np.array([False, False, False, True, False])
        )
        x = run_steps(METHOD, PARAMS, frames).world_from_cam.translation_m[:, 0]
        np.testing.assert_allclose(x, [1, 1, 1, 7, 8])

    def test_a_reset_without_prediction_waits_for_one(self):
        frames = frames_with(
            at_x(1, 1, 7, 9),
            has_apr=np.array([True, True, False, True]),
            tracking_reset=np.array([False, False, True, False]),
        )
        estimate = run_steps(METHOD, PARAMS, frames)
        assert estimate.status[2] == Status.UNLOCALIZED
        assert estimate.world_from_cam.translation_m[3, 0] == 9

    def test_predictions_without_tracking_are_not_used(self):
        frames = frames_with(at_x(1, 2, 3), tracking_ok=False)
        estimate = run_steps(METHOD, PARAMS, frames)
        assert (estimate.status == Status.UNLOCALIZED).all()
        assert np.isnan(estimate.world_from_vio.translation_m).all()


def troubled(rng, batch=()):
    shape = (20, *batch)
    apr, vio = random_rigid(rng, shape), random_rigid(rng, shape)
    return frames_with(
        apr, vio,
        has_apr=rng.random(shape) < 0.7,
        tracking_ok=rng.random(shape) < 0.9,
        tracking_reset=rng.random(shape) < 0.1,
    )  # fmt: skip


class TestBackends:
    @pytest.mark.slow
    @pytest.mark.parametrize("batch", [(), (1,), (3, 4)])
    @pytest.mark.parametrize("backend", ["torch", "array_api_strict"])
    def test_backends_agree_for_every_batch_shape(self, backend, batch):
        xp = pytest.importorskip({"torch": "array_api_compat.torch"}.get(backend, backend))
        frames = troubled(np.random.default_rng(5), batch)
        ours = run_steps(METHOD, PARAMS, frames)
        theirs = run_steps(METHOD, PARAMS, convert_frames(frames, xp))
        np.testing.assert_array_equal(ours.status, to_numpy(theirs.status))
        assert ours.world_from_cam.batch_shape == (20, *batch)
        for left, right in zip(
            (*ours.world_from_cam, *ours.world_from_vio),
            (*theirs.world_from_cam, *theirs.world_from_vio),
            strict=True,
        ):
            np.testing.assert_allclose(left, to_numpy(right), atol=1e-9)

    def test_batched_walks_are_those_walked_alone(self):
        frames = troubled(np.random.default_rng(6), (3, 4))
        together = run_steps(METHOD, PARAMS, frames).world_from_cam.at((slice(None), 2, 1))
        alone = run_steps(METHOD, PARAMS, frames.at((slice(None), 2, 1))).world_from_cam
        np.testing.assert_allclose(together.translation_m, alone.translation_m, atol=1e-12)
        np.testing.assert_allclose(together.quat_xyzw, alone.quat_xyzw, atol=1e-12)

    def test_each_walk_of_a_batch_may_have_its_own_limit(self):
        one = at_x(0, 0, 10, 0)
        frames = frames_with(stack([one, one], axis=1))
        params = SimpleNamespace(window=8, max_deviations=np.array([1.0, 1.8]))
        x = run_steps(METHOD, params, frames).world_from_cam.translation_m[-1, :, 0]
        np.testing.assert_allclose(x, [0, 2.5], atol=1e-12)


class TestStreaming:
    def test_localizer_gives_the_same_as_offline(self):
        frames = troubled(np.random.default_rng(8))
        offline = run_steps(METHOD, PARAMS, frames)
        localizer = Localizer("pose-filter")
        for row in range(20):
            live = localizer.update(
                float(frames.timestamp_s[row]),
                frames.apr_world_from_cam.at(row) if frames.has_apr[row] else None,
                frames.vio_from_cam.at(row),
                bool(frames.tracking_ok[row]),
                tracking_reset=bool(frames.tracking_reset[row]),
            )
            assert live.status == offline.status[row]
            np.testing.assert_allclose(
                live.world_from_cam.translation_m,
                offline.world_from_cam.translation_m[row],
                atol=1e-12,
            )

    def test_state_does_not_grow(self):
        frames = frames_with(random_rigid(np.random.default_rng(9), (50,)))
        state = init(PARAMS, (), frames.timestamp_s)
        for row in range(50):
            state, _ = step(PARAMS, state, frames.at(row))
            assert state.corrections.batch_shape == (8,)
        assert state.length == 8


@pytest.mark.parametrize(
    ("name", "value", "flag"),
    [
        ("window", 0, "--filter-window"),
        ("window", 2.5, "--filter-window"),
        ("max_deviations", 0.9, "--filter-max-deviations"),
        ("max_deviations", float("inf"), "--filter-max-deviations"),
        ("max_deviations", float("nan"), "--filter-max-deviations"),
    ],
)
def test_impossible_parameters_are_refused(name, value, flag):
    with pytest.raises(ParameterError, match=rf"{flag}: expected .*, got {value}"):
        PoseFilterParams(**{name: value})
