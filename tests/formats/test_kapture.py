"""kapture and LaMAR: the same columns, inverse poses, devices, rigs and images."""

import numpy as np
import pytest

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import rank_formats, read_trajectory

HEADER = "# kapture format: 1.1\n# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n"
LAMAR_HEADER = "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz, *covar\n"


def write(path, *lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def test_a_header_of_neither_is_refused_with_the_choices(tmp_path):
    header = "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz"
    path = write(tmp_path / "trajectories.txt", header, "0, cam, 1, 0, 0, 0, 1, 2, 3")
    assert {f.name: c for f, c in rank_formats(path)} == {"kapture": 0.5, "lamar": 0.5}
    with pytest.raises(FormatError, match=r"uncertain.*kapture \(50%\), lamar \(50%\)"):
        read_trajectory(path)
    assert read_trajectory(path, "kapture").position_m[0].tolist() == [-1, -2, -3]
    assert read_trajectory(path, "lamar").position_m[0].tolist() == [1, 2, 3]


def test_folders_and_images(tmp_path):
    folder = tmp_path / "sensors"
    rows = ("0001, cam0, 1, 0, 0, 0, -2, 0, 0", "0000, cam0, 1, 0, 0, 0, -1, 0, 0")
    write(folder / "trajectories.txt", HEADER, *rows)
    write(folder / "records_camera.txt", "# x", "0000, cam0, a/0.jpg", "0001, cam0, a/1.jpg")
    for path in (tmp_path, folder, folder / "trajectories.txt"):
        assert rank_formats(path)[0][0].name == "kapture"
        track = read_trajectory(path)
        assert track.position_m[:, 0].tolist() == [1, 2]  # in the order of timestamps
        assert track.names == ("a/0.jpg", "a/1.jpg")
        assert not track.is_timed  # 0, 1 count frames
    timed = read_trajectory(tmp_path, None, ReadOptions(rate_hz=2))
    assert timed.timestamp_s.tolist() == [0, 0.5]


def test_timestamps_of_a_clock(tmp_path):
    rows = [f"{1700000000000000 + 33333 * k}, cam0, 1, 0, 0, 0, {-k}, 0, 0" for k in range(5)]
    path = write(tmp_path / "trajectories.txt", HEADER, *rows)
    track = read_trajectory(path)
    assert track.is_timed
    np.testing.assert_allclose(track.timestamp_s, 1700000000 + 0.033333 * np.arange(5), atol=1e-6)


def test_several_devices_need_a_choice(tmp_path):
    path = write(
        tmp_path / "trajectories.txt",
        HEADER,
        *(f"{k}, cam{c}, 1, 0, 0, 0, {-10 * c - k}, 0, 0" for k in range(3) for c in range(2)),
    )
    with pytest.raises(ParameterError, match="several devices.*`sequence`: cam0, cam1"):
        read_trajectory(path)
    track = read_trajectory(path, None, ReadOptions(sequence="cam1"))
    assert track.position_m[:, 0].tolist() == [10, 11, 12]
    with pytest.raises(ParameterError, match="no device 'cam7': expected one of cam0, cam1"):
        read_trajectory(path, None, ReadOptions(sequence="cam7"))


@pytest.mark.parametrize(
    ("header", "rig_pose", "mount"),
    [
        # The rig is at (1, 0, 0), its camera 0.5 m to the right of it.
        (HEADER, "-1, 0, 0", "-0.5, 0, 0"),
        (LAMAR_HEADER, "1, 0, 0", "0.5, 0, 0"),
    ],
    ids=["kapture", "lamar"],
)
def test_a_rigs_camera(header, rig_pose, mount, tmp_path):
    path = write(tmp_path / "trajectories.txt", header, f"0, rig, 1, 0, 0, 0, {rig_pose}")
    rigs = [f"rig, left, 1, 0, 0, 0, {mount}", "rig, wifi, 1, 0, 0, 0, 9, 9, 9"]
    write(tmp_path / "rigs.txt", "# kapture format: 1.1", *rigs)
    write(tmp_path / "sensors.txt", "left, , camera, PINHOLE, 640, 480", "wifi, , wifi")
    track = read_trajectory(path)
    assert (track.position_m[0].tolist(), track.source) == ([1.5, 0, 0], "cam")
    write(tmp_path / "rigs.txt", *rigs, f"rig, right, 1, 0, 0, 0, {mount.replace('0.5', '0.7')}")
    write(tmp_path / "sensors.txt", "left, , camera", "right, , camera", "wifi, , wifi")
    notes = ReadingNotes()
    track = read_trajectory(path, None, ReadOptions(notes=notes))
    assert (track.position_m[0].tolist(), track.source) == ([1, 0, 0], "rig")
    assert "choose a camera with `sequence`: left, right" in notes.warnings[0]
    track = read_trajectory(path, None, ReadOptions(sequence="right"))
    np.testing.assert_allclose(track.position_m[0], [1.7, 0, 0])


def test_poses_that_are_not_known(tmp_path):
    path = write(
        tmp_path / "trajectories.txt",
        HEADER,
        "0, cam, 1, 0, 0, 0, 0, 0, 0",
        "1, cam, , , , , , ,",
        "2, cam, 1, 0, 0, 0, 0, 0, 0",
    )
    notes = ReadingNotes()
    assert len(read_trajectory(path, None, ReadOptions(notes=notes))) == 2
    assert notes.warnings == ["1 row has no pose (line 5): left out"]
    with pytest.raises(FormatError, match=":5: expected finite numbers"):
        read_trajectory(path, None, ReadOptions(strict=True))


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("0, cam, 1, 0, 0, 0, 0, 0", "expected 9 to 99 columns"),
        ("0, cam, x, 0, 0, 0, 0, 0, 0", "expected a number, got 'x'"),
        ("0, cam, 2, 0, 0, 0, 0, 0, 0", "expected a unit quaternion"),
        ("", "the file is empty"),
    ],
)
def test_malformed(row, problem, tmp_path):
    path = write(tmp_path / "trajectories.txt", HEADER, row)
    with pytest.raises(FormatError, match=problem):
        read_trajectory(path, "kapture")


def test_an_empty_table_of_rigs(tmp_path):
    path = write(tmp_path / "trajectories.txt", HEADER, "0, cam, 1, 0, 0, 0, -4, 0, 0")
    write(tmp_path / "rigs.txt", "# kapture format: 1.1")
    assert read_trajectory(path).position_m[0].tolist() == [4, 0, 0]


def test_the_published_sample(tmp_path):
    """naver/kapture, samples/7scenes: the second frame of stairs/seq-01, and Microsoft's matrix.

    7-Scenes' poses are of the depth camera, which is the rig's origin; the colour camera is beside.
    """
    write(
        tmp_path / "trajectories.txt",
        "# kapture format: 1.0",
        "       1, kinect, 0.966589056988121, 0.18692042310929569, -0.13435986392887625,"
        " -0.112755387013086, 1.465352943503805, 0.031223161486779567, 0.5677286745629248",
    )
    rigs = [
        "kinect, kinect_rgb, -0.9999829690719851, -0.004080640735846227, 0.00394659107519435,"
        " 0.0013543840101732576, -0.025558943178152542, 0.00010109636268061706,"
        " 0.002031832172948704",
        "kinect, kinect_depth,  1.0,  0.0,  0.0,  0.0,  0.0,  0.0,  0.0",
    ]
    write(tmp_path / "rigs.txt", "# kapture format: 1.0", *rigs)
    kinds = [
        "kinect_rgb, kinect_rgb, camera, PINHOLE",
        "kinect_depth, kinect_depth, depth, PINHOLE",
    ]
    write(tmp_path / "sensors.txt", *kinds)
    write(tmp_path / "records_camera.txt", "1, kinect, frame-000001.color.jpg")
    published = [
        [9.3841040e-1, -2.6818979e-1, 2.1757449e-1, -1.4903431],
        [1.6773692e-1, 9.0464264e-1, 3.9162564e-1, -4.9640700e-1],
        [-3.0187285e-1, -3.3102760e-1, 8.9394891e-1, -5.4840837e-2],
    ]
    colour = read_trajectory(tmp_path)
    assert (colour.names, colour.source) == (("frame-000001.color.jpg",), "cam")
    offset = colour.position_m[0] - [row[3] for row in published]
    assert np.linalg.norm(offset) == pytest.approx(0.0256, abs=1e-4)
    (tmp_path / "rigs.txt").unlink()
    depth = read_trajectory(tmp_path)
    matrix = depth.target_from_source.to_matrix()[0, :3]
    np.testing.assert_allclose(matrix, published, atol=1e-4)
