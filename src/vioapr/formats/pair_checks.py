"""What looks wrong with two tracks of one walk, each found by the other.

A regressor's predictions and a tracker's poses are of one walk, so they must agree on its motion.
Where they do not, a file is in another convention, unit, clock or role than was taken for granted,
and fusing the two gives wrong poses without an error. Every warning is one sentence with a remedy.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vioapr.errors import AssociationError
from vioapr.formats.anomalies import check_motion
from vioapr.formats.common_motion import CommonFrames, estimate_scale, find_common_frames
from vioapr.formats.readings import (
    HAND_EYE_TITLE,
    READINGS,
    Comparison,
    compare_readings,
    median_direction_deg,
)
from vioapr.formats.track_roles import are_same, are_swapped, jitter_m, spread_m
from vioapr.formats.track_warnings import TrackWarning
from vioapr.geometry import quaternion
from vioapr.geometry.hand_eye import HandEye
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.inspection import Fit
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, nearest_rows
from vioapr.trajectory.clock_offset import find_clock_offset

Role = Literal["apr", "vio", "gt"]
UNNAMED = "the other track"
"""The path of a track whose file is not known."""
_LEAST_STEP_S = 0.002
_UNITS_S = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT_NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_LENGTH_UNITS = {1000.0: "millimetres", 100.0: "centimetres", 3.28: "feet", 39.4: "inches"}
_LEAST_SCALE, _TRUSTED_SCALE, _SCALE_SIGMAS = 1.5, 1.25, 3.0
_CLEARLY_BETTER_SUSPECT = 0.8
_FITTING_DIRECTION_DEG = 30.0
_NO_FIT_TURNS, _NO_FIT_DIRECTION_DEG, _LEAST_TURN_DEG, _LEAST_PAIRS = 0.7, 45.0, 20.0, 5


@dataclass(frozen=True, eq=False)
class Track:
    """One of the two tracks.

    Attributes:
        path: The file, as the user named it.
        role: What it was given as.
        poses: The track.
    """

    path: str
    role: Role
    poses: Trajectory

    @property
    def name(self) -> str:
        """For people: the last part of the path."""
        return self.path.rstrip("/").rsplit("/", 1)[-1]

    def conversion(self, flags: str) -> str:
        """The remedy that is a conversion of the file, with some flags of `vioapr convert`."""
        source = "FILE" if self.path == UNNAMED else shlex.quote(self.path)
        # A TUM file needs times; a table does with image names.
        target = "fixed.tum" if self.poses.is_timed else "fixed.csv"
        return f"convert it with `vioapr convert {source} {target} {flags}`"


@dataclass(frozen=True, eq=False)
class PairReport:
    """What was found of two tracks.

    Attributes:
        warnings: Possibly none.
        comparison: The readings of the suspect, compared with the reference on one clock; None
            where the two have too little in common.
    """

    warnings: tuple[TrackWarning, ...]
    comparison: Comparison | None = None


def check_pair(
    reference: Track,
    suspect: Track,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
    *,
    is_reference_known: bool = False,
) -> PairReport:
    """Find what looks wrong with two tracks of one walk.

    Args:
        reference: A regressor's predictions or ground truth, world_from_cam.
        suspect: A tracker's poses, in a world of its own; beside ground truth, or predictions.
            Where either file may be the wrong one, it is named.
        tolerance_s: Largest difference of paired timestamps, s.
        is_reference_known: Whether the reference is right for sure.
    """
    is_timed = reference.poses.is_timed and suspect.poses.is_timed
    if is_timed and (warning := _find_time_unit(reference, suspect)):
        return PairReport((warning,))
    found: list[TrackWarning] = []
    if is_timed and (shift_s := find_clock_shift_s(reference.poses, suspect.poses)):
        found.append(_warn_of_clock(reference, suspect, shift_s))
        suspect = replace(suspect, poses=shift_clock(suspect.poses, shift_s))
    try:
        common = find_common_frames(suspect.poses, reference.poses, tolerance_s)
    except AssociationError:
        return PairReport(tuple(found))  # pairing the frames says what is wrong
    comparison = compare_readings(common)
    found += check_sources(reference, suspect, common)
    if any(warning.kind == "same" for warning in found):
        return PairReport(tuple(found), comparison)
    # Where the suspect fits as it is, so does the reference: the residuals are the same.
    is_known = is_reference_known or comparison.as_read_fits
    other = None if is_known else compare_readings(common.swapped())
    warning, common = _check_convention(reference, suspect, common, comparison, other)
    found += [warning] if warning else []
    if warning is None or warning.kind != "no-fit":
        found += _check_scale(reference, suspect, common, is_reference_known=is_reference_known)
    return PairReport(tuple(found), comparison)


def check_sources(reference: Track, suspect: Track, common: CommonFrames) -> list[TrackWarning]:
    """Find out whether two tracks are one, or given in each other's place.

    Args:
        reference: See `check_pair`.
        suspect: See `check_pair`.
        common: Their frames, the suspect's left.
    """
    if are_same(common):
        return [_warn_of_same(reference, suspect)]
    if (reference.role, suspect.role) == ("apr", "vio") and are_swapped(common.swapped()):
        return [_warn_of_roles(reference, suspect)]
    return []


def find_clock_shift_s(reference: Trajectory, suspect: Trajectory) -> float | None:
    """Find what to add to a track's timestamps for its clock to be another track's.

    Where both have frames of the same images, the shift is such that these meet.
    """
    offset = find_clock_offset(reference, suspect)
    if offset is None:
        return None
    shifted = suspect.timestamp_s - offset.offset_s
    inside = (shifted >= reference.timestamp_s[0]) & (shifted <= reference.timestamp_s[-1])
    if not inside.any():
        return -offset.offset_s
    nearest = reference.timestamp_s[nearest_rows(shifted[inside], reference.timestamp_s)]
    rest_s = float(np.median(nearest - shifted[inside]))
    is_within = abs(rest_s) <= max(5 * offset.sigma_s, 0.05)
    return -offset.offset_s + (rest_s if is_within else 0.0)


def shift_clock(trajectory: Trajectory, shift_s: float) -> Trajectory:
    """Add to the timestamps of a track."""
    return replace(trajectory, timestamp_s=trajectory.timestamp_s + shift_s)


def _find_time_unit(reference: Track, suspect: Track) -> TrackWarning | None:
    """Timestamps of one track that are the other's, times a thousand or more."""
    for one, other in ((suspect, reference), (reference, suspect)):
        times, wanted = one.poses.timestamp_s, other.poses.timestamp_s
        duration_s = float(wanted[-1] - wanted[0])
        for unit, seconds in _UNITS_S.items():
            scaled = times[[0, -1]] * seconds
            is_near = np.abs(scaled - wanted[[0, -1]]) <= 0.5 * max(duration_s, 1.0)
            # Clocks of seconds may be that far apart too, but not walks that much longer.
            is_longer = times[-1] - times[0] > 30 * duration_s > 0
            if not (is_near.all() and is_longer):
                continue
            if float(np.median(np.diff(wanted))) < _LEAST_STEP_S:  # no tracker is so fast
                return TrackWarning(
                    "time-unit",
                    f"{other.name}: the timestamps fit {one.name} as seconds, and were taken for "
                    f"{_UNIT_NAMES[unit]}",
                    other.conversion("--time-unit s"),
                )
            return TrackWarning(
                "time-unit",
                f"{one.name}: the timestamps fit {other.name} as {_UNIT_NAMES[unit]}",
                one.conversion(f"--time-unit {unit}"),
            )
    return None


def _warn_of_clock(reference: Track, suspect: Track, shift_s: float) -> TrackWarning:
    direction = "behind" if shift_s > 0 else "ahead of"
    return TrackWarning(
        "clock",
        f"{suspect.name}: the clock is {abs(shift_s):.3g} s {direction} that of {reference.name} "
        "(by the turns of both)",
        suspect.conversion(f"--shift-s={shift_s:.3f}"),
    )


def _warn_of_same(reference: Track, suspect: Track) -> TrackWarning:
    roles = {"apr": "predictions", "vio": "the tracker's poses", "gt": "ground truth"}
    return TrackWarning(
        "same",
        f"{reference.name} and {suspect.name} hold the same poses",
        f"give {roles[reference.role]} and {roles[suspect.role]} of two sources",
    )


def _warn_of_roles(reference: Track, suspect: Track) -> TrackWarning:
    return TrackWarning(
        "swapped",
        f"{suspect.name} jumps about as predictions do, and {reference.name} moves smoothly as a "
        "tracker's poses do",
        f"exchange `{reference.role}` and `{suspect.role}`",
    )


def _check_convention(
    reference: Track,
    suspect: Track,
    common: CommonFrames,
    of_suspect: Comparison,
    of_reference: Comparison | None,
) -> tuple[TrackWarning | None, CommonFrames]:
    """Which file fits the other in another reading; and the frames read that way.

    Args:
        reference: See `check_pair`.
        suspect: See `check_pair`.
        common: Their frames, the suspect's left.
        of_suspect: Readings of the suspect.
        of_reference: Readings of the reference, if it may be wrong too.
    """
    first = of_suspect.better
    second = None if of_reference is None else of_reference.better
    is_reference, is_either = _find_wrong_one(first, second, common)
    if is_reference:
        assert of_reference is not None
        track, other, compared, fit = reference, suspect, of_reference, second
    else:
        track, other, compared, fit = suspect, reference, of_suspect, first
    if fit is None:
        return _warn_of_no_fit(reference, suspect, of_suspect), common
    part = common.right if is_reference else common.left
    poses = part.target_from_source
    now = compared.as_read
    if fit.title == HAND_EYE_TITLE:
        assert compared.hand_eye is not None
        poses = poses @ compared.hand_eye.body_from_cam
        warning = _warn_of_device(track, other, compared.hand_eye)
    else:
        reading = next(reading for reading in READINGS if reading.title == fit.title)
        poses = reading.change(poses)
        either = f"; or {other.name} does" if is_either else ""
        warning = TrackWarning(
            "convention",
            f"{track.name} fits {other.name} as {reading.title}, with rotations off by "
            f"{fit.rotation_deg:.1f} instead of {now.rotation_deg:.1f} deg and directions by "
            f"{fit.direction_deg:.0f} instead of {now.direction_deg:.0f} deg{either}",
            track.conversion(f"--reading {reading.name}"),
        )
    fixed = part.with_transforms(poses)
    return warning, replace(common, **{"right" if is_reference else "left": fixed})


def _find_wrong_one(
    first: Fit | None, second: Fit | None, common: CommonFrames
) -> tuple[bool, bool]:
    """Find whether it is the reference that is misread, and whether either may be.

    Args:
        first: The fit of the suspect's other reading, if one is better.
        second: That of the reference.
        common: Their frames, the suspect's left.
    """
    if first is None or second is None:
        return second is not None, False
    if HAND_EYE_TITLE in (first.title, second.title):
        return False, False
    if second.score_deg < _CLEARLY_BETTER_SUSPECT * first.score_deg:
        return True, False
    # The motion of each by itself may tell which of the two is wrong.
    is_sound = [check_motion(part) is None for part in (common.left, common.right)]
    return is_sound[0] and not is_sound[1], is_sound[0] == is_sound[1]


def _warn_of_device(track: Track, other: Track, hand_eye: HandEye) -> TrackWarning:
    rotation = describe_rotation(hand_eye.body_from_cam)
    remedy = (
        "give `vio_from_cam`, as auto or a file"
        if track.role == "vio"
        else "predictions, poses and ground truth must be of one camera, its image turned alike"
    )
    return TrackWarning(
        "device",
        f"{track.name} holds poses of a device turned by {rotation} to "
        f"the camera of {other.name} (an IMU's body, or turned images)",
        remedy,
    )


def describe_rotation(body_from_cam: Rigid3) -> str:
    """Say a rotation as an angle about an axis: "90.1 deg about (0.01, -0.02, 1.00)"."""
    rotvec = np.rad2deg(quaternion.to_rotvec(body_from_cam.quat_xyzw))
    angle_deg = float(np.linalg.norm(rotvec))
    axis = ", ".join(f"{each:.2f}" for each in rotvec / max(angle_deg, 1e-9))
    return f"{angle_deg:.1f} deg about ({axis})"


def _warn_of_no_fit(reference: Track, suspect: Track, compared: Comparison) -> TrackWarning | None:
    """Two tracks that have no more in common than two walks, in any reading."""
    now = compared.as_read
    is_off = now.rotation_deg > _NO_FIT_TURNS * compared.turn_deg
    is_off &= not now.direction_deg < _NO_FIT_DIRECTION_DEG
    turns = compared.turn_deg >= _LEAST_TURN_DEG and compared.turns >= _LEAST_PAIRS
    if not (is_off and turns) or any(compared.explains(fit) for fit in compared.fits):
        return None
    return TrackWarning(
        "no-fit",
        f"{suspect.name} and {reference.name} do not move alike in any reading of "
        f"their conventions (rotations differ by {compared.as_read.rotation_deg:.0f} deg)",
        "give files of one walk and one clock",
    )


def _check_scale(
    reference: Track, suspect: Track, common: CommonFrames, *, is_reference_known: bool
) -> Iterator[TrackWarning]:
    """A scale between the tracks that is neither drift nor a regressor's leaning to the mean.

    Args:
        reference: See `check_pair`.
        suspect: See `check_pair`.
        common: Their frames, the suspect's left, read so that directions agree.
        is_reference_known: See `check_pair`.
    """
    moves = [
        common.moves.motion(track.target_from_source).translation_m
        for track in (common.left, common.right)
    ]
    if not median_direction_deg(*moves) < _FITTING_DIRECTION_DEG:
        return  # tracks that move in other directions have no common scale
    noise = jitter_m(common.left) / max(jitter_m(common.right), 1e-12)
    inverse, sigma = estimate_scale(common, noise)
    if not inverse > 0:
        return
    scale, off = 1 / inverse, abs(np.log(inverse))
    spread = abs(np.log(spread_m(common.left) / max(spread_m(common.right), 1e-12)))
    is_off = off > np.log(_LEAST_SCALE) and spread > np.log(_LEAST_SCALE) / 2
    if not (is_off and off - np.log(_TRUSTED_SCALE) > _SCALE_SIGMAS * sigma):
        return
    track, other = suspect, reference
    if not is_reference_known and not _length_unit(scale) and _length_unit(inverse):
        track, other, scale = reference, suspect, inverse
    unit = _length_unit(scale)
    named = f" ({unit}?)" if unit else ""
    yield TrackWarning(
        "scale",
        f"{track.name}: lengths are {scale:.3g} times those of {other.name}{named}",
        track.conversion(f"--scale {_factor(scale, unit)}"),
    )


def _length_unit(scale: float) -> str:
    """The unit of a file whose numbers are that many times metres, if it is a common one."""
    for factor, name in _LENGTH_UNITS.items():
        if abs(np.log(scale / factor)) < np.log(_TRUSTED_SCALE):
            return name
    return ""


def _factor(scale: float, unit: str) -> str:
    exact = {"millimetres": "0.001", "centimetres": "0.01", "feet": "0.3048", "inches": "0.0254"}
    return exact.get(unit) or f"{1 / scale:.3g}"
