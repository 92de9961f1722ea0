import numpy as np
import pytest

from vioapr.evaluation.metrics import relative_errors
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.scene.frames import Tracking
from vioapr.simulation.trackers import (
    NO_TRACKER_ERRORS,
    TrackerErrors,
    TrackerEvents,
    dead_reckon,
    track,
    track_frames,
    track_without_drift,
    tracking_world,
)
from vioapr.simulation.walks import walk_round

TIMES = np.arange(0, 60, 0.1)
WITH_TILT = TrackerErrors(tilt_error_deg=0.1)


@pytest.fixture(scope="module")
def gt():
    return walk_round(np.random.default_rng(5), TIMES, 20.0, 1.1)


def test_the_tracker_is_y_up_and_drifts_little(rng, gt):
    track = track_frames(rng, TIMES, gt, WITH_TILT)
    assert (track.tracking == Tracking.NORMAL).all()
    up = quaternion.rotate(gt.quat_xyzw, np.array([0.0, -1.0, 0.0]))
    vio_up = quaternion.rotate(track.vio_from_cam.quat_xyzw, np.array([0.0, -1.0, 0.0]))
    np.testing.assert_allclose(vio_up[:, 1], up[:, 2], atol=0.02)
    np.testing.assert_allclose(np.ptp(track.vio_from_cam.translation_m[:, 1]), 0.15, atol=0.15)
    gaps = relative_errors(gt, track.vio_from_cam)
    assert (gaps.distance_m < 0.1).mean() > 0.99
    assert (gaps.angle_deg < 1).mean() > 0.99


def test_lost_tracking_starts_another_world(rng, gt):
    track = track_frames(rng, TIMES, gt, WITH_TILT, TrackerEvents(lost_s=20.0))
    assert (track.tracking == Tracking.LOST).sum() == 40
    assert TIMES[track.tracking == Tracking.RESET] == pytest.approx([24.0])
    after = track.vio_from_cam.at(TIMES >= 24.0)
    np.testing.assert_allclose(after.translation_m[0], 0, atol=1e-9)
    kept = track.vio_from_cam.at(TIMES < 20.0)
    assert (relative_errors(gt.at(TIMES < 20.0), kept).distance_m < 0.1).all()


def test_tracking_is_limited_before_a_jump(rng, gt):
    track = track_frames(rng, TIMES, gt, WITH_TILT, TrackerEvents(jump_s=30.0))
    assert TIMES[track.tracking == Tracking.LIMITED] == pytest.approx(np.arange(29, 30, 0.1))
    gaps = relative_errors(gt, track.vio_from_cam).distance_m
    assert np.argmax(gaps) == np.searchsorted(TIMES, 30.0) - 1
    assert 0.3 < gaps.max() < 1.2
    assert (gaps > 0.3).sum() == 1


def test_a_tracker_without_errors_moves_as_the_camera_does(rng, gt):
    gaps = relative_errors(gt, track(rng, TIMES, gt, NO_TRACKER_ERRORS))
    assert gaps.distance_m.max() < 1e-9
    assert gaps.angle_deg.max() < 1e-5


def test_errors_are_of_their_stated_sizes(gt):
    """Over many draws, heading errors after a minute have sqrt(60) times the random walk's rate."""
    errors = TrackerErrors(heading_drift_deg=0.2, scale_error=0.05, step_noise_m=0.0)
    scales, drifts = [], []
    length_m = np.linalg.norm(np.diff(gt.translation_m, axis=0), axis=1).sum()
    for seed in range(400):
        vio = track(np.random.default_rng(seed), TIMES, gt, errors)
        scales.append(np.linalg.norm(np.diff(vio.translation_m, axis=0), axis=1).sum() / length_m)
        drifts.append(rigid.angle_deg(rigid.between(gt.at(0), gt.at(-1)),
                                      rigid.between(vio.at(0), vio.at(-1))))  # fmt: skip
    assert np.std(scales) == pytest.approx(0.05, rel=0.12)
    assert np.sqrt(np.mean(np.square(drifts))) == pytest.approx(0.2 * np.sqrt(TIMES[-1]), rel=0.12)


def test_dead_reckoning_by_hand():
    """Two steps of 1 m along x; the tracker's heading is 90 degrees ahead, its scale twice."""
    gt = rigid.Rigid3(
        np.array([[5.0, 0, 1], [6, 0, 1], [7, 0, 1]]), np.tile([0, 0, 0, 1.0], (3, 1))
    )
    vio = dead_reckon(gt, np.full(3, np.pi / 2), 2.0)
    # North in a z-up world is -z in a y-up world.
    np.testing.assert_allclose(vio.translation_m, [[0, 0, 0], [0, 0, -2], [0, 0, -4]], atol=1e-12)


def test_a_world_of_its_own_without_drift(rng, gt):
    vio_from_world = tracking_world(40, 1.5)
    vio = track_without_drift(rng, gt, vio_from_world)
    exact = vio_from_world.apply_to(y_up_from_z_up(gt))
    assert rigid.distance_m(vio, exact).max() < 0.02
    assert 0.1 < np.median(rigid.angle_deg(vio, exact)) < 0.25
    up = quaternion.rotate(vio_from_world.rigid.quat_xyzw, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-12)
