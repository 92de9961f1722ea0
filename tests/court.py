"""Two walks round a court, seen by two trackers, and what matches between their images say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.two_view import PairGeometries

COUNT = 40
"""Images of each walk, one a second."""

WALL_M = 8.0
"""From a camera to the wall that it looks at."""


class Court(NamedTuple):
    """The images, and their true poses in a world with y up."""

    images: MapImages
    truth: Rigid3


def about_up(degrees) -> Rotation:
    return Rotation.from_rotvec(np.radians(np.asarray(degrees))[..., None] * [0.0, 1.0, 0.0])


def make_court(rng, drift_deg=3.0, jump_m=0.0, is_level=True) -> Court:
    """Both walk once round, looking at the walls; the second VIO turns away by and by."""
    angle = np.tile(np.linspace(0, 360, COUNT, endpoint=False), 2)
    radius = np.repeat([6.0, 7.0], COUNT)
    tilt = rng.uniform(-10, 10, 2 * COUNT)
    turn = about_up(angle) * Rotation.from_euler("x", (180 + tilt)[:, None], degrees=True)
    positions = radius[:, None] * about_up(angle).apply([0.0, 0.0, -1.0])
    positions[:, 1] = 1.5 + 0.05 * rng.standard_normal(2 * COUNT)
    truth = Rigid3(positions, turn.as_quat())
    world = np.repeat([0, 1], COUNT)
    share = np.concatenate([np.zeros(COUNT), np.linspace(0, 1, COUNT)])
    own = about_up(np.where(world == 0, 15.0, -80.0) + drift_deg * share)
    moved = own.apply(positions) + np.where(world == 0, 0.0, 5.0)[:, None]
    moved[COUNT + COUNT // 2 :, 0] += jump_m
    yes, zeros = np.ones(2 * COUNT, dtype=bool), np.zeros(2 * COUNT, dtype=np.intp)
    images = MapImages(
        tuple(f"{k}.jpg" for k in range(2 * COUNT)), world, ("a", "b"),
        np.tile(np.arange(COUNT) * 1.0, 2), world, Rigid3(moved, (own * turn).as_quat()),
        yes, yes, np.full(2 * COUNT, is_level), zeros, (), "", np.arange(2 * COUNT), {},
    )  # fmt: skip
    return Court(images, truth)


def pairs_of(truth: Rigid3, rows, noise_deg=0.5, rng=None) -> PairGeometries:
    """What matches between images say that were taken at these poses."""
    rows = np.asarray(rows, dtype=np.intp).reshape(-1, 2)
    first, second = rows.T
    way = rigid.between(truth.at(first), truth.at(second))
    noise = rng or np.random.default_rng(1)

    def shake():
        return Rotation.from_rotvec(np.radians(noise_deg) * noise.standard_normal((len(rows), 3)))

    length_m = np.linalg.norm(way.translation_m, axis=1)
    return PairGeometries(
        rows,
        np.full(len(rows), 50),
        (Rotation.from_quat(way.quat_xyzw).inv() * shake()).as_quat(),
        shake().apply(way.translation_m / np.maximum(length_m, 1e-9)[:, None]),
        np.degrees(2 * np.arctan(length_m / WALL_M / 2)),
    )


def sequential_rows(steps=2):
    """Neighbours within both walks."""
    return [
        (k, k + step)
        for start in (0, COUNT)
        for step in range(1, steps + 1)
        for k in range(start, start + COUNT - step)
    ]


def crossing_rows(every=2, shift=1):
    """Images of the two walks that see the same wall."""
    return [(k, COUNT + (k + shift) % COUNT) for k in range(0, COUNT, every)]


def joined(*parts: PairGeometries) -> PairGeometries:
    """All of them."""
    everything = parts[0]
    for part in parts[1:]:
        everything = everything.and_also(part)
    return everything


def moved_along(truth: Rigid3, rows, offset_m) -> Rigid3:
    """As if the given images were elsewhere along the wall that they look at."""
    positions = truth.translation_m.copy()
    rows = np.asarray(rows)
    right = Rotation.from_quat(truth.quat_xyzw[rows]).apply([1.0, 0.0, 0.0])
    positions[rows] += offset_m * right
    return Rigid3(positions, truth.quat_xyzw)


def error_m(poses: Rigid3, truth: Rigid3, fit_rows) -> np.ndarray:
    """Distance from the truth, once the given images are put onto it."""
    moved, true = poses.translation_m, truth.translation_m
    middle = moved[fit_rows].mean(axis=0), true[fit_rows].mean(axis=0)
    turn, _ = Rotation.align_vectors(true[fit_rows] - middle[1], moved[fit_rows] - middle[0])
    return np.linalg.norm(turn.apply(moved - middle[0]) + middle[1] - true, axis=1)
