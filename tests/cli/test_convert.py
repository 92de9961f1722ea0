"""`vioapr convert` goes between any two formats and says what was lost."""

import json

import numpy as np
import pytest
from tests.formats.conftest import file_name, make_trajectory
from tests.formats.samples import write_sample

from vioapr.cli.convert import convert
from vioapr.errors import AlreadyExistsError, FormatError, ParameterError
from vioapr.formats.conversion import convert_file
from vioapr.formats.registry import FORMATS, read_trajectory


def write(name, folder):
    path = folder / file_name(FORMATS[name])
    write_sample(FORMATS[name], path, make_trajectory(FORMATS[name]))
    return path


WRITTEN = [name for name, format_ in FORMATS.items() if format_.write is not None]
# Each to ten others, so that every format is a source and a target several times.
PAIRS = [
    (source, WRITTEN[(row + 3 * step) % len(WRITTEN)])
    for row, source in enumerate(FORMATS)
    for step in range(10)
]


def test_pairs_cover_all_formats():
    assert {source for source, _ in PAIRS} == set(FORMATS)
    assert {target for _, target in PAIRS} == set(WRITTEN)


@pytest.mark.slow
@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_any_to_any(source, target, tmp_path):
    (tmp_path / "in").mkdir()
    path = write(source, tmp_path / "in")
    out = tmp_path / "out" / file_name(FORMATS[target])
    rate = {} if FORMATS[source].has_times else {"rate_hz": 2.0}
    convert(path, out, source_format=source, target_format=target, **rate)
    original, converted = read_trajectory(path, source), read_trajectory(out, target)
    np.testing.assert_allclose(converted.position_m, original.position_m, atol=1e-9)
    np.testing.assert_allclose(
        np.abs((converted.quat_xyzw * original.quat_xyzw).sum(axis=1)), 1, atol=1e-9
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("walk.tum", "tum"),
        ("walk.tum.gz", "tum"),
        ("walk.csv", "euroc"),
        ("walk.kitti", "kitti"),
        ("transforms.json", "nerfstudio"),
        ("images.bin", "colmap-binary"),
        ("images.txt", "colmap"),
        ("odometry.csv", "stray"),
        ("walk.r3d", "record3d"),
        ("metadata", "record3d"),
        ("dataset_train.txt", "cambridge"),
    ],
)
def test_the_name_tells_the_format(name, expected, tmp_path):
    done = convert_file(write("tum", tmp_path), tmp_path / "out" / name)
    assert (done.source_format, done.target_format) == ("tum", expected)
    assert len(read_trajectory(tmp_path / "out" / name)) == 12


@pytest.mark.parametrize(
    ("name", "listed"),
    [("out.txt", "hloc, ace"), ("out", "colmap, colmap-binary"), ("a.xyz", "tum, euroc")],
)
def test_an_ambiguous_name_lists_the_formats(name, listed, tmp_path):
    path = write("tum", tmp_path)
    with pytest.raises(ParameterError, match=f"one with `target_format`: .*({listed}|7scenes)"):
        convert(path, tmp_path / name)
    assert not (tmp_path / name).exists()


def test_the_command_line_names_its_flags(fails, tmp_path):
    path = write("tum", tmp_path)
    assert "choose one with --to: tum" in fails("convert", path, tmp_path / "out.txt")
    (tmp_path / "b.json").write_text("precious")
    assert "or give --overwrite" in fails("convert", path, tmp_path / "b.json")


def test_what_was_lost_is_said(tmp_path, capsys):
    path = write("tum", tmp_path)
    convert(path, tmp_path / "a.kitti")
    assert "(kitti): 12 poses; lost: timestamps" in capsys.readouterr().out
    names = write("hloc", tmp_path)
    convert(names, tmp_path / "b.tum", rate_hz=10.0)
    assert "(tum): 12 poses; lost: image names" in capsys.readouterr().out
    convert(names, tmp_path / "c.kitti", rate_hz=10.0)
    assert "lost: timestamps and image names" in capsys.readouterr().out
    convert(names, tmp_path / "d", target_format="7scenes")
    assert "lost: image names" in capsys.readouterr().out
    convert(names, tmp_path / "e.json")
    assert "; lost" not in capsys.readouterr().out


def test_the_input_is_never_overwritten(tmp_path):
    path = write("tum", tmp_path)
    (tmp_path / "link.tum").symlink_to(path)
    before = path.read_bytes()
    for target in (path, tmp_path / "link.tum"):
        with pytest.raises(ParameterError, match="is the input"):
            convert(path, target, overwrite=True)
    assert path.read_bytes() == before


def test_an_existing_file_is_overwritten_only_if_asked_to(tmp_path):
    path = write("tum", tmp_path)
    out = tmp_path / "out.json"
    out.write_text("precious")
    with pytest.raises(AlreadyExistsError, match="exists: .*`overwrite`"):
        convert(path, out)
    assert out.read_text() == "precious"
    convert(path, out, overwrite=True)
    assert json.loads(out.read_text())["frames"]


def test_a_folder_with_something_in_it_counts_as_existing(tmp_path):
    path = write("tum", tmp_path)
    folder = tmp_path / "model"
    folder.mkdir()
    convert(path, folder, target_format="colmap")
    with pytest.raises(AlreadyExistsError, match="exists"):
        convert(path, folder, target_format="colmap")
    assert len(read_trajectory(folder)) == 12


def test_nothing_is_written_of_what_cannot_be_read(tmp_path):
    path = tmp_path / "bad.tum"
    path.write_text("1 2 3\n")
    with pytest.raises(FormatError, match=r"bad.tum:1: expected 8 columns"):
        convert(path, tmp_path / "out.json", source_format="tum")
    with pytest.raises(FormatError, match=r"bad.tum:1: expected 8 columns"):
        convert(path, tmp_path / "out.json")
    assert not (tmp_path / "out.json").exists()


def test_a_format_with_times_needs_a_rate(tmp_path):
    with pytest.raises(ParameterError, match="needs timestamps.*`rate_hz`"):
        convert(write("hloc", tmp_path), tmp_path / "out.tum")


def test_a_sequence_is_picked(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("a/1.png 1 0 0 0 0 0 0\nb/2.png 1 0 0 0 0 0 0\n")
    convert(path, tmp_path / "out.tum", rate_hz=2.0, sequence="b")
    assert read_trajectory(tmp_path / "out.tum").timestamp_s.tolist() == [1]


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="unknown format 'x'"):
        convert(write("tum", tmp_path), tmp_path / "out.tum", target_format="x")


def test_strict_refuses_what_a_reader_warns_of(run, fails, tmp_path):
    source, target = tmp_path / "walk.tum", tmp_path / "out.tum"
    source.write_text("".join(f"{33 * k} {k / 30} 0 0 0 0 0 1\n" for k in range(9)))
    line = fails("convert", source, target, "--strict")
    assert (
        "times are taken for milliseconds, by their steps: if they are not, say --time-unit" in line
    )
    assert not target.exists()
    code, _, err = run("convert", source, target)
    assert code == 0, err
