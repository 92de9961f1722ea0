"""ios_logger: poses at 60 Hz, frames at 30 Hz, an accelerometer and a gyroscope of their own."""

import numpy as np
import pytest
from tests.importers.sources import COUNT, device_imu, read_walks, texts, walk, write_images
from tests.importers.test_phones import write_video
from tests.scene.scenes import make_scene

from vioapr.errors import FileMissingError, FormatError
from vioapr.files.tables import format_rows
from vioapr.formats import ios_logger
from vioapr.importers.ios_logger import IMPORTER
from vioapr.importers.write import write_recording
from vioapr.scene.check import check_scene
from vioapr.trajectory import Trajectory

START_S = 1627530745.0


def rows_of(path, *columns):
    path.write_text(format_rows(np.column_stack(columns).tolist(), ","))


@pytest.fixture
def folder(tmp_path):
    """A recording: every second pose is of a frame."""
    folder = tmp_path / "2021-07-29T12-52-25"
    folder.mkdir()
    vio = walk()
    times = START_S + np.arange(2 * COUNT) / 60
    track = Trajectory(
        times, np.repeat(vio.position_m, 2, axis=0), np.repeat(vio.quat_xyzw, 2, axis=0),
        target="vio",
    )  # fmt: skip
    ios_logger.write(folder / "ARposes.txt", track)
    numbers = np.arange(COUNT)
    camera = [np.full(COUNT, value) for value in (20.0, 21.0, 8.0, 6.0)]
    rows_of(folder / "Frames.txt", times[::2], numbers, *camera)
    rows_of(folder / "Accel.txt", times[::2] + 0.004, device_imu(vio))
    rows_of(folder / "Gyro.txt", times[::2] + 0.002, np.full((COUNT, 3), 0.1))
    write_images(folder, [f"images/{k:05d}.jpg" for k in range(COUNT)])
    return folder


def read_one(folder, **options):
    (found,) = read_walks(IMPORTER, folder, **options)
    return found


def test_a_recording(folder, tmp_path):
    found = read_one(folder)
    np.testing.assert_allclose(found.timestamp_s, START_S + np.arange(COUNT) / 30)
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-9)
    assert found.image_names[3] == "00003.jpg"
    assert found.info.is_gravity_aligned
    notes = texts(found, warnings=False)
    assert "accelerometer: agrees with the tracker's up to 0.0 deg" in notes
    scene = write_recording(make_scene(tmp_path / "s", 3), found)
    assert not check_scene(scene.folder).errors
    frames = scene.recording(found.id).frames
    assert np.array(frames.intrinsics)[:, 4].tolist() == [16, 12, 20, 21, 8, 6]
    imu = scene.recording(found.id).imu
    assert len(imu.timestamp_s) == 2 * COUNT
    assert np.isfinite(imu.accel_m_s2).all(axis=1).sum() == COUNT
    # Device x is the camera's -y.
    np.testing.assert_allclose(imu.gyro_rad_s[0], -0.1)


def test_a_video(folder):
    for path in (folder / "images").iterdir():
        path.unlink()
    with pytest.raises(FormatError, match=r"expected Frames.m4v, or a folder images/"):
        read_one(folder)
    write_video(folder / "Frames.m4v", COUNT - 2)
    found = read_one(folder)
    assert [bool(name) for name in found.image_names].count(True) == COUNT - 2
    assert "the video has 18 frames and Frames.txt 20 rows" in texts(found, warnings=True)
    assert len(list(found.images)) == COUNT


def test_frames_without_a_pose_of_their_time_are_lost(folder):
    lines = (folder / "ARposes.txt").read_text().splitlines()
    (folder / "ARposes.txt").write_text("\n".join(lines[:10] + lines[16:]) + "\n")
    found = read_one(folder)
    assert np.flatnonzero(~found.vio_from_cam.is_known).tolist() == [5, 6, 7]


def test_a_broken_pose_is_lost(folder):
    path = folder / "ARposes.txt"
    lines = path.read_text().splitlines()
    for row in (8, 9):
        lines[row] = ",".join([lines[row].split(",")[0], *["nan"] * 7])
    path.write_text("\n".join(lines) + "\n")
    found = read_one(folder)
    assert np.flatnonzero(~found.vio_from_cam.is_known).tolist() == [4]
    assert "2 rows have no pose" in texts(found, warnings=True)


def test_older_recordings_have_no_intrinsics(folder):
    path = folder / "Frames.txt"
    path.write_text("".join(f"{','.join(r.split(',')[:2])}\n" for r in path.read_text().split()))
    assert np.isnan(read_one(folder).intrinsics.fx).all()


@pytest.mark.parametrize("columns", [3, 6, 9])
def test_satellite_positions(columns, folder):
    row = [START_S, 37.5, 127.0, 5.0, 60.0, 8.0, -9999, 100.0, 1.2]
    none = [START_S + 1, 0.0, 0.0, -1.0, 0.0, -1.0, -9999, -1.0, -1.0]
    (folder / "GPS.txt").write_text(
        "".join(",".join(map(str, r[:columns])) + "\n" for r in (row, none))
    )
    found = read_one(folder)
    assert found.gnss.latitude_deg[0] == 37.5
    assert len(found.gnss.timestamp_s) == (2 if columns == 3 else 1)
    if columns > 3:
        assert found.gnss.altitude_m.tolist() == [60.0]
        assert "GPS.txt: 1 row has no position" in texts(found, warnings=True)


def test_no_recording(tmp_path):
    with pytest.raises(FileMissingError, match=r"ARposes.txt: expected a file"):
        read_one(tmp_path)


def test_times_that_do_not_increase(folder):
    path = folder / "Frames.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:5], lines[2], *lines[5:]]) + "\n")
    with pytest.raises(FormatError, match=r"Frames.txt:6: expected increasing times"):
        read_one(folder)
