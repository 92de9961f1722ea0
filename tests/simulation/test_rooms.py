import numpy as np
import pytest

from vioapr.geometry import rigid
from vioapr.geometry.frames import y_up_from_z_up
from vioapr.scene.check import check_scene
from vioapr.scene.frames import Intrinsics
from vioapr.simulation.handheld import look_at
from vioapr.simulation.rooms import (
    BOX_CAMERA,
    ROOM_CAMERA,
    Room,
    coloured_box,
    make_box_scene,
    make_room_scene,
    render,
    stand_about,
    textured_room,
    walk_arc,
)

CAMERA = Intrinsics(40, 30, 20.0, 20.0, 20.0, 15.0)
CORNER_M = np.array([2.0, 2.0, 2.0])


@pytest.mark.parametrize(
    ("target", "wall"),
    [((-1, 0, 0), 0), ((1, 0, 0), 1), ((0, -1, 0), 2), ((0, 1, 0), 3), ((1e-3, 0, -1), 4),
     ((1e-3, 0, 1), 5)],
)  # fmt: skip
def test_walls_are_numbered(target, wall):
    room = Room(-CORNER_M, CORNER_M, lambda point, side: 10.0 * side)
    image = render(room, CAMERA, look_at([0, 0, 0], target))
    assert image.shape == (30, 40)
    assert image[15, 20] == 10 * wall


def test_a_point_on_a_wall_is_drawn_where_it_projects_to():
    spot = np.array([2.0, 0.7, -0.4])
    room = Room(-CORNER_M, CORNER_M, lambda point, side:
                255.0 * (np.linalg.norm(point - spot, axis=1) < 0.12))  # fmt: skip
    camera = look_at([-1.0, 0.2, 0.3], [2.0, 0.0, 0.0])
    x, y, z = camera.inverse().apply(spot)
    row, column = np.argwhere(render(room, CAMERA, camera) > 0).mean(axis=0) + 0.5
    assert column == pytest.approx(20 * x / z + 20, abs=0.5)
    assert row == pytest.approx(20 * y / z + 15, abs=0.5)


@pytest.mark.slow
def test_the_seed_decides_the_textures():
    camera = walk_arc(1, 0, 0, 1.0, 1.5).target_from_source.at(0)
    first, again, other = (render(textured_room(seed), ROOM_CAMERA, camera) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first.astype(float) - other).mean() > 20
    assert first.std() > 25


def test_the_box_has_colours_and_a_brightness():
    camera = stand_about(1, 0).target_from_source.at(0)
    bright, dark = (render(coloured_box(share), BOX_CAMERA, camera) for share in (1.0, 0.5))
    assert bright.shape == (36, 48, 3)
    np.testing.assert_allclose(dark, bright / 2, atol=1)
    assert bright.std(axis=(0, 1)).min() > 15


@pytest.mark.slow
def test_the_room_scene_is_whole_and_its_truth_is_apart(tmp_path):
    scene, truth = make_room_scene(tmp_path / "scene")
    assert not check_scene(scene.folder, decode=True).errors
    assert scene.splits == {"train": ("a", "b"), "test": ("t",)}
    for id_, gt in truth.items():
        assert scene.gt(id_) is None
        frames = scene.recording(id_).frames
        true_m = rigid.distance_m(gt.target_from_source.at(0), gt.target_from_source.at(-1))
        vio_m = rigid.distance_m(frames.vio_from_cam.at(0), frames.vio_from_cam.at(-1))
        assert vio_m == pytest.approx(true_m, rel=0.02)


def test_the_box_scene_has_exact_vio_and_ground_truth(tmp_path):
    scene = make_box_scene(tmp_path / "scene", train=2, test=1, frames=3)
    assert not check_scene(scene.folder, decode=True).errors
    assert scene.splits == {"train": ("train-1", "train-2"), "test": ("test-1",)}
    frames, gt = scene.recording("train-2").frames, scene.gt("train-2")
    expected = y_up_from_z_up(gt.target_from_source)
    assert rigid.distance_m(frames.vio_from_cam, expected).max() < 1e-6
    assert list(frames.image) == ["000.png", "001.png", "002.png"]
