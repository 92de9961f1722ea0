"""Method `chain` after the walk, on what people who build AR localization suffer from."""

import importlib
import sys

import numpy as np
import pytest
from tests.cases_of import case_folder

from vioapr.fusion.chain.offline import smooth_walks
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.types import FrameInput
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

HALF_TURN = np.array([0.0, 0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def sim():
    """The simulator of the cases: its walks, with `normal` and `shift` on top."""
    folder = str(case_folder("localization", group=""))
    sys.path.insert(0, folder)
    try:
        yield importlib.import_module("sim")
    finally:
        sys.path.remove(folder)


def ordinary(sim, seed):
    """5 Hz predictions, 5 % of them wild."""
    return sim.predict(sim.track(sim.path(60, 10, seed=seed), seed), seed, every=2)


def paired(walk, is_shifted=False, offset_m=(0.0, 0.0, 0.0)):
    """Its frames; predictions of some turned by a half turn, about the middle, and moved."""
    count = len(walk.t)
    shifted = np.broadcast_to(is_shifted, (count,))
    turned = quaternion.multiply(HALF_TURN, walk.aq.as_quat())
    moved = walk.ap * np.where(np.any(offset_m), [-1.0, -1.0, 1.0], 1.0) + offset_m
    apr = Rigid3(
        np.where(shifted[:, None], moved, walk.ap),
        np.where(shifted[:, None], turned, walk.aq.as_quat()),
    )
    vio = Rigid3(walk.vp, walk.vq.as_quat())
    return PairedFrames(FrameInput(walk.t, apr, walk.has, vio, walk.ok, walk.reset))


def errors_of(walks, frames):
    """In m and deg, and over the stated sigmas, of all frames of each walk."""
    for walk, fused in zip(walks, smooth_walks(ChainParams(), frames), strict=True):
        off_m = np.linalg.norm(fused.world_from_cam.translation_m - walk.p, axis=1)
        off_deg = quaternion.angle_between_deg(fused.world_from_cam.quat_xyzw, walk.q.as_quat())
        yield off_m, off_deg, off_m / fused.sigma_position_m


def test_wild_predictions_move_nothing(sim):
    walks = [ordinary(sim, seed) for seed in (1, 11, 22)]
    for off_m, off_deg, ratio in errors_of(walks, [paired(walk) for walk in walks]):
        assert off_m.max() < 0.6
        assert off_deg.max() < 2.0
        assert ratio.max() < 5


def test_the_majority_of_two_modes_wins(sim):
    walks = [ordinary(sim, seed) for seed in range(4)]
    frames = []
    for seed, walk in enumerate(walks):
        is_elsewhere = np.random.default_rng(seed + 9).random(len(walk.t)) < 0.3
        frames.append(paired(walk, is_elsewhere, (18.0, 4.0, 0.0)))
    for off_m, off_deg, ratio in errors_of(walks, frames):
        assert off_m.max() < 2.0  # of 18 m
        assert off_deg.max() < 5.0  # of 180 deg
        assert ratio.max() < 5


def test_a_heading_that_is_flipped_at_the_start_is_overruled(sim):
    walks = [ordinary(sim, seed) for seed in range(4)]
    for off_m, off_deg, ratio in errors_of(walks, [paired(walk, walk.t < 8) for walk in walks]):
        assert off_m.max() < 1.0
        assert off_deg.max() < 3.0
        assert ratio.max() < 5
