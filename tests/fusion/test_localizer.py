import numpy as np
import pytest
from tests.helpers import frames_of

import vioapr
from vioapr.errors import ParameterError
from vioapr.fusion.apr import AprParams
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS, get_method
from vioapr.fusion.offline import run_steps
from vioapr.fusion.types import Status
from vioapr.fusion.vio_apr import VioAprParams
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS
from vioapr.simulation.trackers import NO_TRACKER_ERRORS
from vioapr.simulation.walks import WalkParams, simulate_walk

EXACT = WalkParams(
    duration_s=20, rate_hz=60, tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS
)
BATCHED = [name for name, method in METHODS.items() if method.is_batched]
HERE = Rigid3.identity()


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(EXACT, seed=3)


def feed(localizer, walk, row, *, with_apr=True, **kwargs):
    return localizer.update(
        walk.gt.timestamp_s[row],
        walk.apr.target_from_source.at(row) if with_apr else None,
        walk.vio.target_from_source.at(row),
        **kwargs,
    )


@pytest.mark.slow
def test_predictions_at_1_hz_with_vio_at_60_hz(walk):
    localizer = Localizer("vio-apr")
    statuses = []
    for row in range(len(walk.gt)):
        estimate = feed(localizer, walk, row, with_apr=row % 60 == 0)
        statuses.append(estimate.status)
        if estimate.status != Status.UNLOCALIZED:
            gt = walk.gt.target_from_source.at(row)
            assert rigid.distance_m(gt, estimate.world_from_cam) < 1e-9
            placed = estimate.world_from_vio @ walk.vio.target_from_source.at(row)
            assert rigid.distance_m(gt, placed) < 1e-9
    # The third prediction, at frame 120, confirms the first reference.
    assert statuses.index(Status.KEYFRAME) == 120
    assert set(statuses[:120]) == {Status.UNLOCALIZED}
    assert set(statuses[121:180]) == {Status.TRACKED}
    assert statuses[180] == Status.KEYFRAME
    # T counts predictions: 8 of them, then two unconfirmed while aligning again.
    assert [statuses[60 * k] for k in range(2, 14)] == [Status.KEYFRAME] * 9 + [
        Status.TRACKED, Status.TRACKED, Status.KEYFRAME,
    ]  # fmt: skip


def test_a_lost_tracker_starts_a_new_segment(walk):
    localizer = Localizer("vio-apr")
    for row in range(10):
        estimate = feed(localizer, walk, row)
    assert estimate.status == Status.KEYFRAME
    lost = feed(localizer, walk, 10, tracking_ok=False)
    assert lost.status == Status.UNLOCALIZED
    assert np.isnan(lost.world_from_cam.translation_m).all()
    statuses = [feed(localizer, walk, row).status for row in (11, 12, 13)]
    assert statuses == [Status.UNLOCALIZED, Status.UNLOCALIZED, Status.KEYFRAME]


def test_no_vio_pose_is_a_lost_tracker(walk):
    localizer = Localizer("vio-apr")
    for row in range(10):
        feed(localizer, walk, row)
    estimate = localizer.update(10.0, walk.apr.target_from_source.at(10), None)
    assert estimate.status == Status.UNLOCALIZED


def test_a_reset_tracker_starts_a_new_segment_with_its_first_frame(walk):
    localizer = Localizer("vio-apr")
    for row in range(10):
        feed(localizer, walk, row)
    statuses = [feed(localizer, walk, row, tracking_reset=row == 10).status for row in (10, 11, 12)]
    assert statuses == [Status.UNLOCALIZED, Status.UNLOCALIZED, Status.KEYFRAME]


def test_vio_alone_is_never_corrected(walk):
    localizer = Localizer("vio")
    first = None
    for row in range(200):
        estimate = feed(localizer, walk, row)
        if estimate.status == Status.TRACKED and first is None:
            first = estimate.world_from_vio
    assert first is not None
    np.testing.assert_array_equal(first.translation_m, estimate.world_from_vio.translation_m)
    assert estimate.status == Status.TRACKED


def test_raw_predictions_need_no_tracker(walk):
    localizer = Localizer("apr")
    assert feed(localizer, walk, 0, tracking_ok=False).status == Status.PREDICTED
    assert feed(localizer, walk, 1, with_apr=False).status == Status.UNLOCALIZED


def test_matrices_are_taken_too(walk):
    matrices, rigids = Localizer("vio-apr"), Localizer("vio-apr")
    for row in range(5):
        apr, vio = walk.apr.target_from_source.at(row), walk.vio.target_from_source.at(row)
        one = matrices.update(row, apr.to_matrix(), vio.to_matrix().tolist())
        other = rigids.update(row, apr, vio)
    np.testing.assert_allclose(
        one.world_from_cam.translation_m, other.world_from_cam.translation_m, atol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", BATCHED)
def test_streaming_equals_a_batch(name):
    noisy = simulate_walk(WalkParams(), seed=1)
    frames = frames_of(noisy)
    method = get_method(name)
    batch = run_steps(method, method.params_type(), frames)
    localizer = Localizer(name)
    for row in range(len(noisy.gt)):
        estimate = feed(localizer, noisy, row)
        assert estimate.status == batch.status[row]
        # The odometer takes roots of steps: of a camera at rest, what quaternions are rounded by.
        np.testing.assert_allclose(
            estimate.world_from_cam.translation_m,
            batch.world_from_cam.translation_m[row],
            rtol=0,
            atol=1e-6,
        )


def test_reset_forgets(walk):
    localizer = Localizer("vio-apr")
    for row in range(5):
        feed(localizer, walk, row)
    localizer.reset()
    assert feed(localizer, walk, 0).status == Status.UNLOCALIZED


def mirrored():
    return np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ((np.nan, HERE, HERE), "timestamp_s: expected a finite number, got nan"),
        ((0.0, np.eye(3), HERE), r"apr_world_from_cam: expected a 4x4 matrix .* got \(3, 3\)"),
        ((0.0, HERE, np.eye(4) * 2), "vio_from_cam: expected a rotation"),
        ((0.0, mirrored(), HERE), "not mirrored.*determinant -1"),
        (
            (0.0, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [4, 5, 6, 1.0]]), HERE),
            "apr_world_from_cam: expected 0 0 0 1 as the last row of a matrix, got 4 5 6 1: "
            "written column by column. Give its transpose",
        ),
        ((0.0, HERE, np.eye(4) + np.eye(4, k=-3)), "got 1 0 0 1: written column by column"),
        ((0.0, HERE, np.diag([1.0, 1, 1, 0])), "vio_from_cam: expected 0 0 0 1 .* got 0 0 0 0$"),
        ((0.0, np.full((4, 4), np.nan), HERE), "apr_world_from_cam: expected finite numbers"),
        ((0.0, Rigid3(np.full(3, np.inf), np.eye(4)[3]), HERE), "expected finite numbers"),
        ((0.0, HERE, Rigid3(np.zeros(3), np.zeros(4))), "unit quaternion, got one of norm 0"),
        ((0.0, HERE, Rigid3(np.zeros((2, 3)), np.zeros((2, 4)))), "expected one pose"),
    ],
)
def test_bad_frames_are_refused(args, message):
    localizer = Localizer("vio-apr")
    with pytest.raises(ParameterError, match=message):
        localizer.update(*args)
    assert localizer.update(0.0, HERE, HERE).status == Status.UNLOCALIZED


def test_time_must_go_on():
    localizer = Localizer("vio-apr")
    localizer.update(1.0, None, HERE)
    with pytest.raises(ParameterError, match=r"after the last frame's \(1.000000 s\), got 1.0"):
        localizer.update(1.0, None, HERE)


def test_unknown_methods_and_foreign_parameters_are_refused():
    with pytest.raises(ParameterError, match="unknown method 'magic': expected one of apr, vio"):
        Localizer("magic")
    with pytest.raises(ParameterError, match="expected VioAprParams .* got AprParams"):
        Localizer("vio-apr", AprParams())
    assert isinstance(Localizer("vio-apr", VioAprParams(run_pairs=3)), vioapr.Localizer)
