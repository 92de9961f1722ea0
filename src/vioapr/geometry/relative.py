"""The relative pose checker (paper, section 3.2): does the regressor move as VIO does?"""

from __future__ import annotations

from typing import Generic, NamedTuple

from vioapr.geometry.arrays import ArrayT, namespace
from vioapr.geometry.rigid import Rigid3, angle_deg, distance_m


class RelativeGap(NamedTuple, Generic[ArrayT]):
    """How far two odometries of the same pair of frames disagree.

    Attributes:
        distance_m: RPE<apr,vio> (equation 12), shape (...).
        angle_deg: ROE<apr,vio> (equation 13), shape (...).
    """

    distance_m: ArrayT
    angle_deg: ArrayT


def relative_gap(
    left_from_a: Rigid3[ArrayT],
    left_from_b: Rigid3[ArrayT],
    right_from_a: Rigid3[ArrayT],
    right_from_b: Rigid3[ArrayT],
) -> RelativeGap[ArrayT]:
    """Compare the motion between two frames a and b as two systems saw it.

    The gap is between the lengths of the two motions and between their angles (equations
    1-14), not the usual SE(3) relative error, so the two systems' worlds need no alignment.

    Args:
        left_from_a: Pose of the first frame in one system's world.
        left_from_b: Pose of the second frame in the same world.
        right_from_a: Pose of the first frame in the other system's world.
        right_from_b: Pose of the second frame in that world.
    """
    xp = namespace(left_from_a.translation_m)
    return RelativeGap(
        xp.abs(distance_m(left_from_a, left_from_b) - distance_m(right_from_a, right_from_b)),
        xp.abs(angle_deg(left_from_a, left_from_b) - angle_deg(right_from_a, right_from_b)),
    )
