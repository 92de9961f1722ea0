"""Content in pictures: what hides what, what is cut away, where it stands, how far off it is."""

import numpy as np
import pytest
from PIL import Image

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.report.overlay.canvas import NEAR_M, Canvas, Pinhole, clip_at_near
from vioapr.report.overlay.content import displacement_m, find_seen, place_anchors
from vioapr.report.overlay.files import OverlayParams, find_palette, write_overlay
from vioapr.report.overlay.panels import describe, draw_content, draw_panels, format_length
from vioapr.report.overlay.sheet import choose_rows, choose_stretch
from vioapr.report.overlay.walk import (
    FUSED,
    RAW,
    TRUTH,
    OverlayWalk,
    carry_on,
    find_up,
    read_overlay_walk,
)
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.recording import Recording
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.anchors import Anchor
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

CAMERA = Pinhole(64, 48, 50.0, 50.0, 32.0, 24.0)
LEVEL_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
"""world_from_cam of a level camera that looks along the world's x axis."""
RED, BLUE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def square(depth_m, half_m=0.2, tilt_m=0.0):
    """Two triangles across the camera's axis; the right edge is `tilt_m` farther away."""
    left, right = [-half_m, depth_m], [half_m, depth_m + tilt_m]
    a, b = ([left[0], y, left[1]] for y in (-half_m, half_m))
    c, d = ([right[0], y, right[1]] for y in (half_m, -half_m))
    return np.array([[a, b, c], [a, c, d]])


def colored(triangles_m, color):
    return np.broadcast_to(color, triangles_m.shape)


def walk_of(poses, cameras=(CAMERA,), times=None, turns=0):
    count = len(next(iter(poses.values())).translation_m)
    cameras = cameras * count if len(cameras) == 1 else cameras
    times = np.arange(count) / 5 if times is None else times
    return OverlayWalk("walk", times, (), cameras, poses, np.array([0.0, 0.0, 1.0]), turns)


def levels(position_m):
    position_m = np.asarray(position_m, dtype=float)
    return Rigid3(position_m, np.tile(LEVEL_XYZW, (len(position_m), 1)))


class TestCanvas:
    @pytest.mark.parametrize("order", [1, -1])
    def test_the_nearer_surface_is_seen_in_whatever_order_they_are_drawn(self, order):
        canvas = Canvas(CAMERA)
        near, far = square(1.0, 0.1), square(2.0, 0.6)
        for triangles_m, color in [(near, RED), (far, BLUE)][::order]:
            canvas.draw(triangles_m, colored(triangles_m, color))
        layer = canvas.finish()
        assert layer.rgb[24, 32] == pytest.approx(RED)
        assert layer.rgb[24, 32 + 10] == pytest.approx(BLUE)  # 0.6 m at 2 m is 15 pixels
        assert layer.alpha[24, 32 + 20] == 0

    def test_surfaces_that_cross_each_other_hide_each_other_in_part(self):
        canvas = Canvas(CAMERA)
        for tilt_m, color in ((1.0, RED), (0.0, BLUE)):
            triangles_m = square(1.5 - tilt_m / 2, 0.3, tilt_m)
            canvas.draw(triangles_m, colored(triangles_m, color))
        layer = canvas.finish()
        assert layer.rgb[24, 27] == pytest.approx(RED)
        assert layer.rgb[24, 36] == pytest.approx(BLUE)

    def test_values_are_interpolated_in_space_not_in_the_picture(self):
        canvas = Canvas(CAMERA)
        triangles_m = square(1.0, 0.5, 1.0)
        values = np.broadcast_to((triangles_m[..., :1] + 0.5), triangles_m.shape)
        canvas.draw(triangles_m, values)
        # Half way in space is at x = 0, depth 1.5: the picture's middle. Half way between the
        # projected edges, 7 and 44.5 pixels, would be elsewhere.
        assert canvas.finish().rgb[24, 32, 0] == pytest.approx(0.5, abs=0.02)

    def test_what_reaches_behind_the_camera_is_cut_not_mirrored(self):
        ground = np.array([[[-5.0, 1.0, -5.0], [5.0, 1.0, -5.0], [0.0, 1.0, 50.0]]])
        canvas = Canvas(CAMERA)
        canvas.draw(ground, colored(ground, RED))
        alpha = canvas.finish().alpha
        assert alpha[-1, 32] == 1  # the ground before one's feet
        assert not alpha[:24].any()  # nothing above the horizon

    def test_what_is_behind_the_camera_is_not_seen(self):
        canvas = Canvas(CAMERA)
        behind = square(-1.0)
        canvas.draw(behind, colored(behind, RED))
        assert not canvas.finish().alpha.any()

    def test_a_shadow_darkens_the_picture_but_not_what_stands_before_it(self):
        canvas = Canvas(CAMERA)
        pillar, ground = square(1.0, 0.05), square(2.0, 0.6)
        canvas.draw(pillar, colored(pillar, RED))
        canvas.shade(ground, np.full((2, 3), 0.5))
        seen = canvas.finish().over(np.full((48, 64, 3), 200, np.uint8))
        assert tuple(seen[24, 32]) == (255, 0, 0)
        assert tuple(seen[24, 42]) == (100, 100, 100)
        assert tuple(seen[2, 2]) == (200, 200, 200)

    def test_edges_are_smooth(self):
        canvas = Canvas(CAMERA)
        slope = np.array([[[-1.0, -0.5, 1.0], [1.0, 0.1, 1.0], [-1.0, 1.0, 1.0]]])
        canvas.draw(slope, colored(slope, RED))
        assert ((canvas.finish().covered > 0) & (canvas.finish().covered < 1)).any()


@pytest.mark.parametrize("inside", [1, 2])
def test_clipping_keeps_what_is_before_the_camera(inside):
    depths = [1.0] * inside + [-1.0] * (3 - inside)
    triangle_m = np.array([[[0.0, 0.0, depths[0]], [1.0, 0.0, depths[1]], [0.0, 1.0, depths[2]]]])
    clipped, values = clip_at_near(triangle_m, triangle_m[..., 2:])
    assert len(clipped) == inside  # a corner is cut off, or a corner is left
    assert clipped[..., 2].min() == pytest.approx(NEAR_M)
    assert values == pytest.approx(clipped[..., 2:])


def test_a_marker_stands_at_its_anchor_and_is_as_high_as_it_says():
    anchor = Anchor(position_m=(4.0, 0.0, -0.5), size_m=1.0)
    pose = levels([[0.0, 0.0, 0.0]]).at(0)
    covered = draw_content(CAMERA.resized(640), pose, (anchor,)).covered > 0.5
    rows, columns = np.flatnonzero(covered[:, 320]), np.nonzero(covered)[1]
    # Half a metre at 4 m is 62.5 pixels, above the horizon and below it.
    assert rows.min() == pytest.approx(240 - 62.5, abs=2)
    assert rows.max() == pytest.approx(240 + 62.5, abs=10)  # the ring is before the tip
    assert columns.mean() == pytest.approx(319.5, abs=4)


def test_content_hides_content_behind_it():
    near = Anchor(position_m=(2.0, 0.0, -0.5), size_m=1.0)
    far = Anchor(position_m=(4.0, 0.0, -0.5), size_m=1.0)
    pose = levels([[0.0, 0.0, 0.0]]).at(0)
    alone, both = (draw_content(CAMERA, pose, anchors) for anchors in ((near,), (near, far)))
    solid = alone.covered == 1
    assert both.rgb[solid] == pytest.approx(alone.rgb[solid])


def test_how_far_content_appears_from_its_place():
    anchor = Anchor(position_m=(5.0, 0.0, 0.0))
    truth = levels([[0.0, 0.0, 0.0]]).at(0)
    beside = levels([[0.0, 0.3, 0.0]]).at(0)
    assert displacement_m(beside, truth, anchor) == pytest.approx(0.3)
    turn = quaternion.from_rotvec(np.array([0.0, 0.0, np.deg2rad(2.0)]))
    turned = Rigid3(truth.translation_m, quaternion.multiply(turn, truth.quat_xyzw))
    assert displacement_m(turned, truth, anchor) == pytest.approx(5 * np.deg2rad(2.0), rel=1e-3)
    assert describe(turned, truth, anchor) == ["content: 17 cm off", "camera 0 cm, 2.0°"]
    assert describe(turned, None, anchor) == []
    assert describe(Rigid3.unknown(), truth, anchor) == ["no pose"]


def test_long_ways_are_in_metres():
    assert [format_length(m) for m in (0.004, 0.512, 9.99, 12.34)] == [
        "0 cm", "51 cm", "999 cm", "12.3 m",
    ]  # fmt: skip


class TestPlacing:
    def test_content_stands_on_the_way_that_the_cameras_look_along(self):
        position_m = np.stack([np.linspace(0, 20, 80), np.zeros(80), np.full(80, 1.6)], axis=1)
        walk = walk_of({FUSED: levels(position_m)})
        anchors = place_anchors(walk)
        for anchor in anchors:
            assert anchor.position_m[1:] == pytest.approx((0.0, 0.1), abs=1e-6)
            front = quaternion.rotate(np.array(anchor.quat_xyzw), np.array([1.0, 0, 0]))
            assert front == pytest.approx([-1, 0, 0], abs=0.01)  # towards who comes along
        seen = find_seen(walk, anchors).max(axis=1)
        assert (seen > 0).mean() > 0.5

    def test_content_stands_where_cameras_look_around_an_object(self):
        angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        turn = quaternion.from_rotvec(np.stack([0 * angles, 0 * angles, angles + np.pi], axis=-1))
        position_m = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        position_m += np.array([3, 2, 1])
        poses = Rigid3(position_m, quaternion.multiply(turn, np.tile(LEVEL_XYZW, (40, 1))))
        anchor, *_ = place_anchors(walk_of({FUSED: poses}))
        assert anchor.position_m == pytest.approx((3, 2, 1), abs=0.25)
        assert anchor.size_m < 0.5

    def test_the_truth_is_asked_where_there_is_one(self):
        position_m = np.stack([np.linspace(0, 20, 80), np.zeros(80), np.full(80, 1.6)], axis=1)
        poses = {FUSED: levels(position_m + np.array([50.0, 0, 0])), TRUTH: levels(position_m)}
        assert place_anchors(walk_of(poses))[0].position_m[0] < 25


class TestChoosing:
    def walk(self):
        position_m = np.stack([np.linspace(0, 20, 100), np.zeros(100), np.full(100, 1.5)], axis=1)
        return walk_of({FUSED: levels(position_m)})

    def test_frames_are_spread_over_those_that_see_content(self):
        anchors = (Anchor(position_m=(12.0, 0.0, 1.0)), Anchor(position_m=(19.0, 0.0, 1.0)))
        rows = choose_rows(self.walk(), anchors, 4)
        assert len(rows) == 4
        assert rows == sorted(rows)
        assert (find_seen(self.walk(), anchors)[rows].max(axis=1) > 0.2).all()

    def test_content_that_is_never_seen_leaves_all_frames_to_choose_from(self):
        assert choose_rows(self.walk(), (Anchor(position_m=(-5.0, 0.0, 0.0)),), 3) == [0, 34, 67]

    def test_a_film_shows_the_stretch_with_most_content(self):
        anchors = (Anchor(position_m=(12.0, 0.0, 1.0)),)
        rows = choose_stretch(self.walk(), anchors, 4.0)
        times = self.walk().timestamp_s[rows]
        assert times[-1] - times[0] == pytest.approx(3.8)
        assert find_seen(self.walk(), anchors)[rows].max() > 0.9


def test_the_tracker_carries_predictions_on_until_its_world_is_another():
    vio = levels([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0]])
    apr = levels([[np.nan] * 3, [11, 5, 0], [np.nan] * 3, [np.nan] * 3, [np.nan] * 3])
    apr.quat_xyzw[[0, 2, 3, 4]] = np.nan
    vio.translation_m[3], vio.quat_xyzw[3] = np.nan, np.nan
    carried = carry_on(apr, vio, np.array([0, 0, 0, 0, 1]))
    assert carried.is_known.tolist() == [False, True, True, False, False]
    assert carried.translation_m[2] == pytest.approx([12, 5, 0])


@pytest.mark.parametrize(
    ("world_axes", "up"),
    [
        (np.eye(3), [0, 0, 1]),
        ([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0, -1, 0]),  # OpenCV's axes for the world too
        ([[0, -1, 0], [0, 0, 1], [-1, 0, 0]], [0, 0, 1]),  # a desk filmed from above
    ],
)
def test_up_is_z_unless_all_pictures_would_be_of_the_sky(world_axes, up):
    level = quaternion.to_matrix(LEVEL_XYZW)
    quat = quaternion.from_matrix(np.asarray(world_axes, dtype=float) @ level)
    assert find_up(Rigid3(np.zeros((4, 3)), np.tile(quat, (4, 1)))) == pytest.approx(up)


@pytest.fixture
def recording(tmp_path):
    """Five portrait pictures of a sensor that lies on its side: the right edge is up."""
    rolled = quaternion.from_rotvec(np.array([0.0, 0.0, -np.pi / 2]))
    quat = quaternion.multiply(LEVEL_XYZW, rolled)
    poses = Rigid3(np.stack([np.arange(5.0), 0 * np.arange(5.0), 0 * np.arange(5.0)], 1), None)
    poses = poses._replace(quat_xyzw=np.tile(quat, (5, 1)))
    pixels = np.full((48, 64, 3), 90, np.uint8)
    pixels[:, 48:] = 250
    with RecordingWriter(tmp_path / "walk", RecordingInfo(tracker="ARKit")) as writer:
        for row in range(5):
            name = "" if row == 3 else f"{row}.png"
            writer.add_frame(
                row / 5, name, pixels if name else None, Tracking.NORMAL, poses.at(row),
                Intrinsics(64, 48, 50, 50, 32, 24) if row != 4 else Intrinsics(),
            )  # fmt: skip
    times = np.arange(5) / 5
    return tmp_path / "walk", Trajectory(times, poses.translation_m, poses.quat_xyzw)


def test_frames_without_image_are_left_out_and_cameras_are_completed(recording):
    folder, poses = recording
    walk = read_overlay_walk(Recording.open(folder), poses, focal_px=60)
    assert [path.name for path in walk.images] == ["0.png", "1.png", "2.png", "4.png"]
    assert walk.cameras[0].fx == 50
    assert walk.cameras[-1] == Pinhole(64, 48, 60, 60, 32, 24)


def test_an_unknown_focal_length_is_asked_for(recording):
    folder, poses = recording
    with pytest.raises(FormatError, match=r"frames.csv:6: .*give `focal_px`"):
        read_overlay_walk(Recording.open(folder), poses)


def test_poses_of_another_walk_are_refused(recording):
    folder, poses = recording
    later = Trajectory(poses.timestamp_s + 100, poses.position_m, poses.quat_xyzw)
    with pytest.raises(AssociationError, match="expected raw poses of its frames"):
        read_overlay_walk(Recording.open(folder), poses, raw=later, focal_px=60)


def test_pictures_are_turned_upright_with_their_labels(recording):
    folder, poses = recording
    walk = read_overlay_walk(Recording.open(folder), poses, poses, poses, focal_px=60)
    assert list(walk.poses) == [RAW, FUSED, TRUTH]
    anchor = Anchor(label="A", position_m=(4.0, 0.0, -0.4), size_m=0.8)
    panels = draw_panels(walk, 0, (anchor,), 96)
    assert [panel.size for panel in panels] == [(96, 128)] * 3
    truth = np.asarray(panels[-1]).astype(int)
    assert (truth[:24, 5] == 250).all()  # the sky, the sensor's right edge, is above
    is_content = np.ptp(truth, axis=2) > 60
    rows, columns = np.nonzero(is_content)
    assert columns.mean() == pytest.approx(48, abs=4)
    assert abs(rows.mean() - 64) < 12


def test_a_frame_without_pose_is_dark_and_says_so(recording):
    folder, poses = recording
    walk = read_overlay_walk(Recording.open(folder), poses.at_rows(slice(1, 5)), focal_px=60)
    dark, bright = (draw_panels(walk, row, (), 96)[0].getpixel((48, 100)) for row in (0, 1))
    assert dark[0] == pytest.approx(0.45 * 90, abs=1)
    assert bright[0] == 90


def test_one_palette_serves_content_that_no_sampled_frame_shows():
    palette = find_palette([Image.new("RGB", (60, 40), (90, 90, 90))])
    seen = Image.new("RGB", (1, 1), (47, 127, 214)).quantize(palette=palette).convert("RGB")
    assert np.abs(np.subtract(seen.getpixel((0, 0)), (47, 127, 214))).max() < 12


@pytest.mark.parametrize(
    ("values", "name"),
    [({"rows": 0}, "rows"), ({"width_px": 10}, "width_px"), ({"seconds": 0.0}, "seconds"),
     ({"rate_hz": float("nan")}, "rate_hz")],
)  # fmt: skip
def test_values_that_mean_nothing_are_refused(values, name):
    with pytest.raises(ParameterError, match=f"`{name}`: expected"):
        OverlayParams(**values)


def test_a_film_plays_in_real_time(recording, tmp_path):
    folder, poses = recording
    walk = read_overlay_walk(Recording.open(folder), poses, focal_px=60)
    anchors = (Anchor(position_m=(6.0, 0.0, -0.4)),)
    params = OverlayParams(width_px=64, seconds=5)
    assert write_overlay(tmp_path / "o.gif", walk, anchors, params) == 4
    with Image.open(tmp_path / "o.gif") as film:
        durations = []
        for number in range(film.n_frames):
            film.seek(number)
            durations.append(film.info["duration"])
    assert durations == [200, 200, 400, 200]  # the third is seen while a picture is missing
    pytest.importorskip("av", reason="PyAV is not installed")
    import av

    write_overlay(tmp_path / "o.mp4", walk, anchors, params)
    with av.open(str(tmp_path / "o.mp4")) as film:
        stream = film.streams.video[0]
        times = [float(frame.pts * stream.time_base) for frame in film.decode(stream)]
    assert times == pytest.approx([0, 0.2, 0.4, 0.8])
