"""What `vioapr inspect --json` says of every file."""

from __future__ import annotations

from typing import Literal

from vioapr.schemas.base import Record


class Candidate(Record, frozen=True, kw_only=True):
    """A format that a file may be.

    Attributes:
        name: The format's.
        confidence: 0 to 1.
    """

    name: str
    confidence: float


class Speed(Record, frozen=True, kw_only=True):
    """Speeds between successive poses.

    Attributes:
        median_m_s: The median.
        p95_m_s: The 95th percentile.
        max_m_s: The largest.
    """

    median_m_s: float
    p95_m_s: float
    max_m_s: float


class Up(Record, frozen=True, kw_only=True):
    """Which axis of the target frame is up, and how the camera was held.

    Attributes:
        axis: The axis, e.g. "+z".
        by: "definition" of the format, or "camera": a guess, by how a camera is held that stays
            level.
        off_axis_deg: Angle between the axis and the camera's mean up-vector, degrees.
        spread_deg: Median angle of single poses to the mean, degrees.
        is_portrait: Whether the sensor lies on its side.
    """

    axis: str
    by: Literal["definition", "camera"]
    off_axis_deg: float
    spread_deg: float
    is_portrait: bool


class Fit(Record, frozen=True, kw_only=True):
    """How well a reading of a file's convention fits another track of the same walk.

    Attributes:
        title: The reading's.
        rotation_deg: Median angle between the relative rotations of the two tracks.
        direction_deg: Median angle between their directions of motion, in the camera's frame;
            NaN (null in JSON) where they do not move.
    """

    title: str
    rotation_deg: float
    direction_deg: float

    @property
    def score_deg(self) -> float:
        """Both residuals in one; directions count half, as noise in position spoils them."""
        is_known = self.direction_deg == self.direction_deg
        return self.rotation_deg + (self.direction_deg / 2 if is_known else 0.0)


class DeviceRotation(Record, frozen=True, kw_only=True):
    """The constant transform body_from_cam between the device of a file and another track's.

    The body is the source of the file's poses, the camera that of the other track.

    Attributes:
        angle_deg: Angle of the rotation body_from_cam, degrees.
        axis: Its axis, a unit vector.
        matrix: The rotation as a matrix, by rows.
        quat_xyzw: The rotation as a quaternion, Hamilton.
        rotation_sigma_deg: Standard deviation about the axis that is known least, degrees.
        lever_arm_m: Where the camera is in the body's frame, metres, or None where the motion
            does not tell.
        lever_arm_sigma_m: Standard deviation of the lever arm per axis, metres.
    """

    angle_deg: float
    axis: tuple[float, float, float]
    matrix: tuple[tuple[float, ...], ...]
    quat_xyzw: tuple[float, ...]
    rotation_sigma_deg: float
    lever_arm_m: tuple[float, ...] | None
    lever_arm_sigma_m: tuple[float, ...]


class Inspection(Record, frozen=True, kw_only=True):
    """Facts and anomalies of a file.

    Attributes:
        path: The file.
        candidates: Formats that it may be, likeliest first; the first was read.
        convention: The columns and directions of the format that was read.
        poses: Number of poses.
        frames: target_from_source.
        has_names: Whether poses have image names.
        is_timed: Whether poses have timestamps.
        start_s: First timestamp, s, or None.
        duration_s: Seconds between first and last pose, or None.
        rate_hz: One over the median step, or None.
        extent_m: Lowest and highest coordinate along x, y and z, metres.
        path_length_m: Sum of the steps, metres.
        speed: Or None without timestamps.
        up: Or None where the source frame is not a camera.
        warnings: What looks wrong, a line each.
        fits: Readings compared with another track, best first; empty without one.
        device: The constant rotation and lever arm between the two tracks' devices; None where
            there is none, no other track, or the motion does not tell.
        notes: How the file was read, where it is worth knowing: units and columns found.
    """

    path: str
    candidates: tuple[Candidate, ...]
    convention: str
    poses: int
    frames: str
    has_names: bool
    is_timed: bool
    start_s: float | None
    duration_s: float | None
    rate_hz: float | None
    extent_m: tuple[tuple[float, float], ...]
    path_length_m: float
    speed: Speed | None
    up: Up | None
    warnings: tuple[str, ...]
    fits: tuple[Fit, ...] = ()
    device: DeviceRotation | None = None
    notes: tuple[str, ...] = ()
