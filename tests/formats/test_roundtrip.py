"""What is written is read back, in every format."""

import gzip

import numpy as np
import pytest
from tests.formats.conftest import FOLDERS, file_name, make_trajectory
from tests.formats.samples import SAMPLES, write_sample

from vioapr.errors import ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import FORMATS, rank_formats, read_trajectory
from vioapr.geometry import rigid
from vioapr.trajectory import Trajectory

ALL = pytest.mark.parametrize("format_", FORMATS.values(), ids=FORMATS)
WRITTEN = [f for f in FORMATS.values() if f.write is not None]
FILES = [f for f in WRITTEN if f.name not in FOLDERS]


def assert_same_poses(left, right, tolerance=1e-12):
    scale = np.abs(left.position_m).max()
    np.testing.assert_allclose(left.position_m, right.position_m, rtol=0, atol=tolerance * scale)
    assert rigid.angle_deg(left.target_from_source, right.target_from_source).max() < 1e-11


@ALL
def test_writing_and_reading_gives_the_same(format_, tmp_path):
    original = make_trajectory(format_)
    path = tmp_path / file_name(format_)
    write_sample(format_, path, original)
    read = format_.read(path, ReadOptions())
    assert_same_poses(original, read)
    assert read.is_timed == format_.has_times
    np.testing.assert_array_equal(read.timestamp_s, original.timestamp_s)
    assert read.names == original.names


@ALL
def test_a_written_file_is_recognized(format_, tmp_path):
    path = tmp_path / file_name(format_)
    write_sample(format_, path, make_trajectory(format_))
    best, confidence = rank_formats(path)[0]
    assert best.name == format_.name
    assert 0.5 < confidence <= 1
    assert_same_poses(read_trajectory(path), make_trajectory(format_))


@pytest.mark.parametrize("format_", FILES, ids=lambda f: f.name)
def test_gzip_is_transparent(format_, tmp_path):
    path = tmp_path / (file_name(format_) + ".gz")
    format_.write(path, make_trajectory(format_))
    gzip.decompress(path.read_bytes())
    assert rank_formats(path)[0][0].name == format_.name
    assert_same_poses(read_trajectory(path), make_trajectory(format_))


@ALL
def test_one_pose_is_enough(format_, tmp_path):
    path = tmp_path / file_name(format_)
    write_sample(format_, path, make_trajectory(format_, 1))
    assert len(format_.read(path, ReadOptions())) == 1


def test_formats_without_a_writer_have_samples():
    assert {f.name for f in FORMATS.values() if f.write is None} == set(SAMPLES)


@pytest.mark.parametrize("format_", WRITTEN, ids=lambda f: f.name)
def test_formats_with_times_refuse_untimed_trajectories(format_, tmp_path):
    untimed = Trajectory.from_arrays([0, 1], np.zeros((2, 3)), [[0, 0, 0, 1]] * 2, is_timed=False)
    path = tmp_path / file_name(format_)
    if format_.has_times and format_.name != "record3d":
        with pytest.raises(ParameterError, match="needs timestamps"):
            format_.write(path, untimed)
    else:
        format_.write(path, untimed)
        read = format_.read(path, ReadOptions())
        assert not read.is_timed
        assert (read.names is not None) == format_.has_names


@pytest.mark.parametrize("name", ["hloc", "hrapr", "mstransformer", "colmap", "colmap-binary"])
@pytest.mark.parametrize("image", ["new\nline.png", "", " lead.png", "#hash.png"])
def test_names_that_cannot_be_read_back_are_refused(name, image, tmp_path):
    bad = Trajectory.from_arrays([0], [[0, 0, 0]], [[0, 0, 0, 1]], [image], is_timed=False)
    with pytest.raises(ParameterError, match="cannot hold the image name"):
        FORMATS[name].write(tmp_path / "poses.txt", bad)


def test_names_with_spaces_survive_where_they_can(tmp_path):
    original = Trajectory.from_arrays(
        [0], [[1, 2, 3]], [[0, 0, 0, 1]], ["my walk/a 1.png"], is_timed=False
    )
    for name in ("colmap", "colmap-binary", "mstransformer", "nerfstudio"):
        path = tmp_path / FILES_OF[name]
        FORMATS[name].write(path, original)
        assert read_trajectory(path, name).names == original.names
    with pytest.raises(ParameterError, match="cannot hold"):
        FORMATS["hloc"].write(tmp_path / "poses.txt", original)


FILES_OF = {name: file_name(FORMATS[name]) for name in FORMATS}


def test_7scenes_images_must_stay_in_the_folder(tmp_path):
    for name in ("../a.color.png", "/etc/a.color.png", "x/../../a.color.png"):
        bad = Trajectory.from_arrays([0], [[0, 0, 0]], [[0, 0, 0, 1]], [name], is_timed=False)
        with pytest.raises(ParameterError, match="leads out"):
            FORMATS["7scenes"].write(tmp_path / "out", bad)


def test_record3d_zip(tmp_path):
    original = make_trajectory(FORMATS["record3d"])
    path = tmp_path / "walk.r3d"
    FORMATS["record3d"].write(path, original)
    assert path.read_bytes()[:2] == b"PK"
    assert_same_poses(read_trajectory(path), original)


@pytest.mark.parametrize("name", ["colmap", "colmap-binary"])
def test_colmap_models_are_read_alike_by_pycolmap(name, tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    original = make_trajectory(FORMATS[name])
    FORMATS[name].write(tmp_path / "model", original)
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    images = sorted(model.images.values(), key=lambda image: image.name)
    assert tuple(image.name for image in images) == original.names
    centres = np.array([image.projection_center() for image in images])
    np.testing.assert_allclose(centres, original.position_m, rtol=0, atol=1e-10)
    forward = np.array([image.viewing_direction() for image in images])
    expected = original.target_from_source.to_matrix()[:, :3, 2]
    np.testing.assert_allclose(forward, expected, rtol=0, atol=1e-10)
    # And the other way: what pycolmap writes is read alike.
    (tmp_path / "theirs").mkdir()
    write = model.write_text if name == "colmap" else model.write_binary
    write(str(tmp_path / "theirs"))
    assert rank_formats(tmp_path / "theirs")[0][0].name == name
    theirs = read_trajectory(tmp_path / "theirs")
    assert theirs.names == original.names
    assert_same_poses(theirs, original, 1e-9)
