"""`transforms.json` with the time of every frame: read, written, and in other units."""

import json

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.formats import nerfstudio
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.trajectory import Trajectory

TIMES = 50 + np.arange(8) / 10


@pytest.fixture
def path(tmp_path):
    positions = np.outer(np.arange(8), [0.1, 0.0, 0.0])
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (8, 1))
    names = tuple(f"{k}.jpg" for k in range(8))
    path = tmp_path / "transforms.json"
    nerfstudio.write(path, Trajectory(TIMES, positions, quats, names))
    return path


def test_times_are_written_and_read_back(path):
    read = nerfstudio.read(path, ReadOptions())
    assert read.is_timed
    np.testing.assert_array_equal(read.timestamp_s, TIMES)
    assert read.names[3] == "3.jpg"


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e9, "ns")])
def test_other_units_are_found_or_given(factor, unit, path):
    content = json.loads(path.read_text())
    for frame in content["frames"]:
        frame["timestamp"] = round(frame["timestamp"] * factor)
    path.write_text(json.dumps(content))
    for given in (None, unit):
        notes = ReadingNotes()
        read = nerfstudio.read(path, ReadOptions(time_unit=given, notes=notes))
        np.testing.assert_allclose(read.timestamp_s, TIMES)
        assert "times are" in notes.remarks[0]


def test_a_frame_out_of_order_is_put_in_order(path):
    content = json.loads(path.read_text())
    content["frames"] = content["frames"][::-1]
    path.write_text(json.dumps(content))
    assert nerfstudio.read(path, ReadOptions()).names == tuple(f"{k}.jpg" for k in range(8))


def test_a_rate_that_is_given_counts(path):
    read = nerfstudio.read(path, ReadOptions(rate_hz=2.0))
    assert read.timestamp_s[:3].tolist() == [0, 0.5, 1]


def test_a_capture_of_nerfcapture():
    read = nerfstudio.read(
        case_folder("11-transforms-with-timestamps") / "transforms.json", ReadOptions()
    )
    assert read.is_timed
    assert read.timestamp_s[0] == 5000
    assert float(np.median(np.diff(read.timestamp_s))) == pytest.approx(0.1)
