"""Tables without names: what their rows tell, and a refusal of what they do not."""

import numpy as np
import pytest
from tests.cases_of import case_folder
from tests.formats.test_inspection import make_walk

from vioapr.errors import FormatError
from vioapr.files.tables import format_rows
from vioapr.formats import conventions
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, rank_formats, read_with_notes
from vioapr.formats.table_guess import find_matrix, is_index
from vioapr.geometry import quaternion, rigid
from vioapr.trajectory import Trajectory

WXYZ, XYZW = [3, 0, 1, 2], [0, 1, 2, 3]


def write_poses(tmp_path, walk, order, delimiter=",", scale=1.0, name="track.csv", extra=0):
    path = tmp_path / name
    columns = [walk.position_m, walk.quat_xyzw[:, order], np.zeros((len(walk), extra))]
    rows = np.column_stack(columns).tolist()
    times = walk.timestamp_s.tolist()
    if scale != 1:
        times = [round(time * scale) for time in times]
    path.write_text(format_rows([(t, *r) for t, r in zip(times, rows, strict=True)], delimiter))
    return path


def assert_same(read, walk, tolerance=1e-9):
    np.testing.assert_allclose(read.position_m, walk.position_m, rtol=0, atol=tolerance)
    assert rigid.angle_deg(read.target_from_source, walk.target_from_source).max() < 1e-4
    if read.is_timed:
        np.testing.assert_allclose(read.timestamp_s, walk.timestamp_s, rtol=0, atol=1e-6)


@pytest.fixture(scope="module")
def walk():
    return make_walk()


@pytest.fixture(scope="module")
def short():
    """A second of motion in a random rotation tells no order."""
    return make_walk(15)


@pytest.mark.slow
@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
@pytest.mark.parametrize("scale", [1, 1000, 1e9])
@pytest.mark.parametrize("extra", [0, 3])
def test_motion_tells_tum_with_any_delimiter(delimiter, scale, extra, walk, tmp_path):
    reading = read_with_notes(write_poses(tmp_path, walk, XYZW, delimiter, scale, extra=extra))
    assert reading.format.name == "tum"
    assert reading.confidence >= 0.8
    assert_same(reading.trajectory, walk)


def test_motion_tells_euroc(walk, tmp_path):
    for scale in (1, 1e9):
        reading = read_with_notes(write_poses(tmp_path, walk, WXYZ, scale=scale))
        assert reading.format.name == "euroc"
        assert_same(reading.trajectory, walk)


def test_motion_tells_advio(walk, tmp_path):
    """The quaternion's order, and camera axes that look along -z."""
    turned = walk.with_transforms(conventions.world_from_arcam(walk.target_from_source))
    reading = read_with_notes(write_poses(tmp_path, turned, WXYZ))
    assert reading.format.name == "advio-vio"
    assert_same(reading.trajectory, walk)


def test_motion_against_the_convention_of_spaces_is_refused(walk, tmp_path):
    with pytest.raises(FormatError, match=r"uncertain: it may be euroc \(50%\), tum \(40%\)"):
        read_with_notes(write_poses(tmp_path, walk, WXYZ, " ", name="track.txt"))


@pytest.mark.parametrize("order", [XYZW, WXYZ])
@pytest.mark.parametrize("scale", [1, 1e9])
def test_a_short_walk_is_refused_with_the_choices(order, scale, short, tmp_path):
    path = write_poses(tmp_path, short, order, scale=scale)
    with pytest.raises(FormatError, match="its format is uncertain: it may be .*tum .*choose with"):
        read_with_notes(path)
    name = "tum" if order == XYZW else "euroc"
    assert_same(read_with_notes(path, name).trajectory, short)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", ", "])
def test_tum_on_demand_takes_any_delimiter(delimiter, short, tmp_path):
    path = write_poses(tmp_path, short, XYZW, delimiter)
    assert_same(read_with_notes(path, "tum").trajectory, short)


def test_velocities_in_nanoseconds_are_euroc(short, tmp_path):
    path = write_poses(tmp_path, short, WXYZ, scale=1e9, extra=9)
    reading = read_with_notes(path)
    assert reading.format.name == "euroc"
    assert reading.notes[0].text == "9 further columns were passed over"


def test_vins_ends_its_rows_with_a_comma(short, tmp_path):
    path = write_poses(tmp_path, short, WXYZ, scale=1e9, extra=3)
    path.write_text(path.read_text().replace("\n", ",\n"))
    reading = read_with_notes(path)
    assert reading.format.name == "euroc"
    assert reading.notes[0].text == "3 further columns were passed over"


def test_lost_rows_do_not_hide_the_format(walk, tmp_path):
    for nothing in ("nan", "0"):
        path = write_poses(tmp_path, walk, XYZW)
        lines = path.read_text().splitlines()
        lines[:40] = [line.split(",")[0] + f",{nothing}" * 7 for line in lines[:40]]
        path.write_text("\n".join(lines) + "\n")
        reading = read_with_notes(path)
        assert reading.format.name == "tum"
        assert len(reading.trajectory) == len(walk) - 40


def matrices_of(walk, count):
    return walk.target_from_source.to_matrix()[:, : count // 4, :]


@pytest.mark.slow
@pytest.mark.parametrize("count", [12, 16])
@pytest.mark.parametrize("first", ["none", "index", "seconds", "nanoseconds"])
@pytest.mark.parametrize("is_transposed", [False, True])
@pytest.mark.parametrize("delimiter", [" ", ","])
def test_rows_of_matrices(count, first, is_transposed, delimiter, walk, tmp_path):
    matrices = matrices_of(walk, count)
    matrices = np.swapaxes(matrices, 1, 2) if is_transposed else matrices
    entries = matrices.reshape(len(walk), -1).tolist()
    leading = {
        "none": [[] for _ in entries],
        "index": [[i] for i in range(len(walk))],
        "seconds": [[t] for t in walk.timestamp_s.tolist()],
        "nanoseconds": [[int(t * 10) * 10**8 + 1700000000 * 10**9] for t in walk.timestamp_s],
    }[first]
    rows = [[*a, *b] for a, b in zip(leading, entries, strict=True)]
    path = tmp_path / "poses.txt"
    path.write_text(format_rows(rows, delimiter))
    reading = read_with_notes(path)
    read = reading.trajectory
    assert reading.format.name == "kitti"
    assert read.is_timed == (first in ("seconds", "nanoseconds"))
    if first == "nanoseconds":
        read = Trajectory.from_arrays(read.timestamp_s - 1.7e9, read.position_m, read.quat_xyzw)
    assert_same(read, walk)
    assert any("column by column" in note.text for note in reading.notes) == is_transposed


def test_an_index_before_a_matrix_becomes_time_by_rate_or_unit(walk, tmp_path):
    path = tmp_path / "poses.txt"
    rows = matrices_of(walk, 12).reshape(len(walk), 12).tolist()
    path.write_text(format_rows([(i, *row) for i, row in enumerate(rows)], " "))
    assert not read_with_notes(path).trajectory.is_timed
    by_rate = read_with_notes(path, options=ReadOptions(rate_hz=10)).trajectory
    assert by_rate.timestamp_s[:3].tolist() == [0, 0.1, 0.2]
    by_unit = read_with_notes(path, options=ReadOptions(time_unit="s")).trajectory
    assert by_unit.timestamp_s[:3].tolist() == [0, 1, 2]
    assert is_index(np.array([0.0, 1, 2, 5, 6]))
    assert not is_index(np.array([0.0, 0.1]))
    assert not is_index(np.array([33.0, 66, 100]))


def test_sixteen_numbers_must_end_in_0_0_0_1(walk):
    matrices = matrices_of(walk, 16).reshape(len(walk), 16).copy()
    assert find_matrix(matrices).first == 0
    matrices[:, 15] = 2
    assert find_matrix(matrices) is None


def test_seventeen_columns_of_euroc_are_no_matrix(walk, tmp_path):
    path = write_poses(tmp_path, walk, WXYZ, scale=1e9, extra=9)
    assert rank_formats(path)[0][0].name == "euroc"


@pytest.mark.parametrize("name", ["arkit-logger", "arcore-logger"])
def test_data_loggers_are_told_by_name(name, walk, tmp_path):
    format_ = FORMATS[name]
    path = tmp_path / format_.default_for[0]
    format_.write(path, walk)
    reading = read_with_notes(path)
    assert (reading.format.name, reading.confidence) == (name, 1.0)
    assert reading.trajectory.target == "vio"
    assert_same(reading.trajectory, walk)


def test_a_renamed_log_of_arkit_is_told_by_the_motion(walk, short, tmp_path):
    path = tmp_path / "poses.txt"
    FORMATS["arkit-logger"].write(path, walk)
    for header in ("# timestamp_ns r11", "# Created"):
        path.write_text(path.read_text().replace("# timestamp_ns r11", header))
        reading = read_with_notes(path)
        assert (reading.format.name, reading.confidence) == ("arkit-logger", 0.7)
        assert_same(reading.trajectory, walk)
    FORMATS["arkit-logger"].write(path, short)
    with pytest.raises(FormatError, match=r"may be kitti \(50%\), arkit-logger \(50%\): choose"):
        read_with_notes(path)
    assert_same(read_with_notes(path, "arkit-logger").trajectory, short)


def test_a_quaternion_first_without_a_name_is_refused(walk, tmp_path):
    path = tmp_path / "poses.txt"
    FORMATS["arcore-logger"].write(path, walk)
    with pytest.raises(FormatError, match=r"uncertain: it may be arcore-logger \(50%\)"):
        read_with_notes(path)


def test_real_logs(data_dir, tmp_path):
    folder = data_dir / "arkit_arcore_loggers"
    arkit = read_with_notes(folder / "ARKit_camera_pose.txt.gz")
    assert arkit.format.name == "arkit-logger"
    assert len(arkit.trajectory) == 2762
    assert np.median(np.diff(arkit.trajectory.timestamp_s)) == pytest.approx(1 / 60, rel=0.05)
    renamed = tmp_path / "log.txt.gz"
    renamed.write_bytes((folder / "ARKit_camera_pose.txt.gz").read_bytes())
    with pytest.raises(FormatError, match=r"it may be kitti \(50%\), arkit-logger \(50%\)"):
        read_with_notes(renamed)
    arcore = read_with_notes(folder / "ARCore_sensor_pose.txt")
    assert arcore.format.name == "arcore-logger"
    assert len(arcore.trajectory) == 666
    assert np.median(np.diff(arcore.trajectory.timestamp_s)) == pytest.approx(1 / 20, rel=0.05)
    for reading in (arkit, arcore):
        # People hold phones level and walk where they look.
        assert reading.warnings == []
        down = quaternion.rotate(reading.trajectory.quat_xyzw, np.array([0.0, 1.0, 0.0]))
        side = quaternion.rotate(reading.trajectory.quat_xyzw, np.array([1.0, 0.0, 0.0]))
        assert max(abs(np.median(down[:, 1])), abs(np.median(side[:, 1]))) > 0.75


def test_the_case_of_commas():
    folder = case_folder("01-comma-tum")
    truth = read_with_notes(folder / "truth.tum").trajectory
    with pytest.raises(FormatError, match="uncertain: it may be tum .* advio-vio"):
        read_with_notes(folder / "track.csv")
    read = read_with_notes(folder / "track.csv", "tum").trajectory
    assert_same(read, truth)
    assert read.position_m[0].tolist() == [0, 1.5, -0.036667]


def test_the_case_of_the_data_logger():
    path = case_folder("04-arkit-data-logger-13-columns") / "ARKit_camera_pose.txt"
    reading = read_with_notes(path)
    read = reading.trajectory
    assert len(read) == 150
    assert read.timestamp_s[[0, -1]] == pytest.approx([105230.5, 105235.467], abs=1e-3)
    assert read.target == "vio"
    # As ARKit's camera looks along -z: its matrix's third column is turned round.
    forward = quaternion.rotate(read.quat_xyzw[0], np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(forward, [-0.939693, -0.0476, -0.338692], atol=1e-5)


def test_the_case_of_cambridge_with_one_header_line():
    path = case_folder("05-cambridge-one-header-line") / "dataset_train.txt"
    read = read_with_notes(path).trajectory
    assert len(read) == 40
    assert read.names[0] == "seq1/frame00001.png"
    np.testing.assert_allclose(read.position_m[0], [0, 1.5, -0.036667])


def test_the_case_of_timestamped_matrices():
    reading = read_with_notes(case_folder("23-timestamped-4x4") / "poses.csv")
    assert len(reading.trajectory) == 80
    assert reading.trajectory.position_m[0].tolist() == [0, 0, 0]
    assert reading.trajectory.timestamp_s[0] == 1700000000
    assert [note.text for note in reading.notes] == ["times are nanoseconds"]
