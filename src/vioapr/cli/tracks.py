"""Tracks that verbs are given: read with what readers say, turned to the camera, checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vioapr.cli.console import say, warn
from vioapr.errors import FormatError
from vioapr.formats.base import ReadOptions
from vioapr.formats.body_from_cam import estimate_body_from_cam, read_body_from_cam, to_camera
from vioapr.formats.pair_checks import describe_rotation
from vioapr.formats.registry import read_with_notes
from vioapr.geometry import quaternion
from vioapr.trajectory import Trajectory

AUTO = "auto"


def read_track(
    path: Path, format_name: str | None, options: ReadOptions, parameter: str
) -> Trajectory:
    """Read a track, and say on standard error what its reader warns of.

    Args:
        path: The file.
        format_name: Its format, if known.
        options: Unit of time, strictness.
        parameter: The verb's, with which a user can choose the format.

    Raises:
        VioAprError: It cannot be read.
    """
    reading = read_with_notes(path, format_name, options, parameter=parameter)
    for note in reading.notes:
        if note.is_warning:
            if options.strict:
                raise FormatError(path, note.text)
            warn(f"{path}: {note.text}")
    return reading.trajectory


def turn_to_camera(
    vio: Trajectory, name: str, vio_from_cam: str, camera: Trajectory, tolerance_s: float
) -> Trajectory:
    """Make a tracker's poses those of the camera, and say by which transform.

    Args:
        vio: vio_from_body.
        name: For people.
        vio_from_cam: "auto", or a file with body_from_cam.
        camera: world_from_cam of the same walk, to estimate it by.
        tolerance_s: Largest difference of paired timestamps, s.

    Raises:
        VioAprError: The file cannot be read, or the motion does not tell.
    """
    if vio_from_cam != AUTO:
        return to_camera(vio, read_body_from_cam(Path(vio_from_cam)))
    found = estimate_body_from_cam(vio, camera, tolerance_s)
    body_from_cam = found.body_from_cam
    if not quaternion.angle_rad(body_from_cam.quat_xyzw) > 0:
        say(f"{name}: the tracker's poses are the camera's already, nothing to turn")
        return vio
    arm = ", ".join(f"{each:.3f}" for each in body_from_cam.translation_m)
    sigma = ", ".join(f"{each:.3f}" for each in found.arm_sigma_m)
    lever = f"lever arm ({arm}) ± ({sigma}) m"
    lever = lever if found.knows_arm else "lever arm not observable, taken as zero"
    sigma_deg = np.rad2deg(found.rotation_sigma_rad)
    say(f"{name}: body_from_cam {describe_rotation(body_from_cam)}, ± {sigma_deg:.1f} deg; {lever}")
    return to_camera(vio, body_from_cam)
