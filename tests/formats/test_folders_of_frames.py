"""Apps and labels that are a folder with a file a frame: Polycam, 3D Scanner App, ScanNet."""

import json

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.errors import FileMissingError, FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.conversion import convert_file
from vioapr.formats.inspection import inspect_file
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import rank_formats, read_trajectory, read_with_notes

# A camera at (1, 2, 3) of ARKit's y-up world that looks along +x, level: its axes x right, y up,
# z backwards are the world's z, y, -x.
LOOKS_ALONG_X = [[0, 0, -1, 1], [0, 1, 0, 2], [1, 0, 0, 3], [0, 0, 0, 1]]
# The same with OpenCV axes in a z-up world: x right, y down, z forward are -y, -z, x.
OPENCV_Z_UP = [[0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 3], [0, 0, 0, 1]]


def write_polycam(folder, times_us, matrix=LOOKS_ALONG_X, name="cameras"):
    cameras = folder / "keyframes" / name
    cameras.mkdir(parents=True, exist_ok=True)
    for time_us in times_us:
        camera = {f"t_{i}{j}": matrix[i][j] for i in range(3) for j in range(4)}
        (cameras / f"{time_us}.json").write_text(json.dumps({**camera, "fx": 1000}))
    return folder


def write_scanner_app(folder, count, matrix=LOOKS_ALONG_X):
    folder.mkdir(exist_ok=True)
    for k in range(count):
        frame = {"time": 9000 + k / 10, "cameraPoseARFrame": np.ravel(matrix).tolist()}
        (folder / f"frame_{k:05d}.json").write_text(json.dumps(frame))
    return folder


def write_scannet(folder, matrices):
    folder.mkdir(parents=True, exist_ok=True)
    for k, matrix in matrices.items():
        text = "\n".join(" ".join(map(str, row)) for row in matrix)
        (folder / f"{k}.txt").write_text(text + "\n")
    return folder


def front_of(trajectory, row=0):
    """Where a point 1 m in front of a camera is, and one 1 m above it."""
    pose = trajectory.target_from_source.at(row)
    return pose.apply(np.array([0.0, 0, 1])), pose.apply(np.array([0.0, -1, 0]))


def test_polycam_by_hand(tmp_path):
    write_polycam(tmp_path / "capture", [105_000_000, 105_500_000, 106_000_000])
    (tmp_path / "capture" / "mesh_info.json").write_text("{}")
    for path in (tmp_path / "capture", tmp_path / "capture" / "keyframes"):
        assert rank_formats(path)[0][0].name == "polycam"
        track = read_trajectory(path)
        front, above = front_of(track)
        np.testing.assert_allclose(front, [2, 2, 3], atol=1e-12)
        np.testing.assert_allclose(above, [1, 3, 3], atol=1e-12)
        assert (track.target, track.source) == ("vio", "cam")
        assert track.timestamp_s.tolist() == [105, 105.5, 106]
        assert track.names == ("105000000.jpg", "105500000.jpg", "106000000.jpg")


def test_polycams_corrected_cameras_come_first(tmp_path):
    moved = np.array(LOOKS_ALONG_X)
    moved[0, 3] = 7
    write_polycam(tmp_path, [10**6, 2 * 10**6, 3 * 10**6])
    write_polycam(tmp_path, [10**6, 2 * 10**6], moved.tolist(), "corrected_cameras")
    reading = read_with_notes(tmp_path)
    assert reading.trajectory.position_m[:, 0].tolist() == [7, 7]
    assert any("after loop closure" in note.text for note in reading.notes)
    assert reading.warnings == ["corrected_cameras has 2 of 3 frames: the others are left out"]
    raw = read_trajectory(tmp_path / "keyframes" / "cameras")
    assert raw.position_m[:, 0].tolist() == [1, 1, 1]


def test_a_broken_frame_costs_itself_alone(tmp_path):
    for folder, written in (
        (write_polycam(tmp_path / "p", range(10**6, 10**7, 10**6)), "keyframes/cameras/4000000"),
        (write_scanner_app(tmp_path / "s", 9), "frame_00003"),
    ):
        (folder / f"{written}.json").write_text('{"time": 3')
        reading = read_with_notes(folder)
        assert len(reading.trajectory) == 8
        assert [row.line for row in reading.left_out] == [4]
        assert written.rsplit("/", 1)[-1] in reading.warnings[0]
        with pytest.raises(FormatError, match=written.rsplit("/", 1)[-1]):
            read_trajectory(folder, None, ReadOptions(strict=True))


def test_frames_without_the_pose_are_named(tmp_path):
    folder = write_scanner_app(tmp_path / "s", 3)
    (folder / "frame_00002.json").write_text('{"time": 9000.2}')
    reading = read_with_notes(folder)
    assert len(reading.trajectory) == 2
    assert 'frame_00002.json: expected a frame with "cameraPoseARFrame"' in reading.warnings[0]


@pytest.mark.parametrize("values", [[1] * 15, "text", [None] * 16])
def test_matrices_of_another_size(values, tmp_path):
    folder = write_scanner_app(tmp_path / "s", 1)
    content = json.dumps({"time": 1, "cameraPoseARFrame": values})
    (folder / "frame_00000.json").write_text(content)
    with pytest.raises(FormatError, match="list of 16 numbers"):
        read_trajectory(folder, "3dscannerapp")


def test_scanner_app_by_hand(tmp_path):
    folder = write_scanner_app(tmp_path / "scan", 3)
    (folder / "info.json").write_text('{"title": "desk"}')
    track = read_trajectory(folder)
    front, above = front_of(track)
    np.testing.assert_allclose(front, [2, 2, 3], atol=1e-12)
    np.testing.assert_allclose(above, [1, 3, 3], atol=1e-12)
    np.testing.assert_allclose(track.timestamp_s, [9000, 9000.1, 9000.2], rtol=0, atol=1e-9)
    assert track.names is not None
    assert track.names[1] == "frame_00001.jpg"


def test_the_case_of_3d_scanner_app():
    inspection = inspect_file(case_folder("20-3d-scanner-app"))
    assert (inspection.candidates[0].name, inspection.poses) == ("3dscannerapp", 30)
    assert inspection.frames == "vio_from_cam"
    assert inspection.is_timed
    assert inspection.start_s == 9000
    assert inspection.rate_hz == pytest.approx(10)
    assert inspection.up is not None
    assert inspection.up.axis == "+y"


def test_a_real_capture_of_3d_scanner_app(data_dir):
    track = read_trajectory(data_dir / "scanner_app_3d")
    assert len(track) == 92
    # A desk seen from above: the camera looks down, whatever else it does.
    forward = track.target_from_source.to_matrix()[:, :3, 2]
    assert (forward[:, 1] < -0.8).all()


def test_scannet_by_hand(tmp_path):
    write_scannet(tmp_path / "scan" / "pose", dict.fromkeys((0, 1, 2, 10), OPENCV_Z_UP))
    for path in (tmp_path / "scan", tmp_path / "scan" / "pose"):
        assert rank_formats(path)[0][0].name == "scannet"
        track = read_trajectory(path)
        front, above = front_of(track)
        np.testing.assert_allclose(front, [2, 2, 3], atol=1e-12)
        np.testing.assert_allclose(above, [1, 2, 4], atol=1e-12)
        assert track.names == ("0.jpg", "1.jpg", "2.jpg", "10.jpg")
    timed = read_trajectory(tmp_path / "scan", None, ReadOptions(rate_hz=10))
    assert timed.timestamp_s.tolist() == [0, 0.1, 0.2, 1.0]


def test_scannets_frames_without_a_pose(tmp_path):
    lost = [["-inf"] * 4] * 4
    write_scannet(tmp_path, {0: OPENCV_Z_UP, 1: lost, 2: lost, 3: OPENCV_Z_UP})
    notes = ReadingNotes()
    track = read_trajectory(tmp_path, "scannet", ReadOptions(notes=notes))
    assert track.names == ("0.jpg", "3.jpg")
    assert [row.name for row in notes.left_out] == ["1.jpg", "2.jpg"]
    assert notes.warnings == ["2 rows have no pose (lines 2 to 3): left out"]
    with pytest.raises(FormatError, match="expected finite numbers"):
        read_trajectory(tmp_path, "scannet", ReadOptions(strict=True))


def test_numbered_texts_that_are_no_matrices_are_not_scannet(tmp_path):
    folder = tmp_path / "labels"
    folder.mkdir()
    (folder / "0.txt").write_text("0 0.5 0.5 0.2 0.2\n" * 4)
    assert rank_formats(folder) == []
    (folder / "0.txt").write_text("0 0.5 0.5 0.2\n" * 3)
    assert rank_formats(folder) == []
    with pytest.raises(FormatError, match="0.txt: expected a 4x4 matrix, got 3 rows"):
        read_trajectory(folder, "scannet")


@pytest.mark.parametrize("name", ["polycam", "3dscannerapp", "scannet"])
def test_folders_that_are_missing_or_empty(name, tmp_path):
    with pytest.raises(FileMissingError, match="found nothing of this name"):
        read_trajectory(tmp_path / "nowhere", name)
    with pytest.raises(FormatError, match="expected a folder of .*found none"):
        read_trajectory(tmp_path, name)
    (tmp_path / "file").write_text("x")
    with pytest.raises(FormatError, match="expected a folder of .*found a file: give the folder"):
        read_trajectory(tmp_path / "file", name)


def test_a_frame_alone_is_named(tmp_path):
    polycam = write_polycam(tmp_path / "p", [10**9]) / "keyframes" / "cameras" / f"{10**9}.json"
    scanner_app = write_scanner_app(tmp_path / "s", 2) / "frame_00001.json"
    for path, app in ((polycam, "Polycam"), (scanner_app, "3D Scanner App")):
        with pytest.raises(FormatError, match=f"{app}.*found a file: give the folder it is in"):
            read_trajectory(path)


def test_a_scannet_folder_is_written_by_number(tmp_path):
    source = write_polycam(tmp_path / "capture", [10**9, 10**9 + 10**6])
    done = convert_file(source, tmp_path / "out", target_format="scannet")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "1000000000.txt",
        "1001000000.txt",
    ]
    assert done.lost == ("timestamps",)
    done = convert_file(
        write_scanner_app(tmp_path / "s", 2), tmp_path / "o", target_format="scannet"
    )
    assert sorted(path.name for path in (tmp_path / "o").iterdir()) == ["0.txt", "1.txt"]
    assert done.lost == ("timestamps", "image names")


def test_formats_that_are_only_read_name_those_that_are_written(tmp_path):
    source = write_polycam(tmp_path / "capture", [10**6, 2 * 10**6])
    with pytest.raises(ParameterError, match="polycam files are only read.*`target_format`: tum"):
        convert_file(source, tmp_path / "out", target_format="polycam")
    with pytest.raises(ParameterError, match="scannetpp files are only read"):
        convert_file(source, tmp_path / "pose_intrinsic_imu.json")
