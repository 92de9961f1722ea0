"""The simulated court as mapping sees it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from vioapr.geometry.frames import y_up_from_z_up
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.two_view import PairGeometries
from vioapr.simulation.court import see_pairs, walk_court


class Court(NamedTuple):
    """The images, and their true poses in a world with y up."""

    images: MapImages
    truth: Rigid3


def make_court(rng, drift_deg=3.0, jump_m=0.0, is_level=True) -> Court:
    """Both walks, each a recording with a tracking world of its own."""
    walks = walk_court(rng, drift_deg, jump_m)
    count = len(walks.walk)
    yes, zeros = np.ones(count, dtype=bool), np.zeros(count, dtype=np.intp)
    images = MapImages(
        tuple(f"{k}.jpg" for k in range(count)), walks.walk, ("a", "b"),
        walks.timestamp_s, walks.walk, walks.vio_from_cam,
        yes, yes, np.full(count, is_level), zeros, (), "", np.arange(count), {},
    )  # fmt: skip
    return Court(images, y_up_from_z_up(walks.world_from_cam))


def pairs_of(truth: Rigid3, rows, noise_deg=0.5, rng=None) -> PairGeometries:
    """What 50 matches a pair say of images that were taken at these poses."""
    views = see_pairs(truth, rows, noise_deg, rng)
    return PairGeometries(views.rows, np.full(len(views.rows), 50), *views[1:])


def joined(*parts: PairGeometries) -> PairGeometries:
    """All of them."""
    everything = parts[0]
    for part in parts[1:]:
        everything = everything.and_also(part)
    return everything


def error_m(poses: Rigid3, truth: Rigid3, fit_rows) -> np.ndarray:
    """Distance from the truth, once the given images are put onto it."""
    moved, true = poses.translation_m, truth.translation_m
    middle = moved[fit_rows].mean(axis=0), true[fit_rows].mean(axis=0)
    turn, _ = Rotation.align_vectors(true[fit_rows] - middle[1], moved[fit_rows] - middle[0])
    return np.linalg.norm(turn.apply(moved - middle[0]) + middle[1] - true, axis=1)
