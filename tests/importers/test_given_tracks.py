"""A folder of images with poses and ground truth: both are checked by each other."""

import numpy as np
import pytest
from PIL import Image

from vioapr.errors import ParameterError, SuspectTrackError
from vioapr.formats import conventions, tum
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.importers.base import ImportOptions
from vioapr.importers.images import read_walk
from vioapr.simulation.walks import WalkParams, simulate_walk

BODY_FROM_CAM = Rigid3(
    np.array([0.03, 0.0, 0.05]), quaternion.from_rotvec(np.array([0.04, -0.03, 1.6]))
)


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=90), seed=6)


@pytest.fixture
def read(walk, tmp_path):
    """Imports images named by time with a tracker's poses, changed, and ground truth."""
    folder = tmp_path / "images"
    folder.mkdir()
    for time_s in walk.gt.timestamp_s:
        Image.new("RGB", (8, 6)).save(folder / f"{time_s:.6f}.jpg")
    tum.write(tmp_path / "gt.tum", walk.gt)

    def call(change, **options):
        poses = walk.vio.with_transforms(change(walk.vio.target_from_source))
        tum.write(tmp_path / "poses.tum", poses)
        given = ImportOptions(poses=tmp_path / "poses.tum", **options)
        return read_walk(folder, given)

    return call


def warnings_of(walk):
    return [finding.text for finding in walk.findings if finding.is_warning]


def test_right_tracks(read, tmp_path):
    assert warnings_of(read(lambda poses: poses, gt=tmp_path / "gt.tum")) == []


def test_opengl_axes_are_named_with_the_remedy(read, tmp_path):
    (warning,) = warnings_of(read(conventions.world_from_arcam, gt=tmp_path / "gt.tum"))
    assert warning.startswith("convention: poses.tum fits gt.tum as OpenGL camera axes")
    assert warning.endswith(f"{tmp_path / 'poses.tum'} fixed.tum --reading opengl`")
    with pytest.raises(SuspectTrackError, match="poses.tum fits gt.tum as OpenGL camera axes"):
        read(conventions.world_from_arcam, gt=tmp_path / "gt.tum", strict=True)


def test_a_body_is_named_and_turned(read, walk, tmp_path):
    def to_body(poses):
        return poses @ BODY_FROM_CAM.inverse()

    (warning,) = warnings_of(read(to_body, gt=tmp_path / "gt.tum"))
    assert "poses.tum holds poses of a device turned by" in warning
    assert "`vio_from_cam`" in warning
    turned = read(to_body, gt=tmp_path / "gt.tum", vio_from_cam="auto")
    assert warnings_of(turned) == []
    expected = walk.vio.target_from_source
    assert rigid.angle_deg(turned.vio_from_cam, expected).max() < 0.5
    assert rigid.distance_m(turned.vio_from_cam, expected).max() < 0.1


def test_auto_needs_ground_truth(read):
    with pytest.raises(ParameterError, match="auto needs another track"):
        read(lambda poses: poses, vio_from_cam="auto")
