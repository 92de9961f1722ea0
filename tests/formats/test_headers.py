"""Headers that say something else than a pose are refused with the choices; matrices are read."""

import json

import numpy as np
import pytest
from tests.formats.test_inspection import make_walk

from vioapr.errors import FormatError
from vioapr.files.tables import format_rows
from vioapr.formats.inspection import inspect_file
from vioapr.formats.matrix_names import find_matrix_columns
from vioapr.formats.registry import rank_formats, read_trajectory, read_with_notes
from vioapr.geometry import rigid

WALK = make_walk(60)
MATRICES = WALK.target_from_source.to_matrix()
POSES = np.column_stack([WALK.timestamp_s, WALK.position_m, WALK.quat_xyzw])
PAIRS = [(r, c) for r in range(4) for c in range(4)]
REFUSED = (
    "a,b,c,d,e,f,g,h",
    "t,x,y,z,q1,q2,q3,q4",
    "timestamp,x,y,z,x,y,z,w",
    "timestamp,w,x,y,z,x,y,z",
    "Zeit,Ost,Nord,Hoehe,u,v,w,s",
)


def write(path, header, columns, delimiter=","):
    path.write_text(header + "\n" + format_rows(np.asarray(columns).tolist(), delimiter))
    return path


@pytest.mark.parametrize("header", REFUSED)
@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_names_that_nobody_understands_are_refused_with_the_choices(header, delimiter, tmp_path):
    path = write(tmp_path / "log.csv", header.replace(",", delimiter), POSES, delimiter)
    with pytest.raises(FormatError) as caught:
        read_trajectory(path)
    text = str(caught.value)
    assert "does not name a position and a quaternion" in text
    assert header.replace(",", ", ") in text
    assert "tum (" in text
    assert "rename its columns, or choose with `format_name`" in text
    assert all(confidence <= 0.5 for _, confidence in rank_formats(path))
    chosen = read_trajectory(path, "tum")
    np.testing.assert_allclose(chosen.position_m, WALK.position_m, rtol=0, atol=1e-12)


def test_the_reader_that_takes_rows_does_not_make_them_sure(tmp_path):
    """Half of the rows fit, and the reader takes the rest: still a guess."""
    path = tmp_path / "poses.txt"
    lines = [f"a{i}.png 1 0 0 0 {i} 2 3" for i in range(10)]
    lines[3] = "a3.png 0.9 0 0 0 3 2 3"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FormatError, match=r"uncertain: it may be hloc \(.*choose with"):
        read_trajectory(path)
    assert len(read_trajectory(path, "hloc")) == 9


def test_inspect_says_that_it_is_a_guess(tmp_path):
    path = write(tmp_path / "log.csv", REFUSED[0], POSES)
    assert inspect_file(path).warnings[0] == (
        "format: only 45% sure of tum; it may be advio-vio (40%), euroc (30%), advio-gt (30%): the "
        "columns alone do not tell: choose with `format_name`"
    )
    quaternion_first = POSES[:, [0, 4, 5, 6, 7, 1, 2, 3]] * [1e9, *[1] * 7]
    path = write(tmp_path / "first.csv", REFUSED[0], quaternion_first)
    assert (
        inspect_file(path)
        .warnings[0]
        .startswith("format: only 50% sure of arcore-logger: the columns alone do not tell")
    )


@pytest.mark.parametrize("names", ["lat,lon,alt", "latitude,longitude,h", "Lat [deg],Lng [deg],z"])
def test_degrees_are_no_metres(names, tmp_path):
    path = write(tmp_path / "gps.csv", f"timestamp,{names},qx,qy,qz,qw", POSES)
    with pytest.raises(FormatError, match="in metres, but its header names degrees .*convert them"):
        read_trajectory(path)
    for name in ("tum", "euroc"):
        with pytest.raises(FormatError, match="in metres, but its header names degrees: timestamp"):
            read_trajectory(path, name)


def named(pattern, base=0, rows=4):
    return [pattern.format(r + base, c + base) for r, c in PAIRS if r < rows]


@pytest.mark.slow
@pytest.mark.parametrize(
    "pattern", ["m{}{}", "T_{}_{}", "pose[{}][{}]", "R({};{})", "c2w.{}{}", "world_from_cam_{}{}"]
)
@pytest.mark.parametrize("base", [0, 1])
@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("delimiter", [",", "\t"])
def test_matrices_by_row_and_column(pattern, base, rows, delimiter, tmp_path):
    names = delimiter.join(["timestamp", *named(pattern, base, rows)])
    entries = MATRICES[:, :rows].reshape(len(WALK), -1)
    path = write(tmp_path / "log.csv", names, np.column_stack([POSES[:, 0], entries]), delimiter)
    assert_is_walk(read_with_notes(path))


@pytest.mark.parametrize("rows", [3, 4])
def test_matrices_in_any_order_of_columns(rows, tmp_path):
    order = np.random.default_rng(0).permutation(4 * rows)
    names = np.array(named("m{}{}", 0, rows))[order]
    entries = MATRICES[:, :rows].reshape(len(WALK), -1)[:, order]
    columns = np.column_stack([entries, POSES[:, 0]])
    assert_is_walk(read_with_notes(write(tmp_path / "a.csv", ",".join([*names, "t"]), columns)))


@pytest.mark.parametrize("pattern", ["transform_{}", "m{}", "pose[{}]", "T{:02d}"])
@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("is_transposed", [False, True])
def test_matrices_by_one_number(pattern, rows, is_transposed, tmp_path):
    matrices = MATRICES[:, :rows]
    matrices = np.swapaxes(matrices, 1, 2) if is_transposed else matrices
    names = ["timestamp", *(pattern.format(k) for k in range(4 * rows))]
    columns = np.column_stack([POSES[:, 0], matrices.reshape(len(WALK), -1)])
    reading = read_with_notes(write(tmp_path / "a.csv", ",".join(names), columns))
    assert_is_walk(reading)
    assert any("column by column" in note.text for note in reading.notes) == is_transposed


@pytest.mark.parametrize("rows", [3, 4])
def test_names_that_count_columns_first(rows, tmp_path):
    """As simd's matrices are indexed: columns[3].x is the translation."""
    names = [f"m{c}{r}" for c in range(4) for r in range(rows)]
    entries = np.swapaxes(MATRICES[:, :rows], 1, 2).reshape(len(WALK), -1)
    columns = np.column_stack([POSES[:, 0], entries])
    assert_is_walk(read_with_notes(write(tmp_path / "a.csv", ",".join(["t", *names]), columns)))


@pytest.mark.parametrize("position", ["tx,ty,tz", "x,y,z", "t1,t2,t3", "p_x,p_y,p_z"])
def test_a_rotation_matrix_beside_a_position(position, tmp_path):
    names = ["time", *position.split(","), *(f"r{r}{c}" for r in (1, 2, 3) for c in (1, 2, 3))]
    rotations = MATRICES[:, :3, :3].reshape(len(WALK), 9)
    path = write(tmp_path / "a.csv", ",".join(names), np.column_stack([POSES[:, :4], rotations]))
    assert_is_walk(read_with_notes(path))


def test_millimetres_beside_a_matrix(tmp_path):
    names = ["t", "x_mm", "y_mm", "z_mm", *(f"r{r}{c}" for r in (1, 2, 3) for c in (1, 2, 3))]
    rotations = MATRICES[:, :3, :3].reshape(len(WALK), 9)
    columns = np.column_stack([POSES[:, 0], POSES[:, 1:4] * 1000, rotations])
    read = read_trajectory(write(tmp_path / "a.csv", ",".join(names), columns))
    np.testing.assert_allclose(read.position_m, WALK.position_m, rtol=0, atol=1e-9)


def test_columns_named_as_a_matrix_that_hold_none(tmp_path):
    names = ["t", *named("m{}{}")]
    columns = np.column_stack([POSES[:, 0], np.full((len(WALK), 16), 0.3)])
    path = write(tmp_path / "a.csv", ",".join(names), columns)
    with pytest.raises(FormatError, match="that its header names hold no rotation matrix: t, m00"):
        read_trajectory(path)


def test_lost_rows_of_matrices_are_left_out(tmp_path):
    entries = MATRICES[:, :3].reshape(len(WALK), 12).copy()
    entries[5:8] = np.nan
    columns = np.column_stack([POSES[:, 0], entries])
    reading = read_with_notes(
        write(tmp_path / "a.csv", ",".join(["t", *named("m{}{}", 0, 3)]), columns)
    )
    assert len(reading.trajectory) == len(WALK) - 3
    assert reading.warnings == ["3 rows have no pose (lines 7 to 9): left out"]


@pytest.mark.parametrize(
    "names",
    [
        "r11,r12,r13,r21,r22,r23,r31,r32",
        ",".join(f"cov_{r}{c}" for r, c in PAIRS),
        ",".join(f"k{r}{c}" for r in range(3) for c in range(3)),
        ",".join(f"r_{k}" for k in range(9)),  # by rows or by columns: nothing tells
        ",".join(f"{g}{r}{c}" for g in "ab" for r, c in PAIRS),
    ],
)
def test_incomplete_or_unclear_matrices_are_none(names):
    assert find_matrix_columns(names.split(",")) is None


def test_a_quaternion_by_r(tmp_path):
    reading = read_with_notes(write(tmp_path / "a.csv", "t,tx,ty,tz,rx,ry,rz,rw", POSES))
    assert_is_walk(reading)


def assert_is_walk(reading):
    assert (reading.format.name, reading.confidence) == ("table", 0.9)
    assert reading.left_out == ()
    read = reading.trajectory
    np.testing.assert_allclose(read.timestamp_s, WALK.timestamp_s, rtol=0, atol=1e-9)
    np.testing.assert_allclose(read.position_m, WALK.position_m, rtol=0, atol=1e-9)
    assert rigid.angle_deg(read.target_from_source, WALK.target_from_source).max() < 1e-4


NUMBERED = ("q0,q1,q2,q3", "quat_0,quat_1,quat_2,quat_3", "q[0],q[1],q[2],q[3]")


@pytest.mark.parametrize("names", NUMBERED)
def test_the_motion_tells_whether_the_first_of_a_numbered_quaternion_is_w(names, tmp_path):
    walk = make_walk()
    header = f"t,x,y,z,{names}"
    columns = [walk.timestamp_s, walk.position_m]
    w_first = np.column_stack([*columns, walk.quat_xyzw[:, [3, 0, 1, 2]]])
    reading = read_with_notes(write(tmp_path / "w.csv", header, w_first))
    assert reading.notes == ()
    assert rigid.angle_deg(reading.trajectory.target_from_source, walk.target_from_source).max() < 1
    x_first = write(tmp_path / "x.csv", header, np.column_stack([*columns, walk.quat_xyzw]))
    with pytest.raises(FormatError, match="to be w, but by the motion it is x: name the columns"):
        read_with_notes(x_first)


def test_a_numbered_quaternion_without_motion_is_said(tmp_path):
    rows = [[k, 0, 0, 0, 1, 0, 0, 0] for k in range(5)]
    reading = read_with_notes(write(tmp_path / "a.csv", f"t,x,y,z,{NUMBERED[0]}", rows))
    assert reading.trajectory.quat_xyzw[0].tolist() == [0, 0, 0, 1]
    assert reading.warnings == [
        "q0 is taken for w and q1 for x: if they are not, name them qx, qy, ..."
    ]


@pytest.mark.parametrize("name", ["transforms.json", "walk.json"])
def test_json_whose_poses_come_late_is_recognized_by_its_fields(name, tmp_path):
    path = tmp_path / name
    frames = [
        {"file_path": f"{k}.png", "transform_matrix": m} for k, m in enumerate(MATRICES.tolist())
    ]
    path.write_text(json.dumps({"about": "x" * 100_000, "frames": frames}))
    reading = read_with_notes(path)
    assert (reading.format.name, reading.confidence) == ("nerfstudio", 0.6)
    assert inspect_file(path).candidates[0].confidence == 0.6
    path.write_text(json.dumps({"about": "x" * 100_000, "frames": [{"file_path": "0.png"}]}))
    with pytest.raises(FormatError, match="nearest format is nerfstudio"):
        read_with_notes(path)
