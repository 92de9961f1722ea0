"""A folder of images with any trajectory: by names, timestamps or order."""

import numpy as np
import pytest
from tests.formats.conftest import file_name
from tests.importers.sources import (
    COUNT,
    make_images,
    map_of,
    named,
    read_walks,
    texts,
    walk,
    write_images,
)

from vioapr.errors import FormatError
from vioapr.formats import tum
from vioapr.formats.registry import FORMATS
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.importers.images import IMPORTER
from vioapr.trajectory import Trajectory

NOT_OF_A_CAMERA = {"euroc", "aria"}  # of a body, whose axes the up test does not know


@pytest.fixture
def source(tmp_path):
    return make_images(tmp_path)


def test_by_order(source):
    (found,) = read_walks(
        IMPORTER, source / "images", poses=source / "vio.tum", gt=source / "gt.tum"
    )
    assert (found.id, found.split, found.info.tracker) == ("images", "train", "vio.tum")
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(found.timestamp_s, walk().timestamp_s)
    np.testing.assert_allclose(found.gt.position_m, map_of(walk()).position_m)
    assert "pose k is taken to be of image k" in texts(found, warnings=False)
    assert found.info.clock == "device"


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in NOT_OF_A_CAMERA])
def test_every_format(name, tmp_path):
    format_ = FORMATS[name]
    names = [f"frame-{k:06d}.color.png" for k in range(COUNT)]
    write_images(tmp_path / "images", names)
    vio = walk()
    if not format_.has_times:
        vio = named(vio, names)
    path = tmp_path / file_name(format_)
    format_.write(path, vio)
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=path)
    assert np.isfinite(found.vio_from_cam.translation_m).all()
    steps = np.linalg.norm(np.diff(found.vio_from_cam.translation_m, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(np.diff(walk().position_m, axis=0), axis=1))


def test_a_z_up_world_is_turned(source):
    z_up = walk().with_transforms(z_up_from_y_up(walk().target_from_source))
    tum.write(source / "vio.tum", z_up)
    (found,) = read_walks(IMPORTER, source / "images", poses=source / "vio.tum")
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    assert "world of vio.tum: z up, turned to y up" in texts(found, warnings=False)


@pytest.mark.parametrize(("scale", "digits"), [(1, 6), (1e3, 0), (1e6, 0), (1e9, 0)])
def test_by_timestamps_in_names(scale, digits, tmp_path):
    times = 1700000000 + walk().timestamp_s
    write_images(tmp_path / "images", [f"{scale * t:.{digits}f}.png" for t in times])
    tum.write(
        tmp_path / "vio.tum", Trajectory(times, *walk().target_from_source).at_rows(slice(2, 15))
    )
    (found,) = read_walks(IMPORTER, tmp_path / "images", poses=tmp_path / "vio.tum")
    np.testing.assert_allclose(found.timestamp_s, times, atol=1e-6, rtol=0)
    assert np.flatnonzero(np.isfinite(found.vio_from_cam.translation_m[:, 0])).tolist() == list(
        range(2, 15)
    )
    assert "poses: 7 of 20 frames have none" in texts(found, warnings=True)


def test_poses_of_no_image_are_counted(source):
    names = [f"frame-{k:04d}.jpg" for k in range(5, COUNT + 5)]
    FORMATS["hloc"].write(source / "vio.txt", named(walk(), names))
    (found,) = read_walks(IMPORTER, source / "images", poses=source / "vio.txt")
    assert "vio.txt: 5 of 20 poses belong to no image" in texts(found, warnings=True)
    assert "poses: 5 of 20 frames have none" in texts(found, warnings=True)


def test_a_rate(source):
    (found,) = read_walks(IMPORTER, source / "images", rate_hz=4)
    assert found.timestamp_s[:3].tolist() == [0, 0.25, 0.5]
    assert found.info.clock == "frame-rate"
    assert "no timestamps: 4 Hz" in texts(found, warnings=False)
    assert not found.info.tracker


def test_another_number_of_poses(source):
    tum.write(source / "vio.tum", walk(COUNT - 1))
    with pytest.raises(FormatError, match=r"as many as poses \(19\), got 20 images"):
        read_walks(IMPORTER, source / "images", poses=source / "vio.tum")


def test_names_that_do_not_meet(source):
    FORMATS["hloc"].write(source / "vio.txt", named(walk(), [f"x{k}.jpg" for k in range(COUNT)]))
    with pytest.raises(FormatError, match=r"vio.txt: expected names that fit the 20 images"):
        read_walks(IMPORTER, source / "images", poses=source / "vio.txt")


def test_no_images(tmp_path):
    with pytest.raises(FormatError, match=r"expected images \(.jpg, .png\), found none"):
        read_walks(IMPORTER, tmp_path)


def test_real_images_with_real_odometry(data_dir, tmp_path):
    folder = data_dir / "redkitchen_seq01_images"
    rows = np.genfromtxt(folder / "poses.csv", delimiter=",", names=True, dtype=None, encoding=None)
    positions = np.stack([rows[f"dslam_{axis}"] for axis in "xyz"], axis=1)
    quats = np.stack([rows[f"dslam_q{axis}"] for axis in "xyzw"], axis=1)
    tum.write(tmp_path / "dslam.tum", Trajectory(rows["t"], positions, quats))
    (found,) = read_walks(IMPORTER, folder / "images", poses=tmp_path / "dslam.tum")
    assert len(found) == 500
    np.testing.assert_allclose(found.vio_from_cam.translation_m, positions)
    # RGB-D SLAM's world is that of its first frame, y down.
    assert "nearest to -y: marked as not gravity-aligned" in texts(found, warnings=True)
    assert not found.info.is_gravity_aligned
