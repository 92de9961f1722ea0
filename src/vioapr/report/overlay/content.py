"""Where content stands if nobody says it, which of it is seen, and how far off it appears."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import ParameterError
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.arrays import FloatArray
from vioapr.geometry.rigid import Rigid3
from vioapr.report.overlay.canvas import Array, Pinhole
from vioapr.report.overlay.marker import pose_of
from vioapr.report.overlay.walk import OverlayWalk
from vioapr.report.style import spread
from vioapr.schemas.anchors import Anchor

_MOST_FRAMES = 300
_MOST_ANCHORS = 5
_LEAST_GAIN = 0.3
"""What a further anchor must add to what the frames see, as a share of what the first one is."""
_EDGE = 0.15
"""Share of the picture at every edge in which content is hardly seen."""
_GROUND_BELOW_CAMERA_M = 1.5
"""How high people hold a phone."""
_ON_GROUND_M = 2.5, 9.0
"""Depths from which a person sees content on the ground."""
_BEFORE_CAMERA_M = 0.4, 4.0
"""Depths of what is on a desk or a wall."""
_LEAST_SEEN = 0.15
"""Share of frames below which nobody looks along the way that was walked."""
_GOOD_SHARE = 0.33
"""Of the picture's height: content of this size is looked at."""
_GROUND_SIZE_M, _SIZE_PER_DEPTH = 1.2, 0.2


class Candidates(NamedTuple):
    """Places where content might stand.

    Attributes:
        foot_m: World coordinates, shape (m, 3).
        size_m: Height of content there, shape (m,).
        depths_m: Depths from which it is seen well.
    """

    foot_m: Array
    size_m: Array
    depths_m: tuple[float, float]


def place_anchors(walk: OverlayWalk) -> tuple[Anchor, ...]:
    """Place content on what the cameras look at.

    On the ground of the way that the walk takes, since that is free and in sight, where most
    pictures show it well; further pieces where others do. Where pictures do not show the way, as in
    a capture of a desk, where the cameras' axes come together.

    Raises:
        ParameterError: No place is in the pictures.
    """
    poses = walk.reference
    known = np.flatnonzero(poses.is_known)
    rows = known[spread(len(known), _MOST_FRAMES)]
    cameras, cam_from_world = [walk.cameras[row] for row in rows], poses.at(rows).inverse()
    position_m = poses.translation_m[rows]
    ground_m = position_m - _GROUND_BELOW_CAMERA_M * walk.up
    candidates = Candidates(ground_m, np.full(len(rows), _GROUND_SIZE_M), _ON_GROUND_M)
    worth = _worth(candidates, walk.up, cameras, cam_from_world)
    chosen = _choose(worth)
    if not chosen or (worth[:, chosen].max(axis=1) > 0).mean() < _LEAST_SEEN:
        depth_m = np.geomspace(*_BEFORE_CAMERA_M, 10)[:, None]
        along = np.array([0.0, 0.0, 1.0]) * depth_m
        points_m = poses.at(rows).at((slice(None), None)).apply(along).reshape(-1, 3)
        sizes_m = np.tile(_SIZE_PER_DEPTH * depth_m[:, 0], len(rows))
        some = spread(len(points_m), 4 * _MOST_FRAMES)
        candidates = Candidates(points_m[some], sizes_m[some], _BEFORE_CAMERA_M)
        worth = _worth(candidates, walk.up, cameras, cam_from_world)
        chosen = _choose(worth)
    if not chosen:
        raise ParameterError("no place is in the pictures: give `anchors`")
    return tuple(
        Anchor(
            label="ABCDEFGH"[number],
            position_m=_rounded(candidates.foot_m[k]),
            quat_xyzw=_facing(walk.up, candidates.foot_m[k], position_m[worth[:, k] > 0]),
            size_m=round(float(candidates.size_m[k]), 3),
        )
        for number, k in enumerate(chosen)
    )


def _worth(
    candidates: Candidates, up: Array, cameras: list[Pinhole], cam_from_world: Rigid3[FloatArray]
) -> Array:
    """How well frames see candidates, 0 to 1, shape (frames, candidates)."""
    near_m, far_m = candidates.depths_m
    middle_m = candidates.foot_m + 0.5 * candidates.size_m[:, None] * up
    worth = np.zeros((len(cameras), len(middle_m)))
    for row, camera in enumerate(cameras):
        inside = cam_from_world.at(row).apply(middle_m)
        depth_m = inside[:, 2]
        is_seen = camera.sees(inside, _EDGE) & (depth_m > near_m) & (depth_m < far_m)
        worth[row, is_seen] = near_m / depth_m[is_seen]
    return worth


def _choose(worth: Array) -> list[int]:
    """Candidates of which every next one adds most to what the frames see, greedily."""
    chosen: list[int] = []
    best, least = np.zeros(len(worth)), 0.0
    while len(chosen) < _MOST_ANCHORS:
        gain = np.maximum(worth - best[:, None], 0).sum(axis=0)
        if gain.max(initial=0.0) <= least:
            break
        least = least or _LEAST_GAIN * gain.max()
        chosen.append(int(gain.argmax()))
        best = np.maximum(best, worth[:, chosen[-1]])
    return chosen


def _facing(up: Array, foot_m: Array, viewers_m: Array) -> tuple[float, float, float, float]:
    """Upright, with the front to where it is mostly seen from."""
    z = up / np.linalg.norm(up)
    front = viewers_m.mean(axis=0) - foot_m
    front -= (front @ z) * z
    if np.linalg.norm(front) < 1e-6:  # seen from straight above: any direction will do
        front = np.cross(z, np.roll(z, 1))
    x = front / np.linalg.norm(front)
    matrix = np.stack([x, np.cross(z, x), z], axis=1)
    qx, qy, qz, qw = (round(float(value), 6) for value in quaternion.from_matrix(matrix))
    return qx, qy, qz, qw


def _rounded(position_m: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 3) for value in position_m)
    return x, y, z


def find_seen(walk: OverlayWalk, anchors: tuple[Anchor, ...]) -> NDArray[np.float64]:
    """Find how well content is seen in every picture, by the reference poses.

    Returns:
        1 where content is whole in the picture and takes a third of its height, less where it is
        smaller or larger, 0 where it is not; shape (frames, anchors).
    """
    seen = np.zeros((len(walk), len(anchors)))
    ends_m = np.stack([_ends_m(anchor) for anchor in anchors])
    for row in np.flatnonzero(walk.reference.is_known):
        camera, cam_from_world = walk.cameras[row], walk.reference.at(row).inverse()
        inside = cam_from_world.apply(ends_m)
        whole = camera.sees(inside).all(axis=1)
        extent_px = np.linalg.norm(np.diff(camera.project(inside[whole]), axis=1)[:, 0], axis=-1)
        share = extent_px / camera.height / _GOOD_SHARE
        seen[row, whole] = np.minimum(share, 1 / share)
    return seen


def _ends_m(anchor: Anchor) -> Array:
    """Foot and top of content, world coordinates, shape (2, 3)."""
    return pose_of(anchor).apply(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, anchor.size_m]]))


def displacement_m(
    estimate: Rigid3[FloatArray], truth: Rigid3[FloatArray], anchor: Anchor
) -> float:
    """How far content appears from its place: the distance in the real world, m.

    Args:
        estimate: world_from_cam that content is drawn by.
        truth: world_from_cam of the camera that took the picture.
        anchor: The content.
    """
    foot_m = np.array(anchor.position_m)
    appears_m = (truth @ estimate.inverse()).apply(foot_m)
    return float(np.linalg.norm(appears_m - foot_m))


class PoseError(NamedTuple):
    """How far a pose is from the truth."""

    position_m: float
    orientation_deg: float


def pose_error(estimate: Rigid3[FloatArray], truth: Rigid3[FloatArray]) -> PoseError:
    """Compare two poses world_from_cam."""
    return PoseError(
        float(rigid.distance_m(estimate, truth)), float(rigid.angle_deg(estimate, truth))
    )
