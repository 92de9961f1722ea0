import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.court import make_court

from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.pruning import prune_pairs, tilt_deg
from vioapr.simulation.court import COUNT, crossing_rows, sequential_rows

pytestmark = pytest.mark.slow

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")

FOCAL, WIDTH, HEIGHT = 300.0, 480, 360


def wall_points(rng, truth, row):
    """Points on the wall that an image looks at, some metres about where it looks."""
    depth = rng.uniform(6.0, 9.0, 60)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (60, 2)), np.ones(60)])
    return truth.at(row).apply(rays * depth[:, None])


def pixels(points, world_from_cam: Rigid3):
    seen = world_from_cam.inverse().apply(points)
    return FOCAL * seen[:, :2] / seen[:, 2:] + [WIDTH / 2, HEIGHT / 2]


def write_database(path, rng, images, truth, pairs):
    """Matches of pairs of images; of those of `wrong`, one image looks at the next window."""
    camera = pycolmap.Camera.create_from_model_name(1, "PINHOLE", FOCAL, WIDTH, HEIGHT)
    keypoints = [np.zeros((0, 2))] * len(images)
    geometries = []
    for first, second, offset_m in pairs:
        points = wall_points(rng, truth, first)
        right = Rotation.from_quat(truth.quat_xyzw[second]).apply([offset_m, 0.0, 0.0])
        ghost = Rigid3(truth.translation_m[second] + right, truth.quat_xyzw[second])
        start = len(keypoints[first]), len(keypoints[second])
        for row, pose in ((first, truth.at(first)), (second, ghost)):
            seen = pixels(points, pose) + 0.3 * rng.standard_normal((60, 2))
            keypoints[row] = np.concatenate([keypoints[row], seen])
        geometries.append((first, second, np.arange(60)[:, None] + np.array(start)))
    with pycolmap.Database.open(path) as database:
        camera_id = database.write_camera(camera)
        ids = [database.write_image(pycolmap.Image(name, camera_id=camera_id))
               for name in images.names]  # fmt: skip
        for id_, points in zip(ids, keypoints, strict=True):
            database.write_keypoints(id_, points.astype(np.float32))
        for first, second, matches in geometries:
            geometry = pycolmap.estimate_calibrated_two_view_geometry(
                camera, keypoints[first], camera, keypoints[second], matches.astype(np.uint32)
            )
            database.write_two_view_geometry(ids[first], ids[second], geometry)
    return ids


def remaining(path, ids, rows):
    """Which of the pairs still have matches."""
    with pycolmap.Database.open(path) as database:
        return [
            len(database.read_two_view_geometry(ids[a], ids[b]).inlier_matches) > 0 for a, b in rows
        ]


def test_the_next_window_is_found_out(rng, tmp_path):
    """Within a walk and between walks; what is right stays."""
    images, truth = make_court(rng)
    crossing = crossing_rows(1)
    loops = [(k, k + 5) for k in range(0, 35, 3)]
    pairs = [(*row, 0.0) for row in sequential_rows()]
    pairs += [(*row, 4.0 * (k % 3 == 0)) for k, row in enumerate(crossing)]
    pairs += [(*row, -7.0 * (k % 2)) for k, row in enumerate(loops)]
    path = tmp_path / "database.db"
    ids = write_database(path, rng, images, truth, pairs)
    rows = np.array([pair[:2] for pair in pairs])
    is_wrong = np.array([pair[2] != 0 for pair in pairs])
    ticks = []
    count = prune_pairs(path, images, rows, rows[:0], 0, lambda: ticks.append(1))
    kept = np.array(remaining(path, ids, rows))
    assert not kept[is_wrong].any()
    assert kept[~is_wrong].all()
    assert (count, len(ticks)) == (int(is_wrong.sum()), len(pairs))


def test_only_what_is_asked_about_is_emptied(rng, tmp_path):
    images, truth = make_court(rng)
    pairs = [(*row, 0.0) for row in [*sequential_rows(), *crossing_rows(1)]]
    pairs += [(0, 4, -6.0), (1, 5, -6.0)]
    path = tmp_path / "database.db"
    ids = write_database(path, rng, images, truth, pairs)
    rows = np.array([pair[:2] for pair in pairs])
    assert prune_pairs(path, images, rows[-1:], rows[:-1], 0, int) == 1
    assert remaining(path, ids, rows[-2:]) == [True, False]


def test_recordings_whose_pairs_agree_on_no_place(rng, tmp_path):
    """Look-alikes all about: nothing but pairs of different windows."""
    images, truth = make_court(rng)
    far = [(k, COUNT + (k + 1) % COUNT) for k in range(0, COUNT, 8)]
    pairs = [(*row, 0.0) for row in sequential_rows()]
    pairs += [(*row, 9.0 * k - 18.0 + 2.0) for k, row in enumerate(far)]
    path = tmp_path / "database.db"
    ids = write_database(path, rng, images, truth, pairs)
    rows = np.array([pair[:2] for pair in pairs])
    prune_pairs(path, images, rows, rows[:0], 0, int)
    assert not any(remaining(path, ids, far))


def test_no_pairs(rng, tmp_path):
    images, truth = make_court(rng)
    write_database(tmp_path / "database.db", rng, images, truth, [])
    nothing = np.zeros((0, 2), dtype=np.intp)
    assert prune_pairs(tmp_path / "database.db", images, nothing, nothing, 0, int) == 0


def test_tilt_of_poses(rng):
    """The world is z up; VIO's y up is turned onto it, then by 7 deg off."""
    images, truth = make_court(rng)
    z_up = Rotation.from_euler("x", 90, degrees=True)
    true = Rotation.from_quat(truth.quat_xyzw)
    rows, nowhere = np.arange(len(images)), np.zeros((len(images), 3))
    right = Rigid3(nowhere, (z_up * true).as_quat())
    assert tilt_deg(images, rows, right).max() < 1e-5
    off = Rotation.from_euler("y", 7, degrees=True) * z_up * true
    np.testing.assert_allclose(tilt_deg(images, rows, Rigid3(nowhere, off.as_quat())), 7, atol=1e-6)
