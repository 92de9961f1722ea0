import numpy as np

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.registration import RegisteredImage, pairs_by_vio
from vioapr.work.steps import Steps

FORWARD = np.array([0.0, 0.0, 0.0, 1.0])


def images_along_x(vio_x_m, world):
    count = len(vio_x_m)
    zeros, yes = np.zeros(count, dtype=np.intp), np.ones(count, dtype=bool)
    positions = np.column_stack([vio_x_m, np.zeros((count, 2))])
    return MapImages(
        tuple(f"{k}.jpg" for k in range(count)), zeros, ("a",), np.arange(count) * 1.0,
        np.array(world), Rigid3(positions, np.tile(FORWARD, (count, 1))), yes, yes, yes, zeros,
        (), "", np.arange(count), {},
    )  # fmt: skip


def test_lost_images_are_sought_where_vio_says():
    """Rows 0 to 2 are the map, at 0, 4 and 8 m; 3 is registered at 1 m; 4 is 3 m further on."""
    images = images_along_x([0, 4, 8, 100, 103, 7], [0, 0, 0, 1, 1, 2])
    mapped = np.array([0, 1, 2])
    poses = images.vio_from_cam.at(mapped)
    found = [
        RegisteredImage(
            row=3, position_m=[1.0, 0, 0], quat_xyzw=FORWARD.tolist(), inliers=50, error_px=0.5
        )
    ]
    pairs = pairs_by_vio(images, np.array([3, 4, 5]), found, mapped, poses, 2)
    assert pairs.tolist() == [[4, 1], [4, 0]]  # 5 is in a world where nothing is registered
    assert len(pairs_by_vio(images, np.array([4]), [], mapped, poses, 2)) == 0


def test_poses_survive_a_steps_marker(tmp_path):
    quat = (np.array([0.1, 0.2, 0.3, 0.4]) / np.sqrt(0.3)).tolist()
    given = RegisteredImage(
        row=3, position_m=[1 / 3, 2, 3], quat_xyzw=quat, inliers=50, error_px=0.5
    )
    for _ in range(2):
        (again,) = Steps(tmp_path).run("test", 1, lambda _: [given], list[RegisteredImage])
        assert again == given
    np.testing.assert_array_equal(again.world_from_cam.translation_m, [1 / 3, 2, 3])
    np.testing.assert_array_equal(again.world_from_cam.quat_xyzw, quat)
