"""Spectacular AI's JSON Lines: the SDK's output and recordings with sensors."""

import json

import numpy as np
import pytest

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import rank_formats, read_trajectory

GYROSCOPE = '{"sensor": {"type": "gyroscope", "values": [0, 0, 1]}, "time": 0.01}'


def pose(x=0.0):
    position = {"x": x, "y": 0, "z": 0}
    return {"position": position, "orientation": {"w": 1, "x": 0, "y": 0, "z": 0}}


def write(path, *lines):
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def test_published_lines(tmp_path):
    """The example of the makers' DATA_FORMAT.md: 3 of its lines."""
    path = write(
        tmp_path / "data.jsonl",
        '{"groundTruth":{"position":{"x":-0.007567568216472864,"y":0.022782884538173676,'
        '"z":0.00817866250872612},"orientation":{"w":0.53464,"x":-0.15299,"y":-0.826976,'
        '"z":-0.082863}},"time":1.444770263671875}',
        '{"sensor":{"type":"accelerometer","values":[-0.03824593499302864,9.12,-2.98]},'
        '"time":1.43846240234375}',
        '{"groundTruth":{"position":{"x":-0.007713410072028637,"y":0.022989293560385704,'
        '"z":0.008272084407508373},"orientation":{"w":0.53464,"x":-0.15299,"y":-0.826976,'
        '"z":-0.082863}},"time":1.449769287109375}',
    )
    assert rank_formats(path)[0][0].name == "spectacular"
    track = read_trajectory(path)
    assert track.source == "device"
    assert track.timestamp_s.tolist() == [1.444770263671875, 1.449769287109375]
    quat_xyzw = [-0.15299, -0.826976, -0.082863, 0.53464]
    np.testing.assert_allclose(track.quat_xyzw[0], quat_xyzw, atol=1e-6)


def test_lost_frames(tmp_path):
    lines = [
        json.dumps({"time": k / 10, "status": status, **pose(k)})
        for k, status in enumerate(["INIT", "TRACKING", "TRACKING", "LOST_TRACKING", "TRACKING"])
    ]
    notes = ReadingNotes()
    path = write(tmp_path / "out.jsonl", *lines)
    track = read_trajectory(path, None, ReadOptions(notes=notes))
    assert track.position_m[:, 0].tolist() == [1, 2, 4]
    assert notes.warnings == ["2 rows are not tracked (lines 1, 4): left out"]
    with pytest.raises(FormatError, match=":1: expected a tracked pose, got 'INIT'"):
        read_trajectory(path, None, ReadOptions(strict=True))


def test_several_tracks_need_a_choice(tmp_path):
    lines = [json.dumps({name: pose(k), "time": t}) for t, (name, k) in enumerate(
        [("groundTruth", 1.0), ("arkit", 2.0), ("groundTruth", 3.0), ("arkit", 4.0)]
    )]  # fmt: skip
    path = write(tmp_path / "data.jsonl", GYROSCOPE, *lines)
    with pytest.raises(ParameterError, match="several tracks.*`sequence`: groundTruth, arkit"):
        read_trajectory(path)
    track = read_trajectory(path, None, ReadOptions(sequence="arkit"))
    assert track.position_m[:, 0].tolist() == [2, 4]
    with pytest.raises(ParameterError, match="no 'x'"):
        read_trajectory(path, None, ReadOptions(sequence="x"))


def test_a_last_line_cut_off(tmp_path):
    lines = [json.dumps({"time": k, **pose(k)}) for k in range(4)]
    path = tmp_path / "out.jsonl"
    path.write_text("\n".join(lines)[:-9])
    notes = ReadingNotes()
    assert len(read_trajectory(path, None, ReadOptions(notes=notes))) == 3
    assert notes.warnings == ["line 4 ends early: left out"]
    with pytest.raises(FormatError, match=":4: expected a JSON object"):
        read_trajectory(path, None, ReadOptions(strict=True))


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("{", "expected a JSON object in each line"),
        ("[1]", "expected a JSON object in each line"),
        (json.dumps(pose()), ':1: expected "time"'),
        (json.dumps({"time": "1", **pose()}), ':1: expected "time"'),
        (json.dumps({"time": 1, **pose(), "position": {"x": 1}}), '"position" with x, y, z'),
        (json.dumps({"time": 1, **pose(), "orientation": 5}), '"orientation" with w, x, y, z'),
        (json.dumps({"time": 1, "cameraPoses": [1]}), '"cameraToWorld"'),
        (GYROSCOPE, 'expected lines with "position" and "orientation", got none'),
        ('{"time": 1, "position": {"x": NaN, "y": 0, "z": 0}, "orientation": '
         '{"w": 1, "x": 0, "y": 0, "z": 0}}', "expected finite numbers"),
        ('{"time": 1, "position": {"x": 0, "y": 0, "z": 0}, "orientation": '
         '{"w": 0, "x": 0, "y": 0, "z": 0}}', "expected finite numbers"),
    ],
)  # fmt: skip
def test_malformed(line, problem, tmp_path):
    with pytest.raises(FormatError, match=problem):
        read_trajectory(write(tmp_path / "out.jsonl", line), "spectacular")
