"""Which reading of a file's convention fits another track of the same walk.

The motion between two frames, seen from the camera, is the same in every world. So a map track
and a VIO track of one walk must agree on it, and where they do not, another convention may make
them: relative rotations and directions of motion tell inverted poses, OpenGL camera axes, wrong
quaternion order and mirrored worlds apart. (Angles of relative rotations alone do not: the
inverse rotation has the same.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import AssociationError
from vioapr.formats import conventions
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.vectors import angle_between_deg
from vioapr.schemas.inspection import Fit
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory, associate

MIN_COMMON_FRAMES = 8
"""Fewer frames do not tell readings apart, nor which way is up."""

_SPAN_S = 3.0
_SPAN_FRAMES = 10
_LEAST_MOTION_M = 0.05
_CLEARLY_WRONG_DEG = 8.0
_CLEARLY_BETTER = 0.6
_PRESENT = 0.8


@dataclass(frozen=True)
class Reading:
    """A convention that a file might have, instead of the one it was read with.

    Attributes:
        title: What the file would then hold.
        change: From the poses as read to the poses of this reading.
    """

    title: str
    change: Callable[[Rigid3], Rigid3]


def _reorder(order: tuple[int, ...]) -> Callable[[Rigid3], Rigid3]:
    return lambda poses: poses._replace(quat_xyzw=poses.quat_xyzw[..., list(order)])


def _mirror(axis: int, *, with_rotations: bool) -> Callable[[Rigid3], Rigid3]:
    positions, quats = np.ones(3), np.ones(4)
    positions[axis] = -1
    if with_rotations:
        quats[[i for i in range(3) if i != axis]] = -1
    return lambda poses: Rigid3(poses.translation_m * positions, poses.quat_xyzw * quats)


AS_READ = Reading("as read", conventions.world_from_cam)
INVERTED_ROTATION = Reading(
    "rotations inverted (cam_from_world beside a position in the world)",
    conventions.centre_and_cam_from_world,
)
QUATERNION_ORDERS = (
    Reading("quaternion in the other order (wxyz read as xyzw)", _reorder((1, 2, 3, 0))),
    Reading("quaternion in the other order (xyzw read as wxyz)", _reorder((3, 0, 1, 2))),
)
READINGS = (
    AS_READ,
    INVERTED_ROTATION,
    Reading("poses inverted (cam_from_world)", conventions.cam_from_world),
    Reading("OpenGL camera axes (y up, looking along -z)", conventions.world_from_arcam),
    Reading(
        "rotations inverted and OpenGL camera axes",
        lambda poses: conventions.world_from_arcam(conventions.centre_and_cam_from_world(poses)),
    ),
    *QUATERNION_ORDERS,
    *(
        Reading(
            f"left-handed, world and camera mirrored in {name}", _mirror(i, with_rotations=True)
        )
        for i, name in enumerate("xyz")
    ),
    *(
        Reading(f"positions mirrored in {name}", _mirror(i, with_rotations=False))
        for i, name in enumerate("xyz")
    ),
)


def fit_readings(
    suspect: Trajectory, reference: Trajectory, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> list[Fit]:
    """Fit each reading of a track to another of the same walk, and sort them, the best first.

    Args:
        suspect: The track whose convention is in question.
        reference: One whose convention is known; its world may be another.
        tolerance_s: Largest difference of paired timestamps, s.

    Raises:
        AssociationError: They have fewer than `MIN_COMMON_FRAMES` frames in common.
    """
    pairs = associate(suspect, reference, tolerance_s)
    if len(pairs) <= MIN_COMMON_FRAMES:
        raise AssociationError(
            f"expected more than {MIN_COMMON_FRAMES} common frames to compare conventions with, "
            f"got {len(pairs)}"
        )
    suspect, reference = suspect.at_rows(pairs.left_rows), reference.at_rows(pairs.right_rows)
    # Rows between the frames compared: long enough to move, short enough not to drift.
    step_s = float(np.median(np.diff(reference.timestamp_s)))
    wanted = round(_SPAN_S / step_s) if reference.is_timed else _SPAN_FRAMES
    span = int(np.clip(wanted, 1, len(reference) // 2))
    expected = _relative(reference.target_from_source, span)
    fits: list[Fit] = []
    for reading in READINGS:
        relative = _relative(reading.change(suspect.target_from_source), span)
        rotation_deg = float(np.median(rigid.angle_deg(relative, expected)))
        direction_deg = median_direction_deg(relative.translation_m, expected.translation_m)
        fits.append(
            Fit(title=reading.title, rotation_deg=rotation_deg, direction_deg=direction_deg)
        )
    # Of readings that fit about as well, as positions mirrored in a flat world, the present one.
    return sorted(fits, key=lambda fit: fit.score_deg * (_PRESENT if _is_present(fit) else 1))


def _is_present(fit: Fit) -> bool:
    return fit.title == AS_READ.title


def find_better_reading(fits: list[Fit]) -> Fit | None:
    """Pick the best fit, if the track as read fits badly and another reading clearly better."""
    as_read = next(fit for fit in fits if _is_present(fit))
    is_wrong = as_read.score_deg > _CLEARLY_WRONG_DEG
    return fits[0] if is_wrong and fits[0].score_deg < _CLEARLY_BETTER * as_read.score_deg else None


def fits_better_inverted(apr: Trajectory, vio: Trajectory) -> bool:
    """Whether a map track's rotations fit a VIO's better when they are inverted.

    For files whose quaternion may be world_from_cam or cam_from_world, as MARViN's.

    Raises:
        AssociationError: Too few frames in common.
    """
    rotation_deg = {fit.title: fit.rotation_deg for fit in fit_readings(apr, vio)}
    return rotation_deg[INVERTED_ROTATION.title] < rotation_deg[AS_READ.title]


def _relative(world_from_cam: Rigid3, span: int) -> Rigid3:
    earlier, later = world_from_cam.at(slice(None, -span)), world_from_cam.at(slice(span, None))
    return earlier.inverse() @ later


def median_direction_deg(left_m: NDArray[np.float64], right_m: NDArray[np.float64]) -> float:
    """The median angle between two series of motions in one frame.

    Args:
        left_m: Shape (n, 3), m.
        right_m: Shape (n, 3), m.

    Returns:
        Degrees, over the rows where both move; NaN where too few do.
    """
    lengths_m = np.linalg.norm(left_m, axis=-1), np.linalg.norm(right_m, axis=-1)
    moves = np.minimum(*lengths_m) > _LEAST_MOTION_M
    if moves.sum() < MIN_COMMON_FRAMES:
        return float("nan")
    return float(np.median(angle_between_deg(left_m[moves], right_m[moves])))


def up_of(quat_xyzw: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, bool]:
    """Find where a hand-held camera's world has its up, by the camera alone.

    People hold cameras level, so of the camera's axes across its view, one stays near the
    vertical: -y for a picture held upright, -x for a phone in portrait, whose sensor lies on
    its side.

    Args:
        quat_xyzw: world_from_cam, OpenCV axes, shape (n, 4).

    Returns:
        The unit mean up-vector in the world, shape (3,); the median angle to it, degrees;
        whether the sensor lies on its side.
    """
    best = (np.zeros(3), float("inf"), False)
    for axis, is_portrait in ((np.array([0.0, -1.0, 0.0]), False), (np.array([-1.0, 0, 0]), True)):
        ups = quaternion.rotate(quat_xyzw, np.broadcast_to(axis, (len(quat_xyzw), 3)))
        mean = ups.mean(axis=0)
        length = float(np.linalg.norm(mean))
        mean = mean / length if length > 1e-9 else axis
        spread_deg = float(np.median(angle_between_deg(ups, mean)))
        # Portrait must be clearly better: a camera that hardly turns is level either way.
        if spread_deg < best[1] * (0.7 if is_portrait else 1.0):
            best = (mean, spread_deg, is_portrait)
    return best
