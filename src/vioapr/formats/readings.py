"""Which reading of a file's convention fits another track of the same walk.

The motion between two frames, seen from the camera, is the same in every world. So a map track
and a VIO track of one walk must agree on it, and where they do not, another convention may make
them: relative rotations and directions of motion tell inverted poses, OpenGL camera axes, wrong
quaternion order, mirrored worlds and poses of an IMU's body apart. (Angles of relative rotations
alone do not: the inverse rotation has the same.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vioapr.formats import conventions
from vioapr.formats.common_motion import (
    MIN_COMMON_FRAMES,
    CommonFrames,
    find_common_frames,
    turn_angles_deg,
)
from vioapr.geometry import hand_eye, quaternion, rigid
from vioapr.geometry.frames import y_up_from_z_up, z_up_from_y_up
from vioapr.geometry.hand_eye import HandEye
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.vectors import angle_between_deg
from vioapr.schemas.inspection import Fit
from vioapr.trajectory import DEFAULT_TOLERANCE_S, Trajectory

HAND_EYE_TITLE = "a constant rotation between the two sources"

_CLEARLY_WRONG_DEG = 8.0
_CLEARLY_BETTER = 0.6
_EVIDENCE = 8.0
_ABOUT_AS_GOOD = 0.8
_FLOOR_DEG = 0.5
_WORSE = 1.2
_FITTING_TURN, _FITTING_DIRECTION_DEG = 0.55, 45.0
_SAME_AXES_DEG = 12.0
_HALF_TURN_ABOUT_X = np.array([1.0, 0.0, 0.0, 0.0])
_LEAST_ROTATION_DEG = 8.0
_LEAST_MOTION = 0.3


@dataclass(frozen=True)
class Reading:
    """A convention that a file might have, instead of the one it was read with.

    Attributes:
        name: On the command line.
        title: What the file would then hold.
        change: From the poses as read to the poses of this reading.
        faults: How many things were then wrong at once.
    """

    name: str
    title: str
    change: Callable[[Rigid3], Rigid3]
    faults: int = 1


def _reorder(order: tuple[int, ...]) -> Callable[[Rigid3], Rigid3]:
    return lambda poses: poses._replace(quat_xyzw=poses.quat_xyzw[..., list(order)])


def _mirror(axis: int, *, with_rotations: bool) -> Callable[[Rigid3], Rigid3]:
    positions, quats = np.ones(3), np.ones(4)
    positions[axis] = -1
    if with_rotations:
        quats[[i for i in range(3) if i != axis]] = -1
    return lambda poses: Rigid3(poses.translation_m * positions, poses.quat_xyzw * quats)


def _with_opengl_axes(reading: Reading) -> Reading:
    return Reading(
        f"{reading.name}-opengl",
        f"{reading.title} and OpenGL camera axes",
        lambda poses: conventions.world_from_arcam(reading.change(poses)),
        2,
    )


def _turn_positions(turn: Callable[[Rigid3], Rigid3]) -> Callable[[Rigid3], Rigid3]:
    return lambda poses: poses._replace(translation_m=turn(poses).translation_m)


AS_READ = Reading("as-read", "as read", conventions.world_from_cam, 0)
INVERTED_ROTATION = Reading(
    "inverted-rotations",
    "rotations inverted (cam_from_world beside a position in the world)",
    conventions.centre_and_cam_from_world,
)
INVERTED = Reading("inverted", "poses inverted (cam_from_world)", conventions.cam_from_world)
OPENGL = Reading(
    "opengl", "OpenGL camera axes (y up, looking along -z)", conventions.world_from_arcam
)
QUATERNION_ORDERS = (
    Reading("wxyz", "quaternion in the other order (wxyz read as xyzw)", _reorder((1, 2, 3, 0))),
    Reading("xyzw", "quaternion in the other order (xyzw read as wxyz)", _reorder((3, 0, 1, 2))),
)
MIRRORED_POSITIONS = tuple(
    Reading(f"mirror-{name}", f"positions mirrored in {name}", _mirror(i, with_rotations=False))
    for i, name in enumerate("xyz")
)
READINGS = (
    AS_READ,
    INVERTED_ROTATION,
    INVERTED,
    OPENGL,
    *QUATERNION_ORDERS,
    *(
        Reading(
            f"left-handed-{name}",
            f"left-handed, world and camera mirrored in {name}",
            _mirror(i, with_rotations=True),
        )
        for i, name in enumerate("xyz")
    ),
    *MIRRORED_POSITIONS,
    Reading(
        "positions-y-up", "positions y up beside rotations z up", _turn_positions(z_up_from_y_up)
    ),
    Reading(
        "positions-z-up", "positions z up beside rotations y up", _turn_positions(y_up_from_z_up)
    ),
    _with_opengl_axes(INVERTED_ROTATION),
    _with_opengl_axes(INVERTED),
    *map(_with_opengl_axes, QUATERNION_ORDERS),
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """How every reading of a track fits another track of the same walk.

    Attributes:
        fits: The best first.
        as_read: The fit of the track as it was read.
        turn_deg: Median angle that the other track turns between the frames compared.
        turns: How many pairs of frames that rotations were compared between do not overlap.
        moves: And how many that directions of motion were compared between.
        hand_eye: The constant transform between the two sources, where one is determined.
    """

    fits: tuple[Fit, ...]
    as_read: Fit
    turn_deg: float
    turns: float
    moves: float
    hand_eye: HandEye | None = None

    def explains(self, fit: Fit) -> bool:
        """Whether a fit is one in absolute terms, not only a better one than others.

        Its residuals must be small against the motion itself: about half of those that no
        motion at all would leave.
        """
        turns = fit.rotation_deg <= max(_FITTING_TURN * self.turn_deg, _CLEARLY_WRONG_DEG / 2)
        return turns and not fit.direction_deg > _FITTING_DIRECTION_DEG

    @property
    def better(self) -> Fit | None:
        """The fit to advise: it explains the motion, and the track as read clearly does not."""
        best, now = self.fits[0], self.as_read
        if best is now or not self.explains(best):
            return None
        turns, moves = self._ratios(best)
        is_clear = (
            now.rotation_deg > _CLEARLY_WRONG_DEG and turns < _CLEARLY_BETTER and not moves > _WORSE
        ) or (
            now.direction_deg > 2 * _CLEARLY_WRONG_DEG
            and moves < _CLEARLY_BETTER
            and turns < _WORSE
        )
        return best if is_clear and self._evidence(best) > _EVIDENCE else None

    @property
    def as_read_fits(self) -> bool:
        """Whether the track fits as it was read, so that no reading is worth looking for."""
        now = self.as_read
        return now.rotation_deg <= _CLEARLY_WRONG_DEG and not (
            now.direction_deg > 2 * _CLEARLY_WRONG_DEG
        )

    def _ratios(self, fit: Fit) -> tuple[float, float]:
        """A fit's residuals of rotation and direction over those of the track as read."""
        now = self.as_read
        return (
            (fit.rotation_deg + _FLOOR_DEG) / (now.rotation_deg + _FLOOR_DEG),
            (fit.direction_deg + _FLOOR_DEG) / (now.direction_deg + _FLOOR_DEG),
        )

    def _evidence(self, fit: Fit) -> float:
        """The logarithm of the likelihood ratio to the track as read, Laplacian residuals.

        Pairs of frames that overlap count once.
        """
        turns, moves = self._ratios(fit)
        of_moves = 0.0 if np.isnan(moves) else -self.moves * float(np.log(moves))
        return -self.turns * float(np.log(turns)) + of_moves


def compare_readings(common: CommonFrames) -> Comparison:
    """Fit each reading of the left track to the right one."""
    suspect, reference = common.left, common.right
    expected = (
        common.turns.motion(reference.target_from_source),
        common.moves.motion(reference.target_from_source),
    )

    def fit(title: str, poses: Rigid3) -> Fit:
        return Fit(
            title=title,
            rotation_deg=float(np.median(rigid.angle_deg(common.turns.motion(poses), expected[0]))),
            direction_deg=median_direction_deg(
                common.moves.motion(poses).translation_m, expected[1].translation_m
            ),
        )

    poses = suspect.target_from_source
    fits = [(fit(reading.title, reading.change(poses)), reading.faults) for reading in READINGS]
    solved = find_hand_eye(common)
    # A device turned to OpenGL's axes, or nearly, is a convention with a little tilt.
    if solved is not None and not (
        quaternion.angle_between_deg(solved.body_from_cam.quat_xyzw, _HALF_TURN_ABOUT_X)
        < _SAME_AXES_DEG
    ):
        fits.append((fit(HAND_EYE_TITLE, poses @ solved.body_from_cam), 2))
    return Comparison(
        tuple(_rank(fits)),
        fits[0][0],
        float(np.median(turn_angles_deg(common.turns, reference))),
        common.turns.independent,
        common.moves.independent,
        solved,
    )


def _rank(fits: list[tuple[Fit, int]]) -> list[Fit]:
    """The best first; of those that fit about as well, the one with the fewest faults."""

    def score(item: tuple[Fit, int]) -> float:
        fit, faults = item
        return (fit.score_deg + _FLOOR_DEG) / _ABOUT_AS_GOOD**faults

    return [fit for fit, _ in sorted(fits, key=score)]


def find_hand_eye(common: CommonFrames) -> HandEye | None:
    """Find the constant transform between the sources of two tracks, body_from_cam.

    Args:
        common: The left track's source is the body, the right one's the camera.

    Returns:
        None where the motion does not determine its rotation.
    """
    body, cam = common.left.target_from_source, common.right.target_from_source
    turns, moves = common.turns, common.moves
    sets = (
        hand_eye.rotation_vectors(turns.motion(body).quat_xyzw, turns.motion(cam).quat_xyzw),
        hand_eye.unit_directions(moves.motion(body).translation_m, moves.motion(cam).translation_m),
    )
    if max(len(pairs.left) for pairs in sets) < MIN_COMMON_FRAMES:
        return None
    fitted = hand_eye.fit_rotation(sets, max(turns.per_independent, moves.per_independent))
    if not np.rad2deg(fitted.sigma_rad) < _LEAST_ROTATION_DEG:
        return None
    arm = hand_eye.fit_lever_arm(
        turns.motion(body), turns.motion(cam), fitted.left_from_right_xyzw, turns.per_independent
    )
    return HandEye(
        Rigid3(arm.position_m, fitted.left_from_right_xyzw), fitted.sigma_rad, arm.sigma_m
    )


def fit_readings(
    suspect: Trajectory, reference: Trajectory, tolerance_s: float = DEFAULT_TOLERANCE_S
) -> Comparison:
    """Fit each reading of a track to another of the same walk.

    Args:
        suspect: The track whose convention is in question.
        reference: One whose convention is known; its world may be another.
        tolerance_s: Largest difference of paired timestamps, s.

    Raises:
        AssociationError: They have no more than `MIN_COMMON_FRAMES` frames in common.
    """
    return compare_readings(find_common_frames(suspect, reference, tolerance_s))


def fits_better_inverted(apr: Trajectory, vio: Trajectory) -> bool:
    """Whether a map track's rotations fit a VIO's better when they are inverted.

    For files whose quaternion may be world_from_cam or cam_from_world, as MARViN's.

    Raises:
        AssociationError: Too few frames in common.
    """
    rotation_deg = {fit.title: fit.rotation_deg for fit in fit_readings(apr, vio).fits}
    return rotation_deg[INVERTED_ROTATION.title] < rotation_deg[AS_READ.title]


def median_direction_deg(left_m: NDArray[np.float64], right_m: NDArray[np.float64]) -> float:
    """The median angle between two series of motions in one frame.

    Args:
        left_m: Shape (n, 3), of any unit.
        right_m: Shape (n, 3), of any unit.

    Returns:
        Degrees, over the rows where both move; NaN where too few do.
    """
    lengths = np.linalg.norm(left_m, axis=-1), np.linalg.norm(right_m, axis=-1)
    if not (lengths[0].any() and lengths[1].any()):
        return float("nan")
    moves = np.minimum(*(each / np.median(each[each > 0]) for each in lengths)) > _LEAST_MOTION
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
