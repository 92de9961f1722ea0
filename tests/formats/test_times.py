"""The unit of times is found from dates, else from steps, or given."""

import json

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, read_with_notes
from vioapr.formats.times import PER_SECOND, UNIT_NAMES, find_time_unit

POSE = "1 2 3 0 0 0 1"


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("rate_hz", [1, 2, 30, 100])
@pytest.mark.parametrize("start_s", [1403636579.7, 1.7e9, 105230.5, 1500.0, 0.0])
def test_every_unit_of_every_clock(unit, rate_hz, start_s):
    values = np.round((start_s + np.arange(60) / rate_hz) * PER_SECOND[unit], 6)
    assert find_time_unit(values).unit == unit
    assert find_time_unit(values).is_date == (start_s > 1e9)


@pytest.mark.parametrize("unit", PER_SECOND)
def test_one_date_is_enough(unit):
    assert find_time_unit(np.array([1.7e9 * PER_SECOND[unit]])) == (unit, True)


def test_nothing_at_all_is_seconds():
    assert find_time_unit(np.array([np.nan, np.inf])).unit == "s"
    assert find_time_unit(np.zeros(0)).unit == "s"


def write(tmp_path, times, name="walk.tum"):
    path = tmp_path / name
    path.write_text("".join(f"{time} {POSE}\n" for time in times))
    return path


def test_the_unit_found_is_said(tmp_path):
    reading = read_with_notes(write(tmp_path, [1700000000000 + 33 * i for i in range(9)]))
    assert reading.trajectory.timestamp_s[:2] == pytest.approx([1.7e9, 1.7e9 + 0.033])
    assert [note.text for note in reading.notes] == ["times are milliseconds"]
    assert reading.warnings == []


def test_a_unit_found_by_steps_is_a_warning(tmp_path):
    reading = read_with_notes(write(tmp_path, [33 * i for i in range(9)]))
    assert reading.trajectory.timestamp_s[1] == 0.033
    assert (
        "taken for milliseconds, by their steps: if they are not, say `time_unit`"
        in (reading.warnings[0])
    )


def test_the_unit_can_be_given(tmp_path):
    path = write(tmp_path, [33 * i for i in range(9)])
    reading = read_with_notes(path, options=ReadOptions(time_unit="s"))
    assert reading.trajectory.timestamp_s[1] == 33
    assert reading.notes == ()
    with pytest.raises(ParameterError, match="time_unit: expected one of s, ms, us, ns"):
        ReadOptions(time_unit="hours")


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("name", ["euroc", "advio-gt", "advio-vio"])
def test_a_given_unit_counts_before_that_of_the_format(name, unit, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("5,1,2,3,1,0,0,0\n10,1,2,3,1,0,0,0\n")
    reading = read_with_notes(path, name, ReadOptions(time_unit=unit))
    assert reading.trajectory.timestamp_s.tolist() == [5 / PER_SECOND[unit], 10 / PER_SECOND[unit]]


def test_euroc_in_seconds(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("0.5,1,2,3,1,0,0,0\n0.6,1,2,3,1,0,0,0\n")
    assert FORMATS["euroc"].read(path, ReadOptions()).timestamp_s.tolist() == [0.5, 0.6]
    path.write_text("500000000,1,2,3,1,0,0,0\n")
    assert FORMATS["euroc"].read(path, ReadOptions()).timestamp_s.tolist() == [0.5]


def test_the_case_of_nanoseconds_in_tum():
    folder = case_folder("10-nanoseconds-in-tum")
    truth = read_with_notes(folder / "truth.tum").trajectory
    for name, unit in (("f_dataset-MH01_mono.txt", "ns"), ("milliseconds.txt", "ms")):
        reading = read_with_notes(folder / name)
        times = reading.trajectory.timestamp_s
        assert times[[0, -1]] == pytest.approx([1700000000.0, 1700000004.967], abs=1e-3)
        np.testing.assert_allclose(times, truth.timestamp_s, rtol=0, atol=6e-4)
        np.testing.assert_array_equal(reading.trajectory.position_m, truth.position_m)
        assert [note.text for note in reading.notes] == [f"times are {UNIT_NAMES[unit]}"]


@pytest.mark.parametrize("time", ["1e308", "inf"])
def test_times_beyond_all_clocks(tmp_path, time):
    """They are refused as any other wrong time, without a warning of NumPy."""
    path = tmp_path / "trajectories.txt"
    path.write_text(f"{time},cam,1,0,0,0,0,0,0\n{time},cam,1,0,0,0,1,0,0\n")
    with pytest.raises(FormatError):
        FORMATS["kapture"].read(path, ReadOptions())


def table(tmp_path, header, times):
    path = tmp_path / "walk.csv"
    rows = "".join(f"{time},1,2,3,0,0,0,1\n" for time in times)
    path.write_text(f"{header},x,y,z,qx,qy,qz,qw\n{rows}")
    return path


SECONDS, NANOSECONDS = np.arange(9) / 2 + 5, np.arange(9) * 500_000_000 + 7


@pytest.mark.parametrize(
    ("times", "said", "got", "fitting"),
    [
        (SECONDS, "ns", "5e-10 s from one to the next in nanoseconds", "s"),
        (SECONDS, "us", "5e-07 s from one to the next in microseconds", "s"),
        (NANOSECONDS, "s", "5e+08 s from one to the next in seconds", "ns"),
        (NANOSECONDS, "ms", "5e+05 s from one to the next in milliseconds", "ns"),
        (NANOSECONDS // 1000, "s", "5e+05 s from one to the next in seconds", "us"),
    ],
)
@pytest.mark.parametrize("where", ["option", "header"])
def test_a_unit_that_gives_no_rate_of_frames_is_refused(times, said, got, fitting, where, tmp_path):
    is_given = where == "option"
    header = "timestamp" if is_given else f"timestamp_{said}"
    path = table(tmp_path, header, times.tolist())
    with pytest.raises(FormatError) as caught:
        read_with_notes(path, options=ReadOptions(time_unit=said if is_given else None))
    wanted = f"expected frames 0.1 ms to an hour apart, got {got}: give `time_unit` {fitting}"
    assert str(caught.value) == f"{path}: {wanted}"
    mended = read_with_notes(path, options=ReadOptions(time_unit=fitting)).trajectory
    assert np.diff(mended.timestamp_s) == pytest.approx(0.5)


def test_transforms_json_in_a_unit_that_gives_no_rate_is_refused(tmp_path):
    path = tmp_path / "transforms.json"
    frames = [
        {"file_path": f"{k}.png", "timestamp_ns": k / 2, "transform_matrix": np.eye(4).tolist()}
        for k in range(9)
    ]
    path.write_text(json.dumps({"frames": frames}))
    with pytest.raises(FormatError, match="5e-10 s from one to the next in nanoseconds"):
        read_with_notes(path)
    mended = read_with_notes(path, options=ReadOptions(time_unit="s")).trajectory
    assert np.diff(mended.timestamp_s) == pytest.approx(0.5)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 60.0, 3600.0])
def test_slow_motion_and_time_lapse_are_rates_of_frames(step, tmp_path):
    path = table(tmp_path, "timestamp_s", (np.arange(9) * step).tolist())
    found = read_with_notes(path).trajectory
    np.testing.assert_allclose(np.diff(found.timestamp_s), step)
