"""Calibrations of all common forms give the same body_from_cam."""

import json

import numpy as np
import pytest

from vioapr.errors import AssociationError, FileMissingError, FormatError
from vioapr.formats.body_from_cam import estimate_body_from_cam, read_body_from_cam
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import WalkParams, simulate_walk

EXPECTED = Rigid3(
    np.array([-0.0216, -0.0647, 0.0098]),
    quaternion.from_rotvec(np.array([-0.02, 0.025, 1.556])),
)
MATRIX = EXPECTED.to_matrix()
INVERSE = EXPECTED.inverse().to_matrix()


def flat(matrix):
    return ", ".join(f"{value:.12g}" for value in np.ravel(matrix))


def nested(matrix):
    return json.dumps(np.asarray(matrix).tolist())


def rows(matrix):
    return "".join(f"  - [{flat(row)}]\n" for row in matrix)


FILES = {
    "numbers.txt": "# body_from_cam\n" + "\n".join(flat(r).replace(",", "") for r in MATRIX),
    "3x4.csv": "\n".join(flat(row) for row in MATRIX[:3]),
    "euroc/sensor.yaml": "#Sensor extrinsics wrt. the body-frame.\nsensor_type: camera\nT_BS:\n"
    f"  cols: 4\n  rows: 4\n  data: [{flat(MATRIX)}]\n\nrate_hz: 20\nresolution: [752, 480]\n",
    "kalibr-camchain.yaml": "cam0:\n  T_cam_imu:\n" + rows(INVERSE) + "  camera_model: pinhole\n"
    "  intrinsics: [458.6, 457.3, 367.2, 248.4]\ncam1:\n  T_cam_imu:\n" + rows(np.eye(4)),
    "openvins.yaml": "%YAML:1.0\ncam0:\n  T_imu_cam: #rotation from camera to IMU R_CtoI\n"
    + rows(MATRIX).replace("  - ", "    - ") + "  cam_overlaps: [1]\n",
    "vins.yaml": "%YAML:1.0\nbody_T_cam0: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n"
    f"   data: [{flat(MATRIX[0])},\n          {flat(MATRIX[1:])}]\n",
    "orbslam3.yaml": "Camera.fps: 20\nIMU.T_b_c1: !!opencv-matrix\n   rows: 4\n   cols: 4\n"
    f"   dt: f\n   data: [{flat(MATRIX)}]\nIMU.InsertKFsWhenLost: 0\n",
    "basalt.json": json.dumps(
        {
            "value0": {
                "T_imu_cam": [
                    dict(
                        zip(
                            ("px", "py", "pz", "qx", "qy", "qz", "qw"),
                            [*EXPECTED.translation_m.tolist(), *EXPECTED.quat_xyzw.tolist()],
                            strict=True,
                        )
                    ),
                    {"px": 1, "py": 0, "pz": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1},
                ],
                "intrinsics": [],
            }
        },
        indent=2,
    ),
    "ours.toml": f"body_from_cam = {nested(MATRIX)}\n",
    "ours.json": json.dumps({"body_from_cam": MATRIX.tolist()}),
    "inverse.json": json.dumps({"cam_from_body": INVERSE.tolist()}),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_calibration_is_read(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(FILES[name])
    found = read_body_from_cam(path)
    np.testing.assert_allclose(found.translation_m, EXPECTED.translation_m, atol=1e-6)
    assert rigid.angle_deg(found, EXPECTED) < 1e-4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fx: 600\nfy: 600\n", "expected the transform body_from_cam: 4x4 numbers, or a matrix"),
        ("T_BS:\n  data: [1, 0, 0, 0]\n", "T_BS: expected 16 numbers .* got 4"),
        (f"body_from_cam = {nested(2 * MATRIX)}", "body_from_cam: expected a rotation"),
        (f"body_from_cam = {nested(MATRIX * [1, 1, -1, 1])}", "expected a rotation"),
        (
            '{"T_imu_cam": {"px":0,"py":0,"pz":0,"qx":0,"qy":0,"qz":0,"qw":2}}',
            "T_imu_cam: expected a unit quaternion",
        ),
        ("", "expected the transform"),
        (
            f"T_BS:\n  data: [{flat(MATRIX.T)}]\n",
            r"T_BS: expected 0 0 0 1 as the last row of a matrix, got -0.0216 -0.0647 0.0098 1: "
            "written column by column. Write it row by row",
        ),
        (flat(INVERSE.T), "the matrix: expected 0 0 0 1 as the last row"),
        (f"T_cam_imu: {nested(INVERSE.T)}", "T_cam_imu: expected 0 0 0 1 as the last row"),
        (flat(np.vstack([MATRIX[:3], [0, 0, 0, 0]])), "last row of a matrix, got 0 0 0 0$"),
    ],
)
def test_other_files_are_refused(text, message, tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        read_body_from_cam(path)


def test_a_missing_file(tmp_path):
    with pytest.raises(FileMissingError):
        read_body_from_cam(tmp_path / "none.yaml")


@pytest.mark.parametrize("seed", range(3))
def test_it_is_estimated_by_motion(seed):
    walk = simulate_walk(WalkParams(duration_s=120, rate_hz=5), seed)
    body = walk.vio.with_transforms(walk.vio.target_from_source @ EXPECTED.inverse())
    by_gt = estimate_body_from_cam(body, walk.gt)
    assert rigid.angle_deg(by_gt.body_from_cam, EXPECTED) < 0.5
    off_m = np.abs(by_gt.body_from_cam.translation_m - EXPECTED.translation_m)
    assert (off_m < np.maximum(4 * by_gt.arm_sigma_m, 0.02)).all()
    by_apr = estimate_body_from_cam(body, walk.apr)
    angle_deg = rigid.angle_deg(by_apr.body_from_cam, EXPECTED)
    assert angle_deg < 3 * np.rad2deg(by_apr.rotation_sigma_rad) < 12


def test_a_camera_is_left_as_it_is():
    walk = simulate_walk(WalkParams(duration_s=120, rate_hz=5), seed=1)
    found = estimate_body_from_cam(walk.vio, walk.apr)
    np.testing.assert_array_equal(found.body_from_cam.quat_xyzw, [0, 0, 0, 1])
    np.testing.assert_array_equal(found.body_from_cam.translation_m, 0)


def test_tracks_of_two_walks_are_refused():
    walks = [simulate_walk(WalkParams(duration_s=120, rate_hz=5), seed) for seed in (1, 50)]
    with pytest.raises(AssociationError, match="no constant rotation|does not tell"):
        estimate_body_from_cam(walks[0].vio, walks[1].gt)
