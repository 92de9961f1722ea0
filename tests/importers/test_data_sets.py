"""MARViN, ADVIO, 7-Scenes, Cambridge Landmarks and transforms.json."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.importers.sources import (
    COUNT,
    make_marvin,
    make_nerfstudio,
    map_of,
    named,
    read_walks,
    texts,
    walk,
    write_images,
)

from vioapr.errors import FormatError, ParameterError
from vioapr.formats import advio, cambridge, conventions, marvin, sevenscenes
from vioapr.formats.base import ReadOptions
from vioapr.geometry import quaternion
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import align_umeyama
from vioapr.importers.advio import IMPORTER as ADVIO
from vioapr.importers.base import ImportOptions
from vioapr.importers.cambridge import IMPORTER as CAMBRIDGE
from vioapr.importers.marvin import IMPORTER as MARVIN
from vioapr.importers.nerfstudio import IMPORTER as NERFSTUDIO
from vioapr.importers.sevenscenes import IMPORTER as SEVENSCENES
from vioapr.trajectory import Trajectory


@pytest.fixture
def church(tmp_path):
    return make_marvin(tmp_path / "Church")


def test_marvin(church):
    (scene,) = MARVIN.read(church, ImportOptions())
    assert (scene.name, scene.place, scene.world.is_gravity_aligned) == ("Church", "outdoor", True)
    train, test = read_walks(MARVIN, church)
    assert (train.id, train.split, train.info.tracker) == ("train-1", "train", "ARKit")
    assert (test.id, test.split, test.info.tracker) == ("test-1", "test", "ARCore")
    np.testing.assert_allclose(train.vio_from_cam.translation_m, walk().position_m)
    np.testing.assert_allclose(train.gt.position_m, map_of(walk()).position_m)
    angles = quaternion.angle_between_deg(train.gt.quat_xyzw, map_of(walk()).quat_xyzw)
    assert angles.max() < 1e-5
    # 1 Hz outdoors.
    assert train.timestamp_s.tolist() == list(range(COUNT))
    assert train.image_names[2] == "0002.jpg"
    assert list(train.images)[2] == church / "train-1/0002.jpg"
    notes = texts(train, warnings=False)
    assert "map rotations are cam_from_world in the file: fits the tracker" in notes
    assert "map: up is +z by the tracker, 0 deg off" in notes
    assert not texts(train, warnings=True)


def test_marvin_rotations_of_the_other_direction_are_noticed(church):
    inverted = conventions.centre_and_cam_from_world(map_of(walk()).target_from_source)
    names = [f"train-1/{k:04d}.jpg" for k in range(COUNT)]
    wrong = map_of(walk()).with_transforms(inverted)
    marvin.FORMAT.write(church / "train.txt", named(wrong, names))
    train, _ = read_walks(MARVIN, church)
    assert "fit the tracker as world_from_cam" in texts(train, warnings=True)
    angles = quaternion.angle_between_deg(train.gt.quat_xyzw, map_of(walk()).quat_xyzw)
    assert angles.max() < 1e-5


def test_marvin_several_scenes_and_rates(tmp_path):
    make_marvin(tmp_path / "Church")
    make_marvin(tmp_path / "Office")
    church, office = MARVIN.read(tmp_path, ImportOptions())
    assert (church.place, office.place) == ("outdoor", "indoor")
    assert next(office.read()).timestamp_s[:3].tolist() == [0, 0.5, 1]


def test_marvin_gaps_in_frame_numbers_are_gaps_in_time(church):
    for name in ("train.txt", "ARKit.txt"):
        lines = (church / name).read_text().splitlines()
        (church / name).write_text("\n".join(lines[:5] + lines[8:]) + "\n")
    train, _ = read_walks(MARVIN, church)
    assert train.timestamp_s[3:7].tolist() == [3, 4, 8, 9]


def test_marvin_frames_that_one_file_lacks(church):
    lines = (church / "ARKit.txt").read_text().splitlines()
    (church / "ARKit.txt").write_text("\n".join(lines[:-2]) + "\n")
    lines = (church / "train.txt").read_text().splitlines()
    (church / "train.txt").write_text("\n".join(lines[1:]) + "\n")
    train, _ = read_walks(MARVIN, church)
    assert len(train) == COUNT
    assert "18 with tracker's pose, 19 with ground truth" in texts(train, warnings=False)
    assert "poses: 2 of 20 frames have none" in texts(train, warnings=True)


def test_marvin_sensors(church):
    # Unity, held upright: gravity is along the screen's -y.
    names = [f"train-1/{k:04d}.jpg" for k in range(COUNT)]
    down = quaternion.rotate(quaternion.inverse(walk().quat_xyzw), np.array([0.0, -1.0, 0.0]))
    screen = down * [1, -1, -1]
    rows = [f"{n} {x} {y} {z}" for n, (x, y, z) in zip(names, screen.tolist(), strict=True)]
    (church / "accel.txt").write_text("\n".join(rows) + "\n")
    (church / "GPS.txt").write_text("\n".join(f"{n} 22.3 114.2 30" for n in names[:5]) + "\n")
    (church / "compass.txt").write_text("\n".join(f"{n} -10" for n in names) + "\n")
    train, test = read_walks(MARVIN, church)
    assert train.gnss.latitude_deg.tolist() == [22.3] * 5
    assert train.heading.heading_deg.tolist() == [350] * COUNT
    notes = texts(train, warnings=False)
    assert "accelerometer: taken as turned by 0 deg on the screen" in notes
    assert "agrees with the tracker's up to 0.0 deg" in notes
    assert (test.gnss, test.imu, test.heading) == (None, None, None)


def test_marvin_accelerometer_that_fits_in_no_way(church):
    rows = [f"train-1/{k:04d}.jpg 0 0 1" for k in range(COUNT)]
    (church / "accel.txt").write_text("\n".join(rows) + "\n")
    train, _ = read_walks(MARVIN, church)
    assert train.imu is None
    assert "fits the tracker's gravity in no way" in texts(train, warnings=True)


def test_marvin_of_another_place_needs_a_rate(tmp_path):
    make_marvin(tmp_path / "Garden")
    with pytest.raises(ParameterError, match="`rate_hz`"):
        MARVIN.read(tmp_path / "Garden", ImportOptions())
    (garden,) = MARVIN.read(tmp_path / "Garden", ImportOptions(rate_hz=2))
    assert garden.place is None


def test_marvin_without_tracker(church):
    (church / "ARKit.txt").unlink()
    train, test = read_walks(MARVIN, church)
    assert train.info.tracker == ""
    assert "no tracker's file (ARKit.txt, ARCore.txt)" in texts(train, warnings=True)
    assert test.info.tracker == "ARCore"


def test_no_marvin(tmp_path):
    with pytest.raises(FormatError, match=r"expected train.txt or test.txt, found none"):
        MARVIN.read(tmp_path, ImportOptions())


def advio_files(folder, turn_deg=40.0):
    """A raw sequence of a walk, its rotations turned as the data set's are."""
    vio = walk(400)
    turn = quaternion.from_rotvec(np.array([0.0, 0.0, np.deg2rad(turn_deg)]))
    turned = Rigid3(vio.position_m, quaternion.multiply(turn, vio.quat_xyzw))
    advio.VIO_FORMAT.write(folder / "advio-07_arkit.csv", vio.with_transforms(turned))
    # The ground truth's world is y up too, and is turned about y and moved.
    world = Rigid3(np.array([3.0, 0, 5]), quaternion.from_rotvec(np.array([0, 1.0, 0])))
    gt = world @ vio.target_from_source
    about_y = quaternion.from_rotvec(np.array([0.0, np.deg2rad(turn_deg), 0.0]))
    quats = quaternion.multiply(quaternion.multiply(about_y, gt.quat_xyzw), turn)
    advio.FORMAT.write(
        folder / "advio-07_gt_pose.csv",
        Trajectory(vio.timestamp_s, gt.translation_m, quats),
    )
    return vio, gt


def test_advio_turn_is_found_and_undone(tmp_path):
    vio, gt = advio_files(tmp_path)
    (found,) = read_walks(ADVIO, tmp_path)
    assert (found.id, found.split, found.info.has_images) == ("advio-07", "test", False)
    assert "a turn of 40 deg about z was undone" in texts(found, warnings=False)
    angles = quaternion.angle_between_deg(found.vio_from_cam.quat_xyzw, vio.quat_xyzw)
    assert angles.max() < 0.1
    expected = z_up_from_y_up(gt)
    assert quaternion.angle_between_deg(found.gt.quat_xyzw, expected.quat_xyzw).max() < 0.2
    np.testing.assert_allclose(found.gt.position_m, expected.translation_m, atol=1e-9)


def test_advio_that_does_not_belong_together(tmp_path):
    advio_files(tmp_path)
    path = tmp_path / "advio-07_gt_pose.csv"
    rows = path.read_text().splitlines()
    times = [row.split(",")[0] for row in rows]
    shuffled = np.random.default_rng(0).permutation(rows)
    rows = [f"{t}," + row.split(",", 1)[1] for t, row in zip(times, shuffled, strict=True)]
    path.write_text("\n".join(rows) + "\n")
    (found,) = read_walks(ADVIO, tmp_path)
    assert "they do not belong together" in texts(found, warnings=True)


def test_advio_of_a_clock_of_its_own(tmp_path):
    vio, _ = advio_files(tmp_path)
    late = advio.VIO_FORMAT.read(tmp_path / "advio-07_arkit.csv", ReadOptions())
    late = replace(late, timestamp_s=late.timestamp_s - 1.37)
    advio.VIO_FORMAT.write(tmp_path / "advio-07_arcore.csv", late)
    (found,) = read_walks(ADVIO, tmp_path, tracker="arcore")
    assert "clock: +1.37 s were added" in texts(found, warnings=False)
    np.testing.assert_allclose(found.timestamp_s, vio.timestamp_s, atol=0.006)
    assert "a turn of 40 deg about z was undone" in texts(found, warnings=False)


def test_advio_trackers_of_one_walk_agree_on_the_turn(data_dir):
    raw = data_dir / "advio/raw_decimated"
    gt = advio.FORMAT.read(raw / "advio-18_gt_pose.csv.gz", ReadOptions())
    arkit, arcore = (
        advio.VIO_FORMAT.read(raw / f"advio-18_{tracker}.csv.gz", ReadOptions())
        for tracker in ("arkit", "arcore")
    )
    assert abs(advio.find_clock_offset(gt, arkit)) < 0.02
    offset_s = advio.find_clock_offset(gt, arcore)
    arcore = replace(arcore, timestamp_s=arcore.timestamp_s + offset_s)
    assert abs(advio.find_turn(gt, arkit).angle_deg - advio.find_turn(gt, arcore).angle_deg) < 2


def test_no_advio(tmp_path):
    with pytest.raises(FormatError, match="expected ADVIO sequences"):
        ADVIO.read(tmp_path, ImportOptions())
    with pytest.raises(ParameterError, match="expected arkit or arcore, got 'tango'"):
        ADVIO.read(tmp_path, ImportOptions(tracker="tango"))


def ate_m(found):
    """RMSE of positions after the best rigid alignment."""
    rows = np.searchsorted(found.timestamp_s, found.gt.timestamp_s)
    positions = found.vio_from_cam.translation_m[rows]
    aligned = align_umeyama(positions, found.gt.position_m).apply(positions)
    return np.sqrt(np.square(aligned - found.gt.position_m).sum(axis=1).mean())


@pytest.mark.slow
@pytest.mark.parametrize("sequence", ["03", "18"])
def test_raw_advio_is_as_good_as_corrected(sequence, data_dir):
    raw = data_dir / f"advio/raw_decimated/advio-{sequence}_arkit.csv.gz"
    corrected = data_dir / f"advio/tum10hz/advio-{sequence}_arkit.tum.gz"
    (mine,), (reference,) = read_walks(ADVIO, raw), read_walks(ADVIO, corrected)
    assert ate_m(mine) < 1.2 * ate_m(reference)
    # Corrected independently, by a fit of the same angle.
    pairs = np.searchsorted(mine.timestamp_s, reference.timestamp_s[5:-5]).clip(max=len(mine) - 1)
    angles = quaternion.angle_between_deg(
        mine.vio_from_cam.quat_xyzw[pairs], reference.vio_from_cam.quat_xyzw[5:-5]
    )
    assert np.median(angles) < 5
    assert "the tracker's +y is up" in texts(mine, warnings=False)
    assert not texts(mine, warnings=True)


def test_a_diverging_tracker_is_reported(data_dir):
    (found,) = read_walks(ADVIO, data_dir / "advio/raw_decimated/advio-23_arkit.csv.gz")
    assert found.info.is_diverging
    assert "the tracker is diverging" in texts(found, warnings=True)


@pytest.fixture
def chess(tmp_path):
    folder = tmp_path / "chess"
    for number in (1, 2):
        names = [f"frame-{k:06d}.color.png" for k in range(COUNT)]
        sevenscenes.write(folder / f"seq-0{number}", named(map_of(walk()), names))
        write_images(folder / f"seq-0{number}", names)
    (folder / "TrainSplit.txt").write_text("sequence1\n")
    (folder / "TestSplit.txt").write_text("sequence2\n")
    return folder


def test_sevenscenes(chess):
    (scene,) = SEVENSCENES.read(chess, ImportOptions())
    assert (scene.name, scene.place, scene.world.is_gravity_aligned) == ("chess", "indoor", False)
    train, test = read_walks(SEVENSCENES, chess)
    assert [(w.id, w.split) for w in (train, test)] == [("seq-01", "train"), ("seq-02", "test")]
    np.testing.assert_allclose(train.gt.position_m, map_of(walk()).position_m)
    assert not np.isfinite(train.vio_from_cam.translation_m).any()
    assert train.image_names[1] == "frame-000001.color.png"
    assert list(train.images)[1] == chess / "seq-01/frame-000001.color.png"
    np.testing.assert_allclose(train.timestamp_s[:2], [0, 1 / 30])
    assert "20 frames: 20 with image, 0 with tracker's pose, 20 with ground" in texts(
        train, warnings=False
    )


def test_one_sequence(chess):
    (found,) = read_walks(SEVENSCENES, chess / "seq-02", split="test", id="b")
    assert (found.id, found.split) == ("b", "test")


def test_sevenscenes_split_of_a_missing_sequence(chess):
    (chess / "TestSplit.txt").write_text("sequence2\nsequence3\n")
    with pytest.raises(FormatError, match=r"TestSplit.txt:2: .*got 'sequence3'"):
        SEVENSCENES.read(chess, ImportOptions())


def test_no_sevenscenes(tmp_path):
    with pytest.raises(FormatError, match="expected folders seq-XX"):
        SEVENSCENES.read(tmp_path, ImportOptions())


def test_cambridge(tmp_path):
    folder = tmp_path / "ShopFacade"
    names = [f"seq{1 + k // 10}/frame{k:05d}.png" for k in range(COUNT)]
    both = named(map_of(walk()), names)
    cambridge.FORMAT.write(folder / "dataset_train.txt", both)
    tested = [f"seq3/frame{k:05d}.png" for k in range(5)]
    cambridge.FORMAT.write(folder / "dataset_test.txt", named(map_of(walk(5)), tested))
    write_images(folder, names + tested)
    found = read_walks(CAMBRIDGE, folder)
    ids = [(w.id, w.split, len(w)) for w in found]
    assert ids == [("seq1", "train", 10), ("seq2", "train", 10), ("seq3", "test", 5)]
    np.testing.assert_allclose(found[1].gt.position_m, map_of(walk()).position_m[10:])
    assert next(iter(found[1].images)) == folder / "seq2/frame00010.png"
    assert found[1].timestamp_s[:2].tolist() == [0, 0.5]


def test_no_cambridge(tmp_path):
    with pytest.raises(FormatError, match=r"expected dataset_train.txt or dataset_test.txt"):
        CAMBRIDGE.read(tmp_path, ImportOptions())


@pytest.fixture
def capture(tmp_path):
    return make_nerfstudio(tmp_path / "capture")


def test_nerfstudio(capture):
    (found,) = read_walks(NERFSTUDIO, capture)
    assert found.id == "capture"
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    assert found.image_names[11] == "11.jpg"
    assert list(found.images)[11] == capture / "images/11.jpg"
    assert [float(column[0]) for column in found.intrinsics] == [16, 12, 20, 21, 8, 6]
    assert "no timestamps" in texts(found, warnings=True)
    assert "the tracker's +y is up" in texts(found, warnings=False)


def change(capture, edit):
    path = capture / "transforms.json"
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


def test_nerfstudio_z_up_world_is_turned(capture):
    z_up = conventions.world_from_arcam(z_up_from_y_up(walk().target_from_source)).to_matrix()

    def turn(content):
        for frame, matrix in zip(content["frames"], z_up.tolist(), strict=True):
            frame["transform_matrix"] = matrix

    change(capture, turn)
    (found,) = read_walks(NERFSTUDIO, capture / "transforms.json")
    np.testing.assert_allclose(found.vio_from_cam.translation_m, walk().position_m, atol=1e-12)
    assert "z up, turned to y up" in texts(found, warnings=False)


def test_nerfstudio_colmap_is_not_metric(capture):
    change(capture, lambda content: content["frames"][0].update(colmap_im_id=1))
    (found,) = read_walks(NERFSTUDIO, capture)
    assert not found.info.is_metric
    assert "the poses are COLMAP's, not metric" in texts(found, warnings=True)


def test_nerfstudio_camera_angle_and_distortion(capture):
    def edit(content):
        del content["fl_x"], content["fl_y"]
        content |= {"camera_angle_x": 2 * np.arctan(0.5), "k1": 0.1}

    change(capture, edit)
    (found,) = read_walks(NERFSTUDIO, capture)
    # 16 pixels wide with a half-width tangent of 0.5: f = 8 / 0.5.
    np.testing.assert_allclose(found.intrinsics.fx, 16)
    assert "lens distortion is left out" in texts(found, warnings=True)


def test_nerfstudio_names_without_ending(capture):
    change(
        capture,
        lambda content: [f.update(file_path=f["file_path"][:-4]) for f in content["frames"]],
    )
    (found,) = read_walks(NERFSTUDIO, capture)
    assert next(iter(found.images)) == capture / "images/0.jpg"


def test_nerfstudio_broken_intrinsics(capture):
    change(capture, lambda content: content.update(fl_x="wide"))
    with pytest.raises(FormatError, match=r"transforms.json:1: expected intrinsics as a list of"):
        read_walks(NERFSTUDIO, capture)


def test_marvin_a_row_without_a_pose_costs_its_image_the_label(tmp_path):
    church = make_marvin(tmp_path / "Church")
    for name in ("train.txt", "ARKit.txt"):
        lines = (church / name).read_text().splitlines()
        image = lines[4 if name == "train.txt" else 6].split()[0]
        row = next(k for k, line in enumerate(lines) if line.startswith(image))
        lines[row] = " ".join([image, *["nan"] * 7])
        (church / name).write_text("\n".join(lines) + "\n")
    train, _ = read_walks(MARVIN, church)
    assert len(train) == COUNT
    assert "19 with tracker's pose, 19 with ground truth" in texts(train, warnings=False)
    assert texts(train, warnings=True).count("1 row has no pose") == 2
