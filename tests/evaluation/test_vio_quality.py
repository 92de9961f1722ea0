import json

import numpy as np
import pytest

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.evaluation.vio_quality import VioQualityParams, align_track, analyze, pairs_apart
from vioapr.evaluation.vio_tables import share_within, steady, to_record
from vioapr.evaluation.vio_tracks import VioTrack, find_vio_walks, make_track
from vioapr.formats import tum
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.report.figures.vio_quality import vio_distribution_figure, vio_drift_figure
from vioapr.report.style import render
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.base import to_plain
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

TURN_Z_90 = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
WORLD_FROM_VIO = Rigid3(np.array([10.0, 20.0, 30.0]), TURN_Z_90)


def circle(count=120, rate_hz=2.0, radius_m=5.0):
    """A walk around a circle, the camera turning with it."""
    angle = np.linspace(0, 2 * np.pi, count)
    positions = radius_m * np.column_stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(3 * angle)])
    half = angle / 2
    quats = np.column_stack([0 * half, 0 * half, np.sin(half), np.cos(half)])
    return Trajectory.from_arrays(np.arange(count) / rate_hz, positions, quats)


def track_of(gt, vio_from_cam, walk="walk", tracking_world=None):
    worlds = np.zeros(len(gt), dtype=int) if tracking_world is None else tracking_world
    poses = gt.target_from_source
    return VioTrack("set", walk, "vio", gt.timestamp_s, poses, vio_from_cam, worlds)


def as_vio(gt):
    return WORLD_FROM_VIO.inverse() @ gt.target_from_source


def test_a_perfect_tracker_has_no_error():
    gt = circle()
    quality = analyze(track_of(gt, as_vio(gt)))
    assert quality.errors.position_m.max() < 1e-9
    assert quality.errors.orientation_deg.max() < 1e-5
    assert quality.ate_m < 1e-9
    assert quality.scale == pytest.approx(1)
    assert quality.share_within == 1
    assert quality.diverges_at_s is None
    assert quality.path_m == pytest.approx(2 * np.pi * 5, rel=0.03)


def test_relative_errors_are_between_lengths():
    """A tracker of twice the lengths, whatever its axes: RPE is the true step itself."""
    gt = circle(rate_hz=1.0)
    vio = as_vio(gt)
    quality = analyze(track_of(gt, vio._replace(translation_m=2 * vio.translation_m)))
    steps = np.linalg.norm(np.diff(gt.position_m, axis=0), axis=1)
    np.testing.assert_allclose(quality.gaps.distance_m, steps, atol=1e-9)
    np.testing.assert_allclose(quality.gaps.angle_deg, 0, atol=1e-5)
    assert quality.scale == pytest.approx(0.5)


def test_shares_count_both_limits():
    gt = circle(count=101, rate_hz=1.0)
    vio = as_vio(gt)
    vio.translation_m[51:] += [5.0, 5.0, 0.0]  # one pair of 100 is off
    quality = analyze(track_of(gt, vio))
    assert len(quality.pair_rows) == 100
    assert quality.share_within == pytest.approx(0.99)
    turned = vio._replace(quat_xyzw=vio.quat_xyzw.copy())
    turned.quat_xyzw[:20] = turned.quat_xyzw[20]  # 20 pairs without a turn of 3.6 deg
    assert analyze(track_of(gt, turned)).share_within == pytest.approx(0.79)
    lax = VioQualityParams(within_deg=4)
    assert analyze(track_of(gt, turned), lax).share_within == pytest.approx(0.99)


def test_pairs_are_a_period_apart():
    times = np.array([0.0, 0.5, 1.0, 1.52, 4.0])
    same = np.zeros(5, dtype=int)
    assert pairs_apart(times, same, 1.0).tolist() == [[0, 2], [1, 3]]
    assert pairs_apart(times, np.array([0, 0, 0, 1, 1]), 1.0).tolist() == [[0, 2]]
    assert pairs_apart(times, same, 0.1).tolist() == []
    assert pairs_apart(times[:1], same[:1], 1.0).shape == (0, 2)


def test_every_tracking_world_is_aligned_by_itself():
    gt = circle()
    vio = as_vio(gt)
    late = np.arange(len(gt)) >= 60
    vio.translation_m[late] += [100.0, 0.0, 0.0]
    joined = analyze(track_of(gt, vio))
    assert joined.ate_m > 10
    split = analyze(track_of(gt, vio, tracking_world=late.astype(int)))
    assert split.ate_m < 1e-9
    assert split.errors.position_m.max() < 1e-9
    assert len(split.gaps.distance_m) == len(joined.gaps.distance_m) - 2


@pytest.mark.parametrize("is_straight", [True, False])
def test_a_straight_line_is_aligned_by_orientations(is_straight, rng):
    gt = circle()
    if is_straight:
        gt.position_m[:] = np.arange(len(gt))[:, None] * [0.5, 0.0, 0.0]
        gt.position_m[:] += 0.02 * rng.standard_normal(gt.position_m.shape)
    found = align_track(as_vio(gt), gt.target_from_source)
    assert rigid.angle_deg(found, WORLD_FROM_VIO) < 0.1
    assert rigid.distance_m(found, WORLD_FROM_VIO) < 0.05


def test_files_of_other_camera_axes_are_aligned_by_positions():
    """A tracker whose camera axes turn against the true ones: orientations say nothing."""
    gt = circle()
    vio = as_vio(gt)
    vio = vio._replace(quat_xyzw=quaternion.inverse(vio.quat_xyzw))
    found = align_track(vio, gt.target_from_source)
    assert rigid.angle_deg(found, WORLD_FROM_VIO) < 1e-5


def test_drift_is_of_relative_poses():
    """A tracker 2 % too long: 2 m a stretch of 100 m straight on, whatever the alignment."""
    count = 401
    positions = np.column_stack([np.arange(count), np.sin(np.arange(count) / 9), np.zeros(count)])
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    gt = Trajectory.from_arrays(np.arange(count), positions, quats)
    vio = Rigid3(1.02 * positions, quats)
    drift = analyze(track_of(gt, vio), VioQualityParams(stretch_m=100)).per_distance
    assert drift.position_m == pytest.approx(2, rel=0.03)
    assert drift.orientation_deg == 0
    short = analyze(track_of(gt, vio), VioQualityParams(stretch_m=1000)).per_distance
    assert short.stretch == pytest.approx(analyze(track_of(gt, vio)).path_m / 2)


def test_divergence_is_told_from_scale_and_jumps():
    gt = circle(count=600, radius_m=40)
    vio = as_vio(gt)
    scaled = vio._replace(translation_m=1.4 * vio.translation_m)
    assert analyze(track_of(gt, scaled)).diverges_at_s is None
    jumped = Rigid3(vio.translation_m.copy(), vio.quat_xyzw)
    jumped.translation_m[300:] += [8.0, 0.0, 0.0]
    assert analyze(track_of(gt, jumped)).diverges_at_s is None
    away = Rigid3(vio.translation_m.copy(), vio.quat_xyzw)
    away.translation_m[300:, 0] += np.arange(300.0) ** 2 / 10
    assert 140 < analyze(track_of(gt, away)).diverges_at_s < 160
    frozen = vio._replace(translation_m=0 * vio.translation_m)
    assert analyze(track_of(gt, frozen)).diverges_at_s == 0


def test_groups_leave_out_what_diverges():
    gt = circle(count=600, radius_m=40)
    good = analyze(track_of(gt, as_vio(gt)))
    runaway = as_vio(gt)
    runaway.translation_m[:, 0] += np.arange(600.0) ** 2
    bad = analyze(track_of(gt, runaway, walk="other"))
    content = json.loads(json.dumps(to_plain(to_record([good, bad])), allow_nan=False))
    group = content["groups"]["set vio"]
    assert (group["tracks"], group["diverging"], group["share_within"]) == (2, ["other"], 1.0)
    assert group["pairs"] == len(good.pair_rows)
    assert [track["diverges"] for track in content["tracks"]] == [False, True]
    assert share_within(steady([good, bad])) == 1
    assert np.isnan(share_within([]))


@pytest.mark.slow
def test_figures_are_drawn_also_of_few_frames_and_of_runaways():
    gt = circle(count=600, radius_m=40)
    runaway = as_vio(gt)
    runaway.translation_m[:, 0] += np.arange(600.0) ** 2
    bad = analyze(track_of(gt, runaway))
    lone = analyze(track_of(gt.at_rows(slice(0, 1)), as_vio(gt.at_rows(slice(0, 1))), walk="one"))
    for qualities in ([bad], [lone], [bad, lone]):
        for draw in (vio_distribution_figure, vio_drift_figure):
            png, _ = render(draw(qualities))
            assert png.startswith(b"\x89PNG")


def test_ground_truth_is_interpolated_but_not_over_gaps():
    gt = Trajectory.from_arrays(
        [0.0, 0.2, 0.4, 5.0], np.arange(4)[:, None] * [1.0, 0, 0], [[0, 0, 0, 1]] * 4
    )
    vio = Trajectory.from_arrays([0.1, 0.3, 2.0, 5.005], np.zeros((4, 3)), [[0, 0, 0, 1]] * 4)
    track = make_track("s", "w", "v", vio, gt)
    assert track.timestamp_s.tolist() == [0.1, 0.3, 5.005]
    np.testing.assert_allclose(track.gt_world_from_cam.translation_m[:, 0], [0.5, 1.5, 3.0])
    assert track.frames_without_gt == 1


def test_frames_without_clock_go_by_name_and_the_rate():
    poses = np.arange(4)[:, None] * [1.0, 0, 0], [[0, 0, 0, 1]] * 4
    named = Trajectory.from_arrays(range(4), *poses, names=list("abcd"), is_timed=False)
    other = named.at_rows(np.array([0, 1, 3]))
    track = make_track("s", "w", "v", named, other)
    assert len(track) == 3
    quality = analyze(track, VioQualityParams(rate_hz=2))
    assert quality.pair_rows.tolist() == [[0, 1]]  # b and d are two frames apart
    assert quality.duration_s == 1.5


def test_walks_that_do_not_meet():
    gt = circle()
    late = Trajectory(gt.timestamp_s + 1e4, gt.position_m, gt.quat_xyzw)
    with pytest.raises(AssociationError, match="set/walk: no frame of arkit has ground truth"):
        make_track("set", "walk", "arkit", late, gt)


@pytest.mark.parametrize("value", [0, -1, np.nan, np.inf])
def test_bad_parameters(value):
    with pytest.raises(ParameterError, match="rate_hz: expected a positive number"):
        VioQualityParams(rate_hz=value)


def test_walks_are_found_by_folder_beginning_and_file(tmp_path):
    gt = circle()
    folder = tmp_path / "Set"
    for name in ("a_gt", "a_arkit", "a_vio_core", "a_apr_net", "b_gt", "walk/gt", "walk/vio_x"):
        path = folder / f"{name}.tum"
        path.parent.mkdir(parents=True, exist_ok=True)
        tum.write(path, gt)
    found = [walk.read(0.01) for walk in find_vio_walks([folder])]
    names = [[(t.set_name, t.walk, t.vio) for t in tracks] for tracks in found]
    assert names == [[("Set", "a", "arkit"), ("Set", "a", "core")], [("Set", "walk", "x")]]
    assert len(find_vio_walks([folder / "a"])) == len(find_vio_walks([folder / "a_gt.tum"])) == 1
    with pytest.raises(FormatError, match="expected a scene, or walks"):
        find_vio_walks([folder / "b"])
    with pytest.raises(ParameterError, match="paths"):
        find_vio_walks([])


def test_scenes_are_read_with_their_tracking_worlds(tmp_path):
    gt = circle(count=20)
    scene = Scene.create(tmp_path / "scene", "Yard", is_outdoor=True)
    with pytest.raises(FormatError, match="make it with vioapr map"):
        find_vio_walks([scene.folder])
    states = [Tracking.NORMAL] * 20
    states[8], states[9] = Tracking.LOST, Tracking.RESET
    vio = as_vio(gt)
    info = RecordingInfo(tracker="ARKit", has_images=False)
    with RecordingWriter(scene.recording_folder("walk"), info) as writer:
        for row, state in enumerate(states):
            pose = None if state == Tracking.LOST else vio.at(row)
            writer.add_frame(gt.timestamp_s[row], "", None, state, pose, Intrinsics())
    scene.write_gt("walk", gt)
    ((track,),) = (walk.read(0.01) for walk in find_vio_walks([scene.folder]))
    assert track.title == "Yard/walk arkit"
    assert (len(track), track.frames_lost) == (19, 1)
    assert track.tracking_world.tolist() == [0] * 8 + [1] * 11


@pytest.mark.slow
@pytest.mark.parametrize(
    ("walk", "kind", "ate_m", "share"),
    [
        ("MH_01", "mono", 0.204, 0.99),
        ("MH_03", "mono", 0.144, 0.96),
        ("V2_01", "mono", 0.085, 0.95),
        ("MH_01", "stereo", 0.081, 1.00),
        ("MH_03", "stereo", 0.111, 1.00),
        ("V2_01", "stereo", 0.054, 0.99),
    ],
)
def test_euroc_figures(data_dir, walk, kind, ate_m, share):
    """As that folder's README states them."""
    tracks = find_vio_walks([data_dir / "euroc_vio" / walk])[0].read(0.01)
    quality = analyze(next(track for track in tracks if track.vio == kind))
    assert quality.ate_m == pytest.approx(ate_m, rel=0.05)
    assert quality.share_within == pytest.approx(share, abs=0.01)
    assert 0.88 <= quality.share_within <= 1


def test_advio_figures(data_dir):
    ((track,),) = (w.read(0.01) for w in find_vio_walks([data_dir / "advio/tum10hz/advio-18"]))
    quality = analyze(track)
    assert quality.ate_m == pytest.approx(0.654, rel=0.01)
    assert quality.diverges_at_s is None
    # These walks begin straight: positions alone turn them over (16 m and 170 deg).
    ((track,),) = (w.read(0.01) for w in find_vio_walks([data_dir / "advio/tum10hz/advio-12"]))
    assert np.median(analyze(track).errors.position_m) < 2
