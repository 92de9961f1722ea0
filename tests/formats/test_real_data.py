"""Real files of every kind, against facts known of them."""

import csv
import gzip

import numpy as np
import pytest

from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.registry import rank_formats, read_trajectory, read_with_notes
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import align_umeyama
from vioapr.trajectory import Trajectory, associate

# Labels that are broken at their source: a position of 3e9 m, quaternions that are not unit.
BROKEN = {
    "GreatCourt_train.csv.gz": (298, "expected positions within"),
    "Street_test.csv.gz": (951, "expected a unit quaternion"),
    "Street_train.csv.gz": (7, "expected a unit quaternion"),
}


def read_all(files, expected_format):
    files = sorted(files)
    assert files
    for file in files:
        best, confidence = rank_formats(file)[0]
        assert (best.name, confidence > 0.5) == (expected_format, True), file
        reading = read_with_notes(file)
        assert len(reading.trajectory) > 10, file
        lines = [row.line for row in reading.left_out]
        if file.name in BROKEN:
            line, problem = BROKEN[file.name]
            with pytest.raises(FormatError, match=f"{file.name}:{line}: {problem}"):
                read_trajectory(file, options=ReadOptions(strict=True))
            assert min(lines) == line
            assert len(lines) < 0.01 * len(reading.trajectory)
        else:
            assert lines == [], file


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pattern", "expected_format"),
    [
        ("bench/*/*/*.tum", "tum"),
        ("euroc_vio/*.tum.gz", "tum"),
        ("advio/tum10hz/*.tum.gz", "tum"),
        ("advio/raw_decimated/*_ark*.csv.gz", "advio-vio"),
        ("advio/raw_decimated/*_arc*.csv.gz", "advio-vio"),
        ("advio/raw_decimated/*_gt_pose.csv.gz", "advio-gt"),
        ("hrapr_apr_predictions/*/*.txt.gz", "hrapr"),
        ("cambridge_labels/*.csv.gz", "mstransformer"),
        ("sevenscenes_poses/pgt_*/*.txt.gz", "hloc"),
        ("sevenscenes_poses/estimates_*/*_as.txt.gz", "hloc"),
        ("sevenscenes_poses/estimates_*/*_hloc.txt.gz", "hloc"),
        ("sevenscenes_poses/estimates_*/*_dsac_rgb.txt.gz", "ace"),
        ("sevenscenes_poses/dso_vo/*.txt.gz", "kitti"),
        ("aria_mps_sample/*.csv", "aria"),
    ],
)
def test_every_file_is_recognized_and_read(pattern, expected_format, data_dir):
    read_all(data_dir.glob(pattern), expected_format)


def compare(left: Trajectory, right: Trajectory, *, align=False):
    """Distances (m) and angles (deg) of common frames, after a rigid alignment if asked for."""
    pairs = associate(left, right)
    assert len(pairs) > 50
    ours = left.at_rows(pairs.left_rows).target_from_source
    theirs = right.at_rows(pairs.right_rows).target_from_source
    if align:
        ours = align_umeyama(ours.translation_m, theirs.translation_m).apply_to(ours)
    return rigid.distance_m(ours, theirs), rigid.angle_deg(ours, theirs)


@pytest.mark.parametrize("scene", ["KingsCollege", "ShopFacade"])
def test_hrapr_labels_are_the_cambridge_labels(scene, data_dir):
    """Two formats, two directions, two axis conventions; one rigid transform between them."""
    labels = data_dir / "cambridge_labels" / f"{scene}_test.csv.gz"
    official = read_trajectory(labels)
    hrapr = read_trajectory(data_dir / f"hrapr_apr_predictions/Cambridge/{scene}_test_gt.txt.gz")
    names = tuple(name.removeprefix(f"{scene}/") for name in official.names)
    official = Trajectory.from_arrays(
        official.timestamp_s,
        official.position_m,
        official.quat_xyzw,
        names,
        is_timed=False,
    )
    assert set(names) == set(hrapr.names)
    distance, angle = compare(official, hrapr, align=True)
    assert distance.max() < 5e-4
    assert angle.max() < 0.05
    assert np.median(angle) < 0.001


@pytest.mark.parametrize("scene", ["chess", "fire", "office", "pumpkin"])
def test_hrapr_labels_are_the_colmap_pseudo_labels(scene, data_dir):
    colmap = read_trajectory(data_dir / f"sevenscenes_poses/pgt_sfm_7scenes/{scene}_test.txt.gz")
    hrapr = read_trajectory(data_dir / f"hrapr_apr_predictions/7Scenes/{scene}_test_gt.txt.gz")
    assert colmap.names == hrapr.names
    distance, angle = compare(colmap, hrapr, align=True)
    assert distance.max() < 5e-6
    assert angle.max() < 0.001


@pytest.mark.parametrize(
    ("group", "scene", "model", "metres", "degrees"),
    [
        ("Cambridge", "KingsCollege", "PoseNet", 0.93, 2.72),
        ("Cambridge", "ShopFacade", "DFNet", 0.67, 2.20),
        ("7Scenes", "chess", "MS-Transformer", 0.107, 6.44),
        ("7Scenes", "fire", "DFNet", 0.058, 2.30),
    ],
)
def test_published_medians_of_regressors(group, scene, model, metres, degrees, data_dir):
    folder = data_dir / "hrapr_apr_predictions" / group
    predicted = read_trajectory(folder / f"{scene}_{model}_predict.txt.gz")
    truth = read_trajectory(folder / f"{scene}_test_gt.txt.gz")
    distance, angle = compare(predicted, truth)
    assert np.median(distance) == pytest.approx(metres, abs=0.006)
    assert np.median(angle) == pytest.approx(degrees, abs=0.006)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["chess", "fire", "office", "pumpkin"])
@pytest.mark.parametrize("method", ["hloc", "as", "dsac_rgb"])
def test_structure_based_estimates_are_within_millimetres(scene, method, data_dir):
    folder = data_dir / "sevenscenes_poses"
    labels = read_trajectory(folder / f"pgt_sfm_7scenes/{scene}_test.txt.gz")
    estimates = read_trajectory(folder / f"estimates_sfm_7scenes/{scene}_{method}.txt.gz")
    distance, angle = compare(estimates, labels)
    assert 0.003 < np.median(distance) < 0.03
    assert np.median(angle) < 1


def test_monocular_odometry_follows_the_labels_up_to_scale(data_dir):
    """DSO numbers its frames at 30 Hz and has missed the first."""
    options = ReadOptions(rate_hz=30)
    odometry = read_trajectory(
        data_dir / "sevenscenes_poses/dso_vo/chess_seq-01.txt.gz", "kitti", options
    )
    labels = read_trajectory(
        data_dir / "sevenscenes_poses/pgt_sfm_7scenes/chess_train.txt.gz",
        "hloc",
        ReadOptions(rate_hz=30, sequence="seq-01"),
    )
    assert odometry.timestamp_s[0] > 0
    pairs = associate(odometry, labels)
    ours = odometry.at_rows(pairs.left_rows).position_m
    theirs = labels.at_rows(pairs.right_rows).position_m
    aligned = align_umeyama(ours, theirs, with_scale=True).apply(ours)
    assert np.sqrt(((aligned - theirs) ** 2).sum(axis=1).mean()) < 0.3


def step(poses: Rigid3) -> Rigid3:
    return poses.at(slice(None, -10)).inverse() @ poses.at(slice(10, None))


def read_advio_pair(data_dir, number, raw, fixed):
    """A raw file as we read it, at the times of the one that was fixed by hand."""
    ours = read_trajectory(data_dir / f"advio/raw_decimated/advio-{number}_{raw}.csv.gz")
    theirs = read_trajectory(data_dir / f"advio/tum10hz/advio-{number}_{fixed}.tum.gz")
    inside = (theirs.timestamp_s > ours.timestamp_s[0]) & (
        theirs.timestamp_s < ours.timestamp_s[-1]
    )
    theirs = theirs.at_rows(np.flatnonzero(inside))
    return ours.interpolate(theirs.timestamp_s), theirs


def with_cam_axes(arcam: Trajectory):
    """Rotations of a file that keeps ARKit's camera axes, with OpenCV's."""
    return quaternion.multiply(arcam.quat_xyzw, np.array([1.0, 0, 0, 0]))


@pytest.mark.parametrize(("raw", "fixed"), [("arkit", "arkit"), ("gt_pose", "gt")])
@pytest.mark.parametrize("number", ["03", "18"])
def test_advio_distances_and_relative_angles_are_right(raw, fixed, number, data_dir):
    ours, theirs = read_advio_pair(data_dir, number, raw, fixed)
    left, right = step(ours.target_from_source), step(theirs.target_from_source)
    lengths = [np.linalg.norm(poses.translation_m, axis=1) for poses in (left, right)]
    angles = [np.degrees(quaternion.angle_rad(poses.quat_xyzw)) for poses in (left, right)]
    assert np.median(np.abs(lengths[0] - lengths[1])) < 0.005
    assert np.median(np.abs(angles[0] - angles[1])) < 0.2
    # A rotation relates the positions, not a mirror image.
    aligned = align_umeyama(ours.position_m, theirs.position_m).apply(ours.position_m)
    assert np.median(np.linalg.norm(aligned - theirs.position_m, axis=1)) < 0.01


@pytest.mark.parametrize("number", ["03", "18"])
def test_advio_needs_only_its_unknown_turn(number, data_dir):
    """With the measured angle of the sequence, orientations are right too."""
    with (data_dir / "advio/quality_arkit_vs_gt.csv").open() as file:
        (phi,) = [
            float(row["phi"]) for row in csv.DictReader(file) if int(row["seq"]) == int(number)
        ]
    turn = quaternion.from_rotvec(np.array([0, 0, -np.radians(phi)]))
    ours, theirs = read_advio_pair(data_dir, number, "arkit", "arkit")
    turned = quaternion.multiply(turn, ours.quat_xyzw)
    assert np.median(quaternion.angle_between_deg(turned, with_cam_axes(theirs))) < 0.5
    # Of the ground truth, the turn is on both sides: about the file's up and the device's z.
    ours, theirs = read_advio_pair(data_dir, number, "gt_pose", "gt")
    about_up = quaternion.from_rotvec(np.array([0, -np.radians(phi), 0]))
    about_view = quaternion.from_rotvec(np.array([0, 0, -np.radians(phi)]))
    turned = quaternion.multiply(quaternion.multiply(about_up, ours.quat_xyzw), about_view)
    assert np.median(quaternion.angle_between_deg(turned, with_cam_axes(theirs))) < 0.5


def test_aria_open_and_closed_loop_agree(data_dir):
    folder = data_dir / "aria_mps_sample"
    loops = [read_trajectory(folder / f"{kind}_loop_50hz.csv") for kind in ("open", "closed")]
    assert [loop.target for loop in loops] == ["odometry", "world"]
    assert loops[0].source == "device"
    distance, _ = compare(*loops, align=True)
    assert np.sqrt((distance**2).mean()) < 0.01


def test_gzip_makes_no_difference(data_dir, tmp_path):
    packed = data_dir / "cambridge_labels/ShopFacade_test.csv.gz"
    unpacked = tmp_path / "ShopFacade_test.csv"
    unpacked.write_bytes(gzip.decompress(packed.read_bytes()))
    left, right = read_trajectory(packed), read_trajectory(unpacked)
    np.testing.assert_array_equal(left.position_m, right.position_m)
    assert left.names == right.names
