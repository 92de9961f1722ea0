import numpy as np
import pytest
from tests.court import make_court

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.trust import find_fault
from vioapr.simulation.court import COUNT

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def model_of(images, poses, rows, miss_px=0.5):
    """A reconstruction of some images at given poses, with one point that all see."""
    camera = pycolmap.Camera.create_from_model_name(1, "PINHOLE", 300.0, 480, 360)
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    track = pycolmap.Track()
    for row in rows:
        offset, quat = poses.at(row).inverse()
        image = pycolmap.Image(images.names[row], camera_id=1, image_id=int(row) + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([240.0, 180.0]))])
        model.add_image_with_trivial_frame(
            image, pycolmap.Rigid3d(pycolmap.Rotation3d(quat), offset)
        )
        track.add_element(int(row) + 1, 0)
    id_ = model.add_point3D(np.zeros(3), track)
    model.point3D(id_).error = miss_px
    return model


FIRST_WALK = np.arange(COUNT)


def test_a_model_that_agrees_with_vio_has_no_fault(rng):
    images, truth = make_court(rng)
    half = Rigid3(0.5 * truth.translation_m, truth.quat_xyzw)  # models have a scale of their own
    assert find_fault(model_of(images, half, FIRST_WALK), images, COUNT) == ""


def test_too_few_images(rng):
    images, truth = make_court(rng)
    fault = find_fault(model_of(images, truth, FIRST_WALK[: COUNT // 2]), images, COUNT)
    assert fault == f"{COUNT // 2} images of {COUNT} registered"


def test_points_far_from_where_they_are_seen(rng):
    images, truth = make_court(rng)
    fault = find_fault(model_of(images, truth, FIRST_WALK, miss_px=2.5), images, COUNT)
    assert "reprojection error 2.50 px, expected at most 1.50" in fault


def test_a_folded_model(rng):
    images, truth = make_court(rng)
    folded = Rigid3(truth.translation_m.copy(), truth.quat_xyzw)
    folded.translation_m[1:COUNT:2] += [2.0, 0.0, 0.0]
    assert "otherwise than VIO" in find_fault(model_of(images, folded, FIRST_WALK), images, COUNT)


def test_a_walk_that_did_not_move(rng):
    images, truth = make_court(rng)
    still = Rigid3(np.zeros_like(truth.translation_m), truth.quat_xyzw)
    fault = find_fault(model_of(images, still, FIRST_WALK), images, COUNT)
    assert fault == "VIO says nothing about its scale"
