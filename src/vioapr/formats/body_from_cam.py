"""The constant transform body_from_cam of a device: read from a calibration, or estimated.

A tracker such as VINS, OpenVINS, Basalt, Kimera or ORB-SLAM3 with an IMU, and EuRoC's and Aria's
files, give poses of the IMU's body. With body_from_cam they become poses of the camera:
vio_from_cam = vio_from_body @ body_from_cam.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError, FormatError, ParameterError
from vioapr.files.text import read_text
from vioapr.formats.common_motion import find_common_frames
from vioapr.formats.matrix_order import are_transposed, explain_last_row, explain_transposed
from vioapr.formats.pair_checks import describe_rotation
from vioapr.formats.readings import HAND_EYE_TITLE, OPENGL, compare_readings
from vioapr.geometry import quaternion
from vioapr.geometry.hand_eye import HandEye
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory

AUTO = "auto"
"""Instead of a file: estimate it by the motion."""

BODY_FROM_CAM_KEYS = (
    "body_from_cam",  # ours
    "T_BS",  # EuRoC's sensor.yaml
    "T_imu_cam",  # OpenVINS, Basalt
    "body_T_cam0",  # VINS-Fusion
    "T_b_c1",  # ORB-SLAM3
    "Tbc",  # ORB-SLAM3
)
CAM_FROM_BODY_KEYS = ("cam_from_body", "T_cam_imu")  # ours, Kalibr's camchain
_QUATERNION_PARTS = ("px", "py", "pz", "qx", "qy", "qz", "qw")

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_ORTHONORMAL = 0.01
_LEAST_DEG, _SIGMAS = 2.0, 4.0


def read_body_from_cam(path: Path) -> Rigid3:
    """Read the transform from a calibration file; of several cameras, the first one's.

    It is one of: a text of 4x4 (or 3x4) numbers; a YAML, JSON or TOML with a matrix of that size
    under one of `BODY_FROM_CAM_KEYS` or, as in Kalibr's camchain, `CAM_FROM_BODY_KEYS`; or
    Basalt's JSON with T_imu_cam as px, py, pz, qx, qy, qz, qw.

    Returns:
        body_from_cam, shape ().

    Raises:
        FileMissingError: It is missing.
        UnreadableError: It cannot be read.
        FormatError: It holds no such transform, or its matrix is no rotation.
    """
    text = re.sub(r"#.*|%YAML.*", "", read_text(path))
    for keys, is_inverse in ((BODY_FROM_CAM_KEYS, False), (CAM_FROM_BODY_KEYS, True)):
        for key in keys:
            match = re.search(rf"(?<!\w){re.escape(key)}[\"']?\s*[:=]", text)
            if match:
                found = _transform_after(path, key, text[match.end() :])
                return found.inverse() if is_inverse else found
    words = text.replace(",", " ").split()
    if len(words) not in (12, 16) or not all(re.fullmatch(_NUMBER, word) for word in words):
        keys = ", ".join((*BODY_FROM_CAM_KEYS, *CAM_FROM_BODY_KEYS))
        raise FormatError(
            path, f"expected the transform body_from_cam: 4x4 numbers, or a matrix under {keys}"
        )
    return _to_transform(path, "the matrix", np.array([float(word) for word in words]))


def _transform_after(path: Path, key: str, text: str) -> Rigid3:
    """The transform whose numbers follow a key."""
    parts = {
        name: re.search(rf"[\"']?{name}[\"']?\s*[:=]\s*({_NUMBER})", text[:1000])
        for name in _QUATERNION_PARTS
    }
    bracket = text.find("[")
    if all(parts.values()) and not re.search(r"data|rows", text[:200]):
        values = np.array([float(match[1]) for match in parts.values() if match])
        norm = float(np.linalg.norm(values[3:]))
        if abs(norm - 1) > _ORTHONORMAL:
            raise FormatError(path, f"{key}: expected a unit quaternion, got one of norm {norm:g}")
        return Rigid3(values[:3], values[3:] / norm)
    # EuRoC and OpenCV write rows, cols and then data: [...]; others nest lists, or list rows.
    data = re.search(r"data[\"']?\s*[:=]\s*\[", text[:300])
    body = text[data.end() :] if data else text[max(bracket, 0) :]
    run = re.match(rf"(?:[\s\[\],-]|{_NUMBER})*", body)
    numbers = re.findall(_NUMBER, run[0] if run else "")[:16]
    return _to_transform(path, key, np.array([float(number) for number in numbers]))


def _to_transform(path: Path, key: str, values: NDArray[np.float64]) -> Rigid3:
    """A transform of 12 or 16 numbers by rows."""
    if len(values) not in (12, 16):
        raise FormatError(path, f"{key}: expected 16 numbers (4x4 by rows), got {len(values)}")
    matrix = values.reshape(-1, 4)
    if len(matrix) == 4 and are_transposed(matrix[None])[0]:
        raise FormatError(path, f"{key}: {explain_transposed(matrix)} Write it row by row")
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off > _ORTHONORMAL or np.linalg.det(rotation) < 0:
        raise FormatError(path, f"{key}: expected a rotation, got a matrix that is none")
    if len(matrix) == 4 and (explained := explain_last_row(matrix)):
        raise FormatError(path, f"{key}: {explained}")
    return Rigid3(matrix[:3, 3].copy(), quaternion.from_matrix(rotation))


def estimate_body_from_cam(
    vio: Trajectory, cam_track: Trajectory, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> HandEye:
    """Estimate the transform by the motion that a tracker's body and a camera share.

    Args:
        vio: vio_from_body.
        cam_track: world_from_cam of the same walk: predictions, or ground truth.
        tolerance_s: Largest difference of paired timestamps, s.

    Returns:
        The identity where the two devices agree within what is known; without a lever arm where
        the motion tells nothing of it.

    Raises:
        AssociationError: Too few common frames, or too little motion to determine it, or none
            that explains the motion.
    """
    compared = compare_readings(find_common_frames(vio, cam_track, tolerance_s))
    found = compared.hand_eye
    if found is None:
        raise AssociationError(
            "vio_from_cam: the motion does not tell the rotation between the tracker's body and "
            "the camera (too little motion, or two walks?): give a file with body_from_cam"
        )
    titles = (HAND_EYE_TITLE, OPENGL.title)  # nearly OpenGL's axes are compared as these
    fit = next(fit for title in titles for fit in compared.fits if fit.title == title)
    if not compared.explains(fit):
        raise AssociationError(
            "vio_from_cam: no constant rotation between the tracker's body and the camera explains "
            f"their motion (rotations still differ by {fit.rotation_deg:.0f} deg): are both of one "
            "walk and one clock?"
        )
    angle_deg = float(np.rad2deg(quaternion.angle_rad(found.body_from_cam.quat_xyzw)))
    sigma_deg = float(np.rad2deg(found.rotation_sigma_rad))
    if angle_deg < max(_LEAST_DEG, _SIGMAS * sigma_deg):
        return found._replace(body_from_cam=Rigid3.identity())
    # What the motion does not tell of the lever arm is drawn to zero already.
    arm = found.body_from_cam.translation_m * found.knows_arm
    return found._replace(body_from_cam=found.body_from_cam._replace(translation_m=arm))


def to_camera(vio: Trajectory, body_from_cam: Rigid3) -> Trajectory:
    """Make poses of a tracker's body those of its camera."""
    moved = vio.with_transforms(vio.target_from_source @ body_from_cam)
    return Trajectory(
        moved.timestamp_s,
        moved.position_m,
        moved.quat_xyzw,
        moved.names,
        moved.is_timed,
        moved.target,
        "cam",
    )


def turn_to_camera(
    vio: Trajectory,
    vio_from_cam: str | Rigid3,
    camera: Trajectory | None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> tuple[Trajectory, str]:
    """Make a tracker's poses those of the camera, and say by which transform.

    Args:
        vio: vio_from_body.
        vio_from_cam: "auto"; or body_from_cam, or a file that holds it, see `read_body_from_cam`.
        camera: world_from_cam of the same walk, to estimate it by; None where there is none.
        tolerance_s: Largest difference of paired timestamps, s.

    Returns:
        vio_from_cam, and the transform in words.

    Raises:
        FileError: The file cannot be read, or holds no transform.
        ParameterError: It is to be estimated, and there is nothing to estimate it by.
        AssociationError: The motion does not tell.
    """
    if isinstance(vio_from_cam, Rigid3) or vio_from_cam != AUTO:
        is_known = isinstance(vio_from_cam, Rigid3)
        body_from_cam = vio_from_cam if is_known else read_body_from_cam(Path(vio_from_cam))
        return to_camera(vio, body_from_cam), describe_transform(body_from_cam)
    if camera is None:
        raise ParameterError(
            "vio_from_cam: auto needs another track of the walk's camera: give a file instead"
        )
    found = estimate_body_from_cam(vio, camera, tolerance_s)
    return to_camera(vio, found.body_from_cam), describe_mount(found)


def describe_transform(body_from_cam: Rigid3) -> str:
    """Say a transform that is given: rotation and lever arm."""
    arm = ", ".join(f"{each:.3f}" for each in body_from_cam.translation_m.tolist())
    return f"body_from_cam {describe_rotation(body_from_cam)}; lever arm ({arm}) m"


def describe_mount(found: HandEye) -> str:
    """Say an estimated transform: rotation and lever arm, and how sure they are."""
    body_from_cam = found.body_from_cam
    if not quaternion.angle_rad(body_from_cam.quat_xyzw) > 0:
        return "the poses are the camera's already, nothing to turn"
    arm, sigma = (
        ", ".join(f"{each:.3f}" for each in values.tolist())
        for values in (body_from_cam.translation_m, found.arm_sigma_m)
    )
    lever = f"lever arm ({arm}) ± ({sigma}) m"
    lever = lever if found.knows_arm else "lever arm not observable, taken as zero"
    sigma_deg = float(np.rad2deg(found.rotation_sigma_rad))
    return f"body_from_cam {describe_rotation(body_from_cam)}, ± {sigma_deg:.1f} deg; {lever}"
