"""Stray Scanner and Record3D: poses, images, intrinsics and sensors of an iPhone."""

import json
import shutil
import sys
import zipfile

import numpy as np
import pytest
from tests.importers.sources import (
    COUNT,
    device_imu,
    make_record3d,
    make_stray,
    read_walks,
    texts,
    walk,
)
from tests.scene.scenes import jpeg

from vioapr.errors import FileMissingError, FormatError, MissingExtraError
from vioapr.files.tables import format_rows
from vioapr.formats import stray
from vioapr.geometry import quaternion
from vioapr.importers.record3d import IMPORTER as RECORD3D
from vioapr.importers.stray import IMPORTER as STRAY
from vioapr.trajectory import Trajectory


@pytest.fixture
def stray_folder(tmp_path):
    return make_stray(tmp_path / "8653a2142b")


def write_imu(folder, unit=1.0):
    vio = walk()
    rows = np.column_stack([vio.timestamp_s, unit * device_imu(vio), np.full((COUNT, 3), 0.1)])
    header = "timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z\n"
    (folder / "imu.csv").write_text(header + format_rows(rows.tolist(), ", "))


def test_stray(stray_folder):
    (found,) = read_walks(STRAY, stray_folder)
    assert found.id == "8653a2142b"
    assert found.split == "train"
    assert found.info.tracker == "ARKit"
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(found.vio_from_cam.quat_xyzw, walk().quat_xyzw)
    assert found.image_names[3] == "000003.jpg"
    assert list(found.images)[3] == stray_folder / "rgb/000003.jpg"
    assert np.array(found.intrinsics)[2:, 0].tolist() == [20, 21, 8, 6]
    assert "20 frames: 20 with image, 20 with tracker's pose" in texts(found, warnings=False)
    assert "the tracker's +y is up" in texts(found, warnings=False)
    assert not texts(found, warnings=True)


@pytest.mark.parametrize(("unit", "title"), [(1.0, "in g"), (9.80665, "in m/s^2")])
def test_stray_accelerometer_points_up(unit, title, stray_folder):
    write_imu(stray_folder, unit)
    (found,) = read_walks(STRAY, stray_folder)
    notes = texts(found, warnings=False)
    assert f"accelerometer: {title}" in notes
    assert "accelerometer: agrees with the tracker's up to 0.0 deg" in notes
    np.testing.assert_allclose(np.linalg.norm(found.imu.accel_m_s2, axis=1), 9.80665)
    # Device x is the camera's -y: 0.1 rad/s about every device axis is -0.1 about the camera's.
    np.testing.assert_allclose(found.imu.gyro_rad_s, -0.1)


def test_stray_accelerometer_of_another_axis_order_is_reported(stray_folder):
    write_imu(stray_folder, -1.0)
    (found,) = read_walks(STRAY, stray_folder)
    assert "its up is 180 deg off the tracker's" in texts(found, warnings=True)


def look_down(folder, tilt_deg=90.0):
    """Turn the camera down by an angle, in odometry.csv; give the new track."""
    half = np.deg2rad(tilt_deg) / 2
    turn = np.array([-np.sin(half), 0.0, 0.0, np.cos(half)])
    vio = walk()
    down = Trajectory(
        vio.timestamp_s, vio.position_m, quaternion.multiply(vio.quat_xyzw, turn), target="vio"
    )
    stray.write(folder / "odometry.csv", down)
    return down


def test_stray_looking_down_without_an_accelerometer(stray_folder):
    look_down(stray_folder)
    (found,) = read_walks(STRAY, stray_folder)
    assert found.info.is_gravity_aligned
    assert "the tracker's +y is up by its definition" in texts(found, warnings=False)
    assert "gravity" not in texts(found, warnings=True)


def test_stray_an_accelerometer_that_says_otherwise(stray_folder):
    """The world is tilted by 40 degrees: poses are, and the accelerometer knows."""
    write_imu(stray_folder)
    look_down(stray_folder, 0.0)
    tilt = quaternion.from_rotvec(np.array([np.deg2rad(40.0), 0.0, 0.0]))
    vio = walk()
    tilted = Trajectory(
        vio.timestamp_s, quaternion.rotate(tilt, vio.position_m),
        quaternion.multiply(tilt, vio.quat_xyzw), target="vio",
    )  # fmt: skip
    stray.write(stray_folder / "odometry.csv", tilted)
    (found,) = read_walks(STRAY, stray_folder)
    assert not found.info.is_gravity_aligned
    assert "accelerometer: its up is 40 deg off the tracker's" in texts(found, warnings=True)


def test_stray_accelerometer_without_gravity_is_left_out(stray_folder):
    write_imu(stray_folder, 0.01)
    (found,) = read_walks(STRAY, stray_folder)
    assert "neither 1 g nor 9.81 m/s^2" in texts(found, warnings=True)
    assert np.isnan(found.imu.accel_m_s2).all()


def test_stray_intrinsics_of_every_frame(stray_folder):
    path = stray_folder / "odometry.csv"
    header, *rows = path.read_text().splitlines()
    rows = [f"{row}, {20 + k}, {21 + k}, 8, 6" for k, row in enumerate(rows)]
    path.write_text("\n".join([f"{header}, fx, fy, cx, cy", *rows]) + "\n")
    (found,) = read_walks(STRAY, stray_folder)
    assert found.intrinsics.fx.tolist() == list(range(20, 20 + COUNT))


def test_stray_missing_image(stray_folder):
    (stray_folder / "rgb/000004.jpg").unlink()
    (found,) = read_walks(STRAY, stray_folder)
    assert found.image_names[4] == ""
    assert "images: 1 frame has none, the first is frame 5" in texts(found, warnings=True)


def test_stray_images_of_no_frame(stray_folder):
    (stray_folder / "rgb/000099.jpg").write_bytes(jpeg())
    (found,) = read_walks(STRAY, stray_folder)
    assert "images: 1 in rgb/ belong to no frame" in texts(found, warnings=True)


def test_stray_without_pictures(stray_folder):
    shutil.rmtree(stray_folder / "rgb")
    with pytest.raises(FormatError, match=r"expected rgb.mp4, or a folder rgb/"):
        read_walks(STRAY, stray_folder)


def test_stray_broken_matrix(stray_folder):
    (stray_folder / "camera_matrix.csv").write_text("1, 2, 3\n4, 5, 6\n")
    with pytest.raises(FormatError, match=r"camera_matrix.csv: expected a 3x3 matrix, got 2 rows"):
        read_walks(STRAY, stray_folder)


def test_stray_broken_frame_number(stray_folder):
    path = stray_folder / "odometry.csv"
    path.write_text(path.read_text().replace(", 000003,", ", nan,"))
    with pytest.raises(FormatError, match=r"odometry.csv:5: expected a frame number, got 'nan'"):
        read_walks(STRAY, stray_folder)


def test_no_stray_folder(tmp_path):
    with pytest.raises(FileMissingError, match=r"odometry.csv: expected a file, found none"):
        read_walks(STRAY, tmp_path)


def write_video(path, count):
    av = pytest.importorskip("av", reason="PyAV is not installed (extra video)")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(count):
            pixels = np.full((48, 64, 3), 10 * k, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode())


@pytest.mark.parametrize("frames", [COUNT, COUNT - 5])
def test_stray_video(frames, stray_folder):
    shutil.rmtree(stray_folder / "rgb")
    write_video(stray_folder / "rgb.mp4", frames)
    (found,) = read_walks(STRAY, stray_folder)
    images = list(found.images)
    assert len(images) == COUNT
    assert images[3].shape == (48, 64, 3)
    # Frame k was painted 10 k.
    assert [round(float(image.mean()) / 10) for image in images[:10]] == list(range(10))
    expected = f"the video has {frames} frames and the odometry 20"
    assert (expected in texts(found, warnings=True)) == (frames != COUNT)
    assert [bool(name) for name in found.image_names].count(True) == frames


def test_stray_broken_video(stray_folder):
    pytest.importorskip("av", reason="PyAV is not installed (extra video)")
    shutil.rmtree(stray_folder / "rgb")
    (stray_folder / "rgb.mp4").write_bytes(b"no video")
    with pytest.raises(FormatError, match=r"rgb.mp4: cannot be read as a video"):
        read_walks(STRAY, stray_folder)


def test_without_pyav_a_video_says_what_to_install(stray_folder, monkeypatch):
    shutil.rmtree(stray_folder / "rgb")
    (stray_folder / "rgb.mp4").write_bytes(b"a video")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'vioapr\[video\]'"):
        read_walks(STRAY, stray_folder)


@pytest.fixture
def record3d_folder(tmp_path):
    return make_record3d(tmp_path / "capture")


@pytest.mark.parametrize("is_zip", [False, True])
def test_record3d(is_zip, record3d_folder, tmp_path):
    source = record3d_folder
    if is_zip:
        source = tmp_path / "capture.r3d"
        with zipfile.ZipFile(source, "w") as archive:
            for path in record3d_folder.rglob("*"):
                archive.write(path, path.relative_to(record3d_folder))
    (found,) = read_walks(RECORD3D, source)
    assert found.id == "capture"
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    assert found.image_names[12] == "000012.jpg"
    images = list(found.images)
    content = images[12] if is_zip else images[12].read_bytes()
    assert content == jpeg(shade=12)
    assert np.array(found.intrinsics)[:, 0].tolist() == [16, 12, 20, 21, 8, 6]
    assert not texts(found, warnings=True)


def change_metadata(folder, **changes):
    path = folder / "metadata"
    content = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))


def test_record3d_matrix_by_rows(record3d_folder):
    change_metadata(record3d_folder, K=[20, 0, 8, 0, 21, 6, 0, 0, 1])
    (found,) = read_walks(RECORD3D, record3d_folder)
    assert np.array(found.intrinsics)[:, 0].tolist() == [16, 12, 20, 21, 8, 6]


def test_record3d_intrinsics_of_every_frame(record3d_folder):
    change_metadata(
        record3d_folder, perFrameIntrinsicCoeffs=[[20 + k, 21, 8, 6] for k in range(COUNT)]
    )
    (found,) = read_walks(RECORD3D, record3d_folder)
    assert found.intrinsics.fx.tolist() == list(range(20, 20 + COUNT))


def test_record3d_without_clock(record3d_folder):
    change_metadata(record3d_folder, frameTimestamps=None, fps=5)
    (found,) = read_walks(RECORD3D, record3d_folder)
    assert found.timestamp_s[:3].tolist() == [0, 0.2, 0.4]
    assert found.info.clock == "frame-rate"
    assert "no timestamps" in texts(found, warnings=True)


def test_record3d_without_images(record3d_folder):
    shutil.rmtree(record3d_folder / "rgbd")
    with pytest.raises(FormatError, match=r"expected images rgbd/0.jpg"):
        read_walks(RECORD3D, record3d_folder)


def test_record3d_without_metadata(tmp_path):
    with pytest.raises(FormatError, match=r"expected a file metadata or metadata.json"):
        read_walks(RECORD3D, tmp_path)


def test_stray_rows_without_a_pose_are_lost_frames(stray_folder):
    path = stray_folder / "odometry.csv"
    lines = path.read_text().splitlines()
    for line in (1, 2, 7):
        fields = lines[line].split(", ")
        lines[line] = ", ".join([*fields[:2], *["nan"] * 7, *fields[9:]])
    path.write_text("\n".join(lines) + "\n")
    (found,) = read_walks(STRAY, stray_folder)
    assert len(found) == COUNT
    assert np.flatnonzero(~found.vio_from_cam.is_known).tolist() == [0, 1, 6]
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    assert found.image_names[6] == "000006.jpg"
    warning = texts(found, warnings=True)
    assert "3 rows have no pose" in warning
    assert "poses: 3 of 20 frames have none (tracking lost)" in warning


def test_stray_a_repeated_row_is_left_out(stray_folder):
    path = stray_folder / "odometry.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5], lines[4], *lines[5:]]) + "\n")
    (found,) = read_walks(STRAY, stray_folder)
    assert found.image_names == [f"{k:06d}.jpg" for k in range(COUNT)]
    assert "is a duplicate of one before" in texts(found, warnings=True)
    with pytest.raises(FormatError, match=r"odometry.csv:6: expected increasing timestamps"):
        read_walks(STRAY, stray_folder, strict=True)


def test_record3d_rows_without_a_pose_are_lost_frames(record3d_folder):
    poses = json.loads((record3d_folder / "metadata").read_text())["poses"]
    poses[4], poses[5] = [float("nan")] * 7, [0.0] * 7
    change_metadata(record3d_folder, poses=poses)
    (found,) = read_walks(RECORD3D, record3d_folder)
    assert np.flatnonzero(~found.vio_from_cam.is_known).tolist() == [4, 5]
    assert found.image_names[6] == "000006.jpg"
    assert list(found.images)[6] == record3d_folder / "rgbd/6.jpg"
    np.testing.assert_allclose(found.vio_from_cam.translation_m[6], walk().position_m[6])
    assert "2 rows have no pose" in texts(found, warnings=True)


def test_record3d_zips_that_are_damaged_or_bombs(record3d_folder, tmp_path, monkeypatch):
    """A member that does not unpack, or to too much, costs its frame the image."""
    source = tmp_path / "capture.r3d"
    with zipfile.ZipFile(source, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(record3d_folder / "metadata", "metadata")
        for k in range(COUNT):
            content = bytes(5_000_000) if k == 4 else jpeg(shade=k)
            archive.writestr(f"rgbd/{k}.jpg", content)
        archive.writestr(f"rgbd/{'9' * 5000}.jpg", b"x")
        archive.writestr("rgbd/../../7.jpg", b"outside")
        place = archive.getinfo("rgbd/9.jpg").header_offset
    content = bytearray(source.read_bytes())
    content[place + 60 : place + 90] = b"\xff" * 30
    source.write_bytes(content)
    monkeypatch.setattr("vioapr.importers.record3d._MAX_IMAGE_BYTES", 1_000_000)
    (found,) = read_walks(RECORD3D, source)
    images = list(found.images)
    assert [k for k, image in enumerate(images) if image == b""] == [4, 9]
    assert (images[3], images[7]) == (jpeg(shade=3), jpeg(shade=7))
