"""`transforms.json` as tools and people leave it: times, paths, cameras, scale, broken frames."""

import json

import numpy as np
import pytest
from tests.importers.sources import COUNT, make_nerfstudio, read_walks, texts, walk
from tests.scene.scenes import jpeg, make_scene

from vioapr.errors import FormatError
from vioapr.formats import conventions
from vioapr.geometry import quaternion
from vioapr.importers.nerfstudio import IMPORTER
from vioapr.importers.write import write_recording
from vioapr.scene.check import check_scene


@pytest.fixture
def capture(tmp_path):
    return make_nerfstudio(tmp_path / "capture")


def change(capture, edit):
    path = capture / "transforms.json"
    content = json.loads(path.read_text())
    edit(content, content["frames"])
    path.write_text(json.dumps(content))


def read_one(capture, **options):
    (found,) = read_walks(IMPORTER, capture, **options)
    return found


def written(tmp_path, found):
    """The frames of a walk that was written into a scene, which passes the check."""
    scene = write_recording(make_scene(tmp_path / "scene", 3), found)
    assert not check_scene(scene.folder).errors
    return scene.recording(found.id).frames


@pytest.mark.parametrize(
    ("key", "factor", "unit"),
    [
        ("timestamp", 1, "s"),
        ("timestamp", 1e9, "ns"),
        ("timestamp_ms", 1e3, "ms"),
        ("time", 1, "s"),
    ],
)
def test_timestamps(key, factor, unit, capture):
    def edit(_, frames):
        for k, frame in enumerate(reversed(frames)):
            frame[key] = (30 + k / 10) * factor

    change(capture, edit)
    found = read_one(capture)
    assert found.info.clock == "device"
    np.testing.assert_allclose(found.timestamp_s, 30 + np.arange(COUNT) / 10)
    # In the order of time, which is the reverse of the names'.
    assert found.image_names[0] == f"{COUNT - 1}.jpg"
    assert f"time: from the file, in {unit}" in texts(found, warnings=False)
    assert found.info.is_metric


def test_a_time_from_0_to_1_is_an_animations(capture):
    change(capture, lambda _, frames: [f.update(time=k / 19) for k, f in enumerate(frames)])
    found = read_one(capture)
    assert found.info.clock == "frame-rate"
    assert not found.info.is_metric


def test_repeated_and_missing_timestamps_cost_their_frames(capture):
    def edit(_, frames):
        for k, frame in enumerate(frames):
            frame["timestamp"] = 5 + k / 10
        frames[4]["timestamp"] = frames[3]["timestamp"]
        del frames[9]["timestamp"]

    change(capture, edit)
    found = read_one(capture)
    assert len(found) == COUNT - 2
    warning = texts(found, warnings=True)
    assert "2 frames are not whole" in warning
    assert "transforms.json:5: the frame images/4.jpg has a timestamp that came before" in warning
    assert "transforms.json:10: the frame images/9.jpg has no timestamp: left out" in warning


def test_a_rate_that_is_given_counts(capture):
    change(capture, lambda _, frames: [f.update(timestamp=5.0 + k) for k, f in enumerate(frames)])
    found = read_one(capture, rate_hz=4)
    assert found.timestamp_s[:2].tolist() == [0, 0.25]
    assert "no timestamps" not in texts(found, warnings=True)


@pytest.mark.parametrize(
    "path_of",
    [
        lambda k: f".\\images\\{k}.jpg",
        lambda k: f"C:\\Users\\me\\scan\\images\\{k}.jpg",
        lambda k: f"/home/me/scan/images/{k}.jpg",
        lambda k: f"./data/images/{k}.jpg",
        lambda k: f"{k}.jpg",
        lambda k: f"images/{k}.JPG",
        lambda k: f"images/{k}.png",
        lambda k: f"images/{k}",
        lambda k: f"../elsewhere/images/{k}",
    ],
)
def test_paths_of_another_place(path_of, capture):
    change(
        capture, lambda _, frames: [f.update(file_path=path_of(k)) for k, f in enumerate(frames)]
    )
    found = read_one(capture)
    assert found.images == [capture / f"images/{k}.jpg" for k in range(COUNT)]


def test_a_path_of_which_several_images_could_be_meant(capture, tmp_path):
    for folder in ("a", "b"):
        (capture / folder).mkdir()
        (capture / folder / "7.jpg").write_bytes(jpeg())
    (capture / "images/7.jpg").unlink()
    found = read_one(capture)
    assert "several images could be meant, the first is images/7.jpg" in texts(found, warnings=True)
    frames = written(tmp_path, found)
    assert np.flatnonzero(~frames.has_image).tolist() == [7]
    missing = f"{capture}/images/7.jpg: no file of this name"
    assert missing in texts(found, warnings=True)


def test_images_of_a_kind_that_is_not_read(capture, tmp_path):
    (capture / "images/4.jpg").rename(capture / "images/4.webp")
    (capture / "images/4.webp").write_bytes(b"RIFF\x10\0\0\0WEBPVP8 ")
    change(capture, lambda _, frames: frames[4].update(file_path="images/4.webp"))
    found = read_one(capture)
    assert np.flatnonzero(~written(tmp_path, found).has_image).tolist() == [4]
    assert "4.webp: expected a JPEG or PNG image, got WebP: convert" in texts(found, warnings=True)


def test_splits_in_files_of_their_own(capture):
    content = (capture / "transforms.json").read_text()
    (capture / "transforms.json").rename(capture / "transforms_train.json")
    assert read_one(capture).id == "capture_train"
    (capture / "transforms_test.json").write_text(content)
    with pytest.raises(FormatError, match=r"found transforms_test.json, transforms_train.json"):
        read_one(capture)
    assert read_one(capture / "transforms_test.json").id == "capture_test"


def test_upper_case_endings(capture, tmp_path):
    for path in (capture / "images").iterdir():
        path.rename(path.with_suffix(".JPG"))
    frames = written(tmp_path, read_one(capture))
    assert frames.has_image.all()


def test_two_frames_of_one_image(capture):
    change(capture, lambda _, frames: frames.append(dict(frames[3])))
    found = read_one(capture)
    assert len(found) == COUNT
    assert "the image images/3.jpg is entry 4's already: left out" in texts(found, warnings=True)


def test_images_of_one_name_in_two_folders(capture, tmp_path):
    (capture / "left").mkdir()
    (capture / "images/5.jpg").rename(capture / "left/4.jpg")
    change(capture, lambda _, frames: frames[5].update(file_path="left/4.jpg"))
    frames = written(tmp_path, read_one(capture))
    assert len(set(frames.image)) == COUNT


def test_nothing_is_found(capture, tmp_path):
    for path in (capture / "images").iterdir():
        path.unlink()
    found = read_one(capture)
    with pytest.raises(
        FormatError, match=rf"none of 20 images can be used: {capture}/images/0.jpg"
    ):
        write_recording(make_scene(tmp_path / "scene", 3), found)


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (None, 'expected a "transform_matrix", found none'),
        ([[1, 2]], 'expected a "transform_matrix" of 4x4 numbers'),
        (np.full((4, 4), np.nan).tolist(), "expected finite numbers"),
        (np.zeros((4, 4)).tolist(), "one not orthonormal"),
        (np.diag([1.0, 2.0, 1.0, 1.0]).tolist(), "one not orthonormal"),
        (np.diag([1.0, 1.0, -1.0, 1.0]).tolist(), "a mirror image"),
        ([[1, 0, 0, 3e12], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "expected a position within"),
    ],
)
def test_a_broken_matrix_costs_its_frame_the_pose(matrix, problem, capture, tmp_path):
    change(capture, lambda _, frames: frames[6].update(transform_matrix=matrix))
    found = read_one(capture)
    warning = texts(found, warnings=True)
    assert problem in warning
    assert "the frame images/6.jpg has no pose" in warning
    frames = written(tmp_path, found)
    assert np.flatnonzero(~frames.has_pose).tolist() == [6]
    assert frames.has_image.all()


@pytest.mark.parametrize("shape", [(3, 4), (16,), (12,)])
def test_matrices_of_other_shapes(shape, capture):
    def edit(_, frames):
        for frame in frames:
            flat = np.ravel(frame["transform_matrix"])[: int(np.prod(shape))]
            frame["transform_matrix"] = flat.reshape(shape).tolist()

    change(capture, edit)
    found = read_one(capture)
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)


def test_matrices_with_a_scale(capture):
    def edit(_, frames):
        for k, frame in enumerate(frames):
            matrix = np.array(frame["transform_matrix"])
            matrix[:3, :3] *= 2.5
            frame |= {"transform_matrix": matrix.tolist(), "timestamp": k / 10}

    change(capture, edit)
    found = read_one(capture)
    angles = quaternion.angle_between_deg(found.vio_from_cam.quat_xyzw, walk().quat_xyzw)
    assert angles.max() < 1e-5
    assert "the matrices have one of 2.5, taken off the rotations" in texts(found, warnings=False)
    assert not found.info.is_metric


def test_frames_without_a_path_are_left_out(capture):
    def edit(_, frames):
        del frames[2]["file_path"]
        frames[3] = "frame"

    change(capture, edit)
    found = read_one(capture)
    assert len(found) == COUNT - 2
    assert 'transforms.json:3: expected a frame with a text "file_path"' in texts(
        found, warnings=True
    )


@pytest.mark.parametrize("frames", [[], None, [{}], ["x"]])
def test_no_frames(frames, capture):
    def edit(content, _):
        content["frames"] = frames

    change(capture, edit)
    with pytest.raises(FormatError, match=r"transforms.json.*expected a (list|frame)"):
        read_one(capture)


def test_a_byte_order_mark(capture):
    path = capture / "transforms.json"
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert len(read_one(capture)) == COUNT


def drop_camera(content, *kept):
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        if key not in kept:
            content.pop(key, None)


@pytest.mark.parametrize(
    ("members", "camera"),
    [
        ({"fl_x": 20.0}, [16, 12, 20, 20, 8, 6]),
        ({"fl_y": 20.0, "cx": 7.5}, [16, 12, 20, 20, 8, 6]),
        ({"fl_x": 40.0, "w": 32, "h": 24}, [16, 12, 20, 20, 8, 6]),
        ({"camera_angle_x": 2 * np.arctan(0.4)}, [16, 12, 20, 20, 8, 6]),
        ({"camera_angle_x": 2 * np.arctan(0.4), "camera_angle_y": 2 * np.arctan(0.25)},
         [16, 12, 20, 24, 8, 6]),
        ({"camera_angle_x": 2 * np.arctan(0.4), "w": 64, "h": 48}, [16, 12, 20, 20, 8, 6]),
    ],
)  # fmt: skip
def test_cameras_that_are_not_complete(members, camera, capture, tmp_path):
    def edit(content, _):
        drop_camera(content)
        content |= members
        path.write_text(json.dumps(content))

    path = capture / "transforms.json"
    content = json.loads(path.read_text())
    edit(content, None)
    found = read_one(capture)
    np.testing.assert_allclose(np.array(written(tmp_path, found).intrinsics)[:, 3], camera)
    assert "taken to be the image's middle" in texts(found, warnings=False)
    assert ("from camera_angle_x" in texts(found, warnings=False)) == ("camera_angle_x" in members)


def test_cameras_of_single_frames(capture, tmp_path):
    change(capture, lambda _, frames: frames[4].update(fl_x=30, fl_y=31, cx=7, cy=5, w=16, h=12))
    cameras = np.array(written(tmp_path, read_one(capture)).intrinsics)
    assert cameras[2:, 4].tolist() == [30, 31, 7, 5]
    assert cameras[2:, 5].tolist() == [20, 21, 8, 6]


def test_fisheye_cameras_are_left_out(capture, tmp_path):
    change(capture, lambda content, _: content.update(camera_model="OPENCV_FISHEYE", k1=0.1))
    found = read_one(capture)
    assert np.isnan(written(tmp_path, found).intrinsics.fx).all()
    assert "the camera is OPENCV_FISHEYE" in texts(found, warnings=True)


def mark(**members):
    return lambda content, _: content.update(members)


def mark_frames(**members):
    return lambda _, frames: [frame.update(members) for frame in frames]


def to_distance_4(_, frames):
    matrices = np.array([frame["transform_matrix"] for frame in frames])
    matrices[:, :3, 3] *= 4 / np.linalg.norm(matrices[:, :3, 3], axis=1).mean()
    for frame, matrix in zip(frames, matrices.tolist(), strict=True):
        frame |= {"transform_matrix": matrix, "depth_file_path": "depth/0.png"}


@pytest.mark.parametrize(
    ("edit", "is_metric"),
    [
        (mark(), False),
        (mark_frames(colmap_im_id=3, depth_file_path="d.png", timestamp=5), False),
        (mark_frames(sharpness=30.0), False),
        (mark(aabb_scale=16), False),
        (mark(k1=0.05, k2=-0.1), False),
        (mark(ply_file_path="sparse_pc.ply"), False),
        (to_distance_4, False),
        (mark_frames(depth_file_path="d.png"), True),
        (mark_frames(depth_path="d.png"), True),
        (lambda content, frames: (mark(k1=0.05)(content, frames),
                                  mark_frames(depth_path="d.png")(content, frames)), False),
        (mark(depth_integer_scale=1.0), True),
        (lambda content, frames: (mark(aabb_scale=16)(content, frames),
                                  mark_frames(camera_linear_velocity=[0, 1, 0])(content, frames)),
         True),
        (lambda _, frames: [f.update(timestamp=9 + k) for k, f in enumerate(frames)], True),
        (mark(applied_transform=[[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]]), True),
    ],
)  # fmt: skip
def test_signs_of_whose_poses_they_are(edit, is_metric, capture):
    change(capture, edit)
    found = read_one(capture)
    assert found.info.is_metric == is_metric
    assert ("marked as not metric" in texts(found, warnings=True)) != is_metric
    assert read_one(capture, metric=True).info.is_metric


def test_what_nerfstudio_did_to_a_phones_poses_is_undone(capture):
    turn = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])

    def edit(content, frames):
        content |= {"applied_transform": turn[:3].tolist(), "applied_scale": 0.25}
        for frame in frames:
            matrix = turn @ np.array(frame["transform_matrix"])
            matrix[:3, 3] *= 0.25
            frame["transform_matrix"] = matrix.tolist()

    change(capture, edit)
    found = read_one(capture)
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    assert found.info.is_gravity_aligned
    notes = texts(found, warnings=False)
    assert "applied_scale 0.25 was undone" in notes
    assert "applied_transform was undone" in notes


def test_a_capture_of_nerfcapture_that_looks_down(capture):
    """Its world is ARKit's: y is up however the phone is held."""
    down = quaternion.from_rotvec(np.array([-np.pi / 2, 0.0, 0.0]))
    quats = np.broadcast_to(down, (COUNT, 4))
    poses = walk().target_from_source._replace(quat_xyzw=np.array(quats))
    matrices = poses.to_matrix().tolist()

    def edit(content, frames):
        content["depth_integer_scale"] = 1.0
        for k, (frame, matrix) in enumerate(zip(frames, matrices, strict=True)):
            frame |= {"transform_matrix": matrix, "timestamp": k / 10}

    change(capture, edit)
    found = read_one(capture)
    assert found.info.is_gravity_aligned
    assert (found.info.tracker, found.info.is_metric) == ("ARKit", True)
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(
        found.vio_from_cam.quat_xyzw, conventions.world_from_arcam(poses).quat_xyzw
    )


def test_numbers_that_are_none_in_json(capture):
    change(capture, lambda content, _: content.update(fl_x=float("nan"), fl_y=float("nan")))
    found = read_one(capture)
    assert len(found) == COUNT
    assert np.isnan(np.asarray(found.intrinsics.fx)).all()
