"""Columns of a tracker's state: rows that are not tracked are left out, where it is clear."""

import pytest

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.columns import find_layout
from vioapr.formats.registry import FORMATS, read_with_notes
from vioapr.formats.tracking_states import read_tracking_states

POSE = "qx,qy,qz,qw"


def write(tmp_path, name, states, header="timestamp,{},x,y,z,qx,qy,qz,qw"):
    path = tmp_path / "log.csv"
    rows = [f"{i / 10},{state},{i},2,3,0,0,0,1\n" for i, state in enumerate(states)]
    path.write_text(header.format(name) + "\n" + "".join(rows))
    return path


def texts(reading, *, warnings):
    return [note.text for note in reading.notes if note.is_warning == warnings]


@pytest.mark.parametrize(
    ("name", "tracked", "lost"),
    [
        ("tracking_state", "normal", "notAvailable"),
        ("trackingState", "normal", "not available"),
        ("Tracking", "TRACKING", "PAUSED"),
        ("tracking_status", "tracking", "STOPPED"),
        ("tracking_state", "ARTrackingState.Normal", "ARTrackingState.NotAvailable"),
        ("arkit_tracking_state", "ARCamera.TrackingState.normal", "none"),
        ("state", "Tracking", "None"),
        ("state", "OK", "RECENTLY_LOST"),
        ("status", "tracked", "unlocalized"),
        ("is_tracking", "true", "false"),
        ("isTracked", "1", "0"),
        ("tracking", "1.000000", "0.000000"),
        ("tracking_ok", "True", "False"),
        ("valid", "1", "0"),
        ("tracking_state", "2", "0"),
        ("status", "2", "0"),
        ("lost", "0", "1"),
        ("is_lost", "false", "true"),
    ],
)
def test_rows_that_are_not_tracked_are_left_out(name, tracked, lost, tmp_path):
    states = [tracked] * 12
    states[3:5] = [lost, lost]
    path = write(tmp_path, name, states)
    reading = read_with_notes(path)
    assert len(reading.trajectory) == 10
    assert texts(reading, warnings=True) == ["2 rows are not tracked (lines 5 to 6): left out"]
    assert [row.line for row in reading.left_out] == [5, 6]
    assert reading.left_out[0].timestamp_s == 0.3
    assert texts(reading, warnings=False) == []
    with pytest.raises(FormatError, match=f"log.csv:5: expected a tracked pose, got {name} '"):
        read_with_notes(path, options=ReadOptions(strict=True))


@pytest.mark.parametrize(
    ("name", "states", "limited"),
    [
        ("tracking_state", ["normal"] * 5 + ["limited(initializing)", "limited"], 2),
        ("tracking_state", ["2"] * 5 + ["1"], 1),
        ("tracking", ["1"] * 6, 0),
        ("tracking_state", ["1"] * 6, 0),
        ("status", ["tracked", "keyframe", "optimized", "predicted"], 0),
        ("tracking", ["normal", "", "normal"], 0),
    ],
)
def test_rows_that_are_tracked_are_kept(name, states, limited, tmp_path):
    reading = read_with_notes(write(tmp_path, name, states))
    assert len(reading.trajectory) == len(states)
    expected = [f"{limited} rows of limited tracking are kept"] if limited > 1 else []
    expected = ["1 row of limited tracking is kept"] if limited == 1 else expected
    assert [note.text for note in reading.notes] == expected


@pytest.mark.parametrize(
    ("name", "states", "why"),
    [
        # ARCore's 0 is "tracking", ARKit's and AR Foundation's is "not available".
        ("tracking_state", ["0"] * 6 + ["1"], "it does not tell which of 0, 1 is tracked"),
        ("tracking_state", ["0"] * 6, "it does not tell which of 0 is tracked"),
        ("tracking_state", ["0", "2", "0", "2"], "it does not tell which of 0, 2 is tracked"),
        ("tracking_state", ["3"] * 6 + ["1"], "it does not tell which of 1, 3 is tracked"),
        ("tracking", ["2"] * 6 + ["1"], "it does not tell which of 1, 2 is tracked"),
        ("tracking_state", ["normal", "sideways"], "the meaning of 'sideways' is not known"),
    ],
)
def test_unclear_states_are_passed_over_and_named(name, states, why, tmp_path):
    reading = read_with_notes(write(tmp_path, name, states))
    assert len(reading.trajectory) == len(states)
    assert texts(reading, warnings=True) == [
        f"{name} was passed over: {why}: write normal and notAvailable"
    ]


def test_other_states_are_noted_without_a_warning(tmp_path):
    reading = read_with_notes(write(tmp_path, "status", ["4", "5", "4"]))
    assert reading.warnings == []
    assert reading.notes[0].text.startswith("status was passed over: it does not tell which of 4")


def test_a_walk_that_was_never_tracked_is_refused(tmp_path):
    path = write(tmp_path, "tracking_state", ["notAvailable"] * 5)
    with pytest.raises(FormatError, match="expected a tracked pose, got tracking_state 'notAvail"):
        read_with_notes(path)


def test_the_clearest_name_counts(tmp_path):
    names = ["t", "status", "tracking_state", "x", "y", "z", *POSE.split(",")]
    layout = find_layout(names)
    assert layout.tracking == 2
    assert layout.passed_over == ("status",)
    assert find_layout(["t", "tracking_quality", "battery_state", *names[3:]]).tracking is None


def test_columns_after_a_comment_count_as_well(tmp_path):
    path = tmp_path / "walk.tum"
    rows = [f"{i} {i} 2 3 0 0 0 1 {'lost' if i == 2 else 'normal'} 7\n" for i in range(6)]
    path.write_text("# timestamp tx ty tz qx qy qz qw tracking_state features\n" + "".join(rows))
    reading = read_with_notes(path)
    assert reading.format.name == "tum"
    assert [note.text for note in reading.notes] == [
        "1 further column was passed over: features",
        "1 row is not tracked (line 4): left out",
    ]


def test_passed_over_columns_are_named(tmp_path):
    reading = read_with_notes(write(tmp_path, "fps,exposure", ["30,1"] * 3))
    assert [n.text for n in reading.notes] == ["2 further columns were passed over: fps, exposure"]
    many = ",".join(f"k{i}" for i in range(15))
    reading = read_with_notes(write(tmp_path, many, [",".join("1" * 15)] * 3))
    assert reading.notes[0].text.startswith("15 further columns were passed over: k0, k1, ")
    assert reading.notes[0].text.endswith("k11 and 3 more")


def test_scancapture_says_it_in_a_column_without_a_name(tmp_path):
    path = tmp_path / "poses.txt"
    states = ["normal", "limited", "notAvailable", "normal"]
    rest = "1,2,3,0,0,0,1,640,480,500,500,320,240"
    rows = [f"{i * 100000 + 10**12},{state},{rest}\n" for i, state in enumerate(states)]
    path.write_text("".join(rows))
    reading = read_with_notes(path)
    assert reading.format is FORMATS["scancapture"]
    assert len(reading.trajectory) == 3
    assert reading.warnings == ["1 row is not tracked (line 3): left out"]


def test_states_by_hand():
    assert read_tracking_states("tracking", ["1", "0", "1"]).lost == (1,)
    assert read_tracking_states("lost", ["yes", "no", "no"]).lost == (0,)
    assert read_tracking_states("tracking_state", ["2", "1", "2"]).limited == 1
