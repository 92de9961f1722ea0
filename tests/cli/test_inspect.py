"""`vioapr inspect` prints what a file is and what looks wrong, for people or as JSON."""

import json

import numpy as np
import pytest
from tests.formats.conftest import file_name, make_trajectory
from tests.formats.samples import write_sample

from vioapr.cli.inspect import inspect
from vioapr.errors import FormatError, ParameterError
from vioapr.formats.registry import FORMATS
from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory


def write(name, folder):
    path = folder / file_name(FORMATS[name])
    write_sample(FORMATS[name], path, make_trajectory(FORMATS[name]))
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_every_format(name, tmp_path, capsys):
    path = write(name, tmp_path)
    inspect((path,))
    out = capsys.readouterr().out
    assert str(path) in out
    assert f"{name}, " in out
    assert "12 poses" in out
    assert ("no timestamps" in out) != FORMATS[name].has_times


def test_json(tmp_path, capsys):
    paths = (write("tum", tmp_path), write("hloc", tmp_path))
    inspect(paths, json_=True)
    first, second = json.loads(capsys.readouterr().out)
    assert first["candidates"] == [{"name": "tum", "confidence": 1.0}]
    assert first["poses"] == 12
    assert second["start_s"] is None
    assert second["has_names"] is True
    assert second["frames"] == "world_from_cam"


def test_warnings_and_fits(tmp_path, capsys):
    trajectory = make_trajectory(FORMATS["tum"], 40)
    FORMATS["tum"].write(tmp_path / "a.tum", trajectory)
    inspect((tmp_path / "a.tum",), against=tmp_path / "a.tum")
    out = capsys.readouterr().out
    assert "WARNING scale or clock" in out
    assert "as read: rotations 0.00 deg" in out


def test_a_format_can_be_named(tmp_path, capsys):
    path = tmp_path / "poses.txt"
    path.write_text("a/1.png 1 2 3 1 0 0 0\n")
    inspect((path,), format_name="marvin")
    assert "marvin, 100% sure" in capsys.readouterr().out


def test_a_file_that_cannot_be_read_is_an_error(tmp_path):
    path = tmp_path / "a.tum"
    path.write_text("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 2\n")
    with pytest.raises(
        FormatError, match=r"a.tum:2: expected a unit quaternion, got one of norm 2"
    ):
        inspect((path,))


def test_no_file_is_an_error():
    with pytest.raises(ParameterError, match="files: expected at least one to inspect, got none"):
        inspect(())


def test_of_several_files_those_that_can_be_read_are_shown(run, tmp_path):
    for name in ("a.tum", "c.tum"):
        FORMATS["tum"].write(tmp_path / name, make_trajectory(FORMATS["tum"], 40))
    (tmp_path / "b.tum").write_text("no poses\n")
    files = [tmp_path / f"{name}.tum" for name in "abcd"]
    code, out, err = run("inspect", *files, "--format", "csv")
    assert code == 2
    assert [line.split(",")[0] for line in out.splitlines()[1:]] == [str(files[0]), str(files[2])]
    first, second, last = err.splitlines()
    assert first.startswith(f"WARNING skipped: {files[1]}: ")
    assert second.startswith(f"WARNING skipped: {files[3]}: expected a file")
    assert last == "error: 2 of 4 files cannot be read"


@pytest.mark.parametrize(
    ("file", "held", "importer"),
    [
        ("odometry.csv", "stray", "stray"),
        ("vio.tum", "tum", "images --poses FILE"),
    ],
)
def test_a_folder_of_an_importer_is_told(file, held, importer, tmp_path, capsys):
    folder = tmp_path / "walk"
    folder.mkdir()
    written = write(held, tmp_path)
    written.rename(folder / file)
    (folder / "a.png").write_bytes(b"")
    with pytest.raises(FormatError) as caught:
        inspect((folder,))
    command, _, flags = importer.partition(" ")
    import_ = f"vioapr import {command} {folder} {flags}".rstrip() + " --out SCENE"
    assert str(caught.value) == (
        f"{folder}: expected a trajectory, got a folder that is of no format; it holds {file} "
        f"({held}): give that file; see docs/guide/formats.md; to import its images as well: "
        f"{import_}"
    )


def test_a_folder_of_nothing(tmp_path):
    with pytest.raises(FormatError, match="of no format; see docs/guide/formats.md$"):
        inspect((tmp_path,))


def test_up_by_definition_or_unknown(tmp_path, capsys):
    """ARKit's world is y up, however the phone is held; a file that says nothing is not x up."""
    rng = np.random.default_rng(0)
    turns = np.stack([0.5 * rng.normal(size=200), np.linspace(0, 12, 200), np.zeros(200)], axis=1)
    held = quaternion.from_rotvec(np.array([0.0, 0.0, np.pi / 2 + 0.4]))  # portrait, not quite
    quats = quaternion.multiply(quaternion.from_rotvec(turns * [0.3, 1, 1]), held)
    tilted = quaternion.multiply(quaternion.from_rotvec(np.array([0.0, 0.0, 0.9])), quats)
    steps = np.cumsum(rng.normal(size=(200, 3)) * 0.02, axis=0)
    walk = Trajectory.from_arrays(np.arange(200) / 30, steps, tilted)
    for name, file, expected in (
        ("arkit-logger", "ARKit_camera_pose.txt", "+y, by definition; the camera's up, held"),
        ("tum", "walk.tum", "unknown: the format does not say, and the camera was not held level"),
    ):
        FORMATS[name].write(tmp_path / file, walk)
        inspect((tmp_path / file,))
        out = " ".join(capsys.readouterr().out.split())
        assert f"up {expected}" in out
