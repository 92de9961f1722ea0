"""Tables are read by the names of their columns, whatever the delimiter, order and unit."""

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.columns import find_layout, names_euler_angles
from vioapr.formats.registry import FORMATS, rank_formats, read_with_notes
from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory

COUNT = 8


def make_walk(count=COUNT):
    rng = np.random.default_rng(5)
    return Trajectory.from_arrays(
        1700000000 + np.arange(count) / 8,
        rng.normal(scale=20, size=(count, 3)).round(6),
        quaternion.normalize(rng.normal(size=(count, 4))),
    )


WALK = make_walk()
FIELDS = {
    **{name: WALK.position_m[:, i] for i, name in enumerate("xyz")},
    **{f"q{name}": WALK.quat_xyzw[:, i] for i, name in enumerate("xyzw")},
    "t": WALK.timestamp_s,
    "0": np.zeros(COUNT),
    "i": np.arange(COUNT),
}
PANDAS = "i t x y z qx qy qz qw"
ROS_TWIST = ",".join(f"field.twist.twist.{k}.{c}" for k in ("linear", "angular") for c in "xyz")
HEADERS = {
    "plain": ("timestamp,tx,ty,tz,qx,qy,qz,qw", "t x y z qx qy qz qw"),
    "pandas": (",timestamp,x,y,z,qx,qy,qz,qw", PANDAS),
    "pandas, index named": ("Unnamed: 0,time,px,py,pz,qx,qy,qz,qw", PANDAS),
    "wxyz": ("t,x,y,z,qw,qx,qy,qz", "t x y z qw qx qy qz"),
    "capitals and units": ("Time [s],X [m],Y [m],Z [m],QW,QX,QY,QZ", "t x y z qw qx qy qz"),
    "units in names": ("time_s,x_m,y_m,z_m,q_x,q_y,q_z,q_w", "t x y z qx qy qz qw"),
    "camel case": ("Ts,PosX,PosY,PosZ,QuatW,QuatX,QuatY,QuatZ", "t x y z qw qx qy qz"),
    "dots": (
        "stamp,position.x,position.y,position.z,"
        "orientation.x,orientation.y,orientation.z,orientation.w",
        "t x y z qx qy qz qw",
    ),
    "rostopic": (
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id,"
        + ",".join(f"field.pose.pose.position.{c}" for c in "xyz")
        + ","
        + ",".join(f"field.pose.pose.orientation.{c}" for c in "xyzw")
        + ",field.pose.covariance0,"
        + ROS_TWIST,
        "w i t map odom x y z qx qy qz qw 0 0 0 0 0 0 0",
    ),
    "bagpy": (
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,"
        + ",".join(f"pose.pose.position.{c}" for c in "xyz")
        + ","
        + ",".join(f"pose.pose.orientation.{c}" for c in "xyzw"),
        "w i s n map x y z qx qy qz qw",
    ),
    "MCD": ("num,t,x,y,z,qx,qy,qz,qw", PANDAS),
    "maplab": (
        "timestamp, vertex_id, p_G_Ix, p_G_Iy, p_G_Iz, q_G_Ix, q_G_Iy, q_G_Iz, q_G_Iw",
        "t i x y z qx qy qz qw",
    ),
    "translation and rotation": (
        "time;translation_x;translation_y;translation_z;"
        "rotation_x;rotation_y;rotation_z;rotation_w",
        "t x y z qx qy qz qw",
    ),
    "brackets with digits": (
        "timestamp,position[0],position[1],position[2],q[0],q[1],q[2],q[3]",
        "t x y z qw qx qy qz",
    ),
    "quaternion first": ("qw,qx,qy,qz,x,y,z,time", "qw qx qy qz x y z t"),
    "spaces": ("timestamp tx ty tz qx qy qz qw", "t x y z qx qy qz qw"),
    "tabs": ("timestamp\ttx\tty\ttz\tqx\tqy\tqz\tqw", "t x y z qx qy qz qw"),
    "a comment": ("# t x y z qw qx qy qz", "t x y z qw qx qy qz"),
    "quotes": ('"t","x","y","z","qx","qy","qz","qw"', "t x y z qx qy qz qw"),
    "R": ("t,x,y,z,qx,qy,qz,qw", PANDAS),
    "velocities": (
        "t,x,y,z,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz,ax,ay,az,bgx",
        "t x y z qx qy qz qw 0 0 0 0 0 0 0 0 0 0",
    ),
    "velocities first": (
        "t,v_x,v_y,v_z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,"
        "x,y,z,qx,qy,qz,qw",
        "t 0 0 0 0 0 0 x y z qx qy qz qw",
    ),
}


def make_rows(columns, delimiter, scale=1.0):
    """Rows of named fields; times in whole ticks where scaled."""
    rows = []
    for row in range(COUNT):
        fields = []
        for name in columns.split():
            if name == "t" and scale != 1:
                fields.append(str(int(WALK.timestamp_s[row] * 8) * int(scale) // 8))
            elif name in ("w", "s", "n"):  # time of writing; secs and nsecs
                time = WALK.timestamp_s[row]
                nanos = int(time % 1 * 1e9)
                fields.append({"w": repr(time + 9), "s": str(int(time)), "n": str(nanos)}[name])
            elif name in FIELDS:
                fields.append(repr(FIELDS[name][row].item()))
            else:
                fields.append(name)
        rows.append(delimiter.join(fields))
    return "\n".join(rows) + "\n"


def write(tmp_path, header, columns, scale=1.0, name="log.txt"):
    delimiter = next((mark for mark in ";\t," if mark in header), " ")
    path = tmp_path / name
    path.write_text(header + "\n" + make_rows(columns, delimiter, scale))
    return path


def assert_is_walk(reading, tolerance_s=1e-9):
    read = reading.trajectory
    np.testing.assert_allclose(read.timestamp_s, WALK.timestamp_s, rtol=0, atol=tolerance_s)
    np.testing.assert_allclose(read.position_m, WALK.position_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(read.quat_xyzw, WALK.quat_xyzw, rtol=0, atol=1e-12)
    assert read.is_timed
    assert reading.left_out == ()


@pytest.mark.parametrize("case", HEADERS)
def test_columns_are_found_by_name(case, tmp_path):
    reading = read_with_notes(write(tmp_path, *HEADERS[case]))
    assert reading.format.name == "table"
    assert_is_walk(reading)


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("name", ["t", "timestamp [{}]", "time_{}", "timestamp({})"])
def test_units_of_time_are_named_or_found(unit, scale, name, tmp_path):
    header = name.format(unit) + ",x,y,z,qx,qy,qz,qw"
    reading = read_with_notes(write(tmp_path, header, "t x y z qx qy qz qw", scale))
    assert_is_walk(reading)
    assert len(reading.notes) == (name == "t")


def test_dates(tmp_path):
    path = tmp_path / "log.csv"
    dates = ["2023-11-14 22:13:20.5", "2023-11-14T22:13:21.25Z", "2023-11-14T23:13:22+01:00"]
    rows = [f"{date},1,2,3,0,0,0,1\n" for date in dates]
    path.write_text("time,x,y,z,qx,qy,qz,qw\n" + "".join(rows))
    times = read_with_notes(path).trajectory.timestamp_s
    np.testing.assert_array_equal(times, [1700000000.5, 1700000001.25, 1700000002])


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("cm", 0.01)])
def test_units_of_positions(unit, metres, tmp_path):
    header = f"t,x [{unit}],y [{unit}],z [{unit}],qx,qy,qz,qw"
    reading = read_with_notes(write(tmp_path, header, "t x y z qx qy qz qw"))
    np.testing.assert_allclose(reading.trajectory.position_m, WALK.position_m * metres)
    assert reading.notes[0].text == f"positions are in units of {metres} m"


def test_decimal_commas(tmp_path):
    path = tmp_path / "log.csv"
    rows = make_rows("t x y z qx qy qz qw", ";").replace(".", ",")
    for header in ("t;x;y;z;qx;qy;qz;qw\n", "# t x y z qx qy qz qw\n"):
        path.write_text(header + rows)
        assert_is_walk(read_with_notes(path))


def test_further_columns_are_counted(tmp_path):
    reading = read_with_notes(write(tmp_path, *HEADERS["velocities"]))
    assert [note.text for note in reading.notes] == [
        "10 further columns were passed over: vx, vy, vz, wx, wy, wz, ax, ay, az, bgx"
    ]
    reading = read_with_notes(write(tmp_path, *HEADERS["pandas"]))
    assert reading.notes == ()


def test_a_last_delimiter_is_no_column(tmp_path):
    path = tmp_path / "log.csv"
    rows = make_rows("t x y z qx qy qz qw", ",").replace("\n", ",\n")
    path.write_text("t,x,y,z,qx,qy,qz,qw\n" + rows)
    assert_is_walk(read_with_notes(path))


def test_of_several_columns_the_one_taken_is_said(tmp_path):
    reading = read_with_notes(write(tmp_path, *HEADERS["rostopic"]))
    assert reading.warnings == []
    assert reading.notes[0].text == (
        "the time was taken from field.header.stamp, and not from time"
    )
    header = "t,gt_x,gt_y,gt_z,x,y,z,qx,qy,qz,qw"
    reading = read_with_notes(write(tmp_path, header, "t x y z 0 0 0 qx qy qz qw"))
    assert_is_walk(reading)
    assert "the position was taken from gt_x, gt_y, gt_z, and not from x, y, z" in reading.warnings


def test_the_quaternion_beside_the_position_is_taken(tmp_path):
    header = "t,gt_qx,gt_qy,gt_qz,gt_qw,est_x,est_y,est_z,est_qx,est_qy,est_qz,est_qw"
    columns = "t 0 0 0 0 x y z qx qy qz qw"
    assert_is_walk(read_with_notes(write(tmp_path, header, columns)))


def test_rows_that_are_shorter_than_the_header_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("timestamp_s,x,y,z,qx,qy,qz,qw,image\n1.5,0,0\n", encoding="utf-8")
    with pytest.raises(FormatError, match="8 columns, as the header names, got 3"):
        FORMATS["table"].read(path, ReadOptions())


def test_images_instead_of_times(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("image,x,y,z,qw,qx,qy,qz\nb 2.png,1,2,3,1,0,0,0\na 1.png,4,5,6,1,0,0,0\n")
    read = read_with_notes(path).trajectory
    assert read.names == ("a 1.png", "b 2.png")
    assert read.position_m[0].tolist() == [4, 5, 6]
    assert not read.is_timed


def test_images_and_times(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,file,x,y,z,qw,qx,qy,qz\n1,b.png,1,2,3,1,0,0,0\n2,a.png,4,5,6,1,0,0,0\n")
    read = read_with_notes(path).trajectory
    assert read.names == ("b.png", "a.png")
    assert read.timestamp_s.tolist() == [1, 2]


def test_rows_without_a_pose_as_pandas_writes_them(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,x,y,z,qx,qy,qz,qw\n0,,,,,,,\n1,1,2,3,0,0,0,1\n2,null,null,1,,,,\n")
    reading = read_with_notes(path)
    assert reading.trajectory.timestamp_s.tolist() == [1]
    assert reading.warnings == ["2 rows have no pose (lines 2, 4): left out"]


def test_without_times_the_rate_is_given(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("x,y,z,qx,qy,qz,qw\n" + "1,2,3,0,0,0,1\n" * 3)
    assert not read_with_notes(path).trajectory.is_timed
    timed = read_with_notes(path, options=ReadOptions(rate_hz=2)).trajectory
    assert timed.timestamp_s.tolist() == [0, 0.5, 1]


@pytest.mark.parametrize(
    "header", ["t,x,y,z,roll,pitch,yaw,w", "t,x,y,z,rotation_roll,rotation_pitch,yaw,n"]
)
def test_euler_angles_are_refused(header, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(header + "\n" + "1,2,3,0,0,0,1,1\n" * 3)
    with pytest.raises(FormatError, match="log.csv:1: expected a quaternion, got angles .*Euler"):
        read_with_notes(path)


def test_a_header_without_a_pose(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,lat,lon\n1,2,3\n")
    with pytest.raises(FormatError, match="log.csv:1: expected a header that names x, y, z, qx"):
        read_with_notes(path, "table")
    path.write_text("1,2,3\n")
    with pytest.raises(FormatError, match="expected a header that names the columns"):
        read_with_notes(path, "table")


def test_errors_name_the_line_under_the_header(tmp_path):
    path = write(tmp_path, *HEADERS["plain"])
    lines = path.read_text().splitlines()
    lines[3] = lines[3].replace(",", ",abc", 1)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FormatError, match="log.txt:4: expected a number, got 'abc"):
        read_with_notes(path)
    lines[3] = "1,2,3"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FormatError, match=r"log.txt:4: expected 8 columns \(timestamp,tx.* got 3"):
        read_with_notes(path)


def test_a_named_order_that_is_not_the_formats_is_refused(tmp_path):
    path = write(tmp_path, *HEADERS["wxyz"])
    with pytest.raises(FormatError, match="expected columns timestamp x .*them t, x, y, z, qw"):
        read_with_notes(path, "tum")
    assert_is_walk(read_with_notes(write(tmp_path, *HEADERS["plain"]), "tum"))


def test_what_a_table_cannot_hold(tmp_path):
    untimed = Trajectory.from_arrays([0], [[0, 0, 0]], [[0, 0, 0, 1]], is_timed=False)
    with pytest.raises(ParameterError, match="needs timestamps or image names"):
        FORMATS["table"].write(tmp_path / "a.csv", untimed)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("t,x,y,z,qx,qy,qz", None),
        ("t,vx,vy,vz,qx,qy,qz,qw", None),
        ("t,x,y,z,q1,q2,q3,q4", None),
        ("t,angular_velocity.x,angular_velocity.y,angular_velocity.z,qx,qy,qz,qw", None),
    ],
)
def test_incomplete_or_ambiguous_names_are_no_layout(names, expected):
    assert find_layout(names.split(",")) is expected


def test_euler_names():
    assert names_euler_angles(["t", "x", "y", "z", "roll", "pitch", "yaw"])
    assert not names_euler_angles(["t", "x", "y", "z", "qx", "qy", "qz", "qw"])


def test_cases_of_named_columns():
    folder = case_folder("08-csv-with-named-columns")
    truth = read_with_notes(folder / "truth.tum").trajectory
    for name in ("nohash.txt", "pandas.csv", "poses.csv"):
        read = read_with_notes(folder / name).trajectory
        np.testing.assert_array_equal(read.timestamp_s, truth.timestamp_s)
        np.testing.assert_array_equal(read.position_m, truth.position_m)
        np.testing.assert_array_equal(read.quat_xyzw, truth.quat_xyzw)


def test_the_case_of_more_columns():
    folder = case_folder("09-tum-with-more-columns")
    truth = read_with_notes(folder / "truth.tum").trajectory
    reading = read_with_notes(folder / "state_estimate.txt")
    assert reading.format.name == "tum"
    assert [note.text for note in reading.notes] == [
        "12 further columns were passed over: Pr11, Pr12, Pr13, Pr22, Pr23, Pr33, Pt11, Pt12, "
        "Pt13, Pt22, Pt23, Pt33"
    ]
    np.testing.assert_allclose(reading.trajectory.timestamp_s, truth.timestamp_s, atol=1.1e-5)
    np.testing.assert_array_equal(reading.trajectory.position_m, truth.position_m)
    np.testing.assert_array_equal(reading.trajectory.quat_xyzw, truth.quat_xyzw)


def test_confidence_of_named_columns(tmp_path):
    path = write(tmp_path, *HEADERS["plain"])
    assert [(f.name, c) for f, c in rank_formats(path)] == [("table", 0.9)]


def test_rows_shorter_than_the_header(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "timestamp_s,image,x,y,z,qx,qy,qz,qw\n.85,seq-01/frame-,y,z,qx,qy,0.png,12.8q08z\n"
    )
    with pytest.raises(FormatError, match="expected at least 9 columns, as the header names, got"):
        FORMATS["table"].read(path, ReadOptions())
