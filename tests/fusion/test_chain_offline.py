"""Method `chain` over whole walks."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.helpers import frames_of

from vioapr.fusion.chain import offline as after_walk
from vioapr.fusion.chain import walk_model
from vioapr.fusion.chain.method import METHOD
from vioapr.fusion.chain.offline import smooth_walks
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.chain.passes import run_passes
from vioapr.fusion.chain.tridiagonal import BlockTridiagonal
from vioapr.fusion.chain.walk_model import (
    Path,
    errors_of,
    steps_of,
    view_shares,
)
from vioapr.fusion.offline import fuse_walks
from vioapr.fusion.pairing import PairedFrames, reverse
from vioapr.fusion.types import Status
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_map
from vioapr.simulation.regressors import NO_REGRESSOR_ERRORS, RegressorErrors
from vioapr.simulation.trackers import NO_TRACKER_ERRORS
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.work.progress import ignore

PARAMS = ChainParams()
PERFECT = WalkParams(duration_s=40, tracker=NO_TRACKER_ERRORS, regressor=NO_REGRESSOR_ERRORS)
CLEAN = WalkParams(
    duration_s=60,
    tracker=NO_TRACKER_ERRORS,
    regressor=RegressorErrors(
        bias_m=0.1, bias_deg=0.5, noise_m=0.05, noise_deg=0.3, lookalike_share=0.0
    ),
)


def smooth(inputs, params=PARAMS):
    return smooth_walks(params, [PairedFrames(inputs)])[0]


def errors(walk, fused, rows=slice(None)):
    """In m and deg."""
    gt, pose = walk.gt.target_from_source.at(rows), fused.world_from_cam.at(rows)
    return rigid.distance_m(gt, pose), rigid.angle_deg(gt, pose)


def turned_world(inputs, first):
    """With another tracking world from a frame on: turned about its up, and moved."""
    half = np.deg2rad(65.0)
    other = Rigid3(np.array([4.0, 0.3, -2.0]), np.array([0.0, np.sin(half), 0.0, np.cos(half)]))
    moved = other @ inputs.vio_from_cam
    is_new = np.arange(len(inputs.timestamp_s)) >= first
    return inputs._replace(vio_from_cam=rigid.choose(is_new, moved, inputs.vio_from_cam))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 8, 13])
def test_block_tridiagonal_systems_are_those_of_dense_matrices(count):
    rng = np.random.default_rng(count)
    size = 3
    dense = 0.1 * np.eye(count * size)
    for k in range(count):
        rows = slice(k * size, min((k + 2) * size, count * size))
        factor = rng.standard_normal((5, rows.stop - rows.start))
        dense[rows, rows] += factor.T @ factor
    blocks = dense.reshape(count, size, count, size).swapaxes(1, 2)
    numbers = np.arange(count)
    matrix = BlockTridiagonal(blocks[numbers, numbers], blocks[numbers[:-1], numbers[1:]])
    right = rng.standard_normal((count, size))
    inverse = np.linalg.inv(dense)
    np.testing.assert_allclose(matrix.solve(right).ravel(), inverse @ right.ravel(), atol=1e-12)
    expected = inverse.reshape(count, size, count, size).swapaxes(1, 2)[numbers, numbers]
    np.testing.assert_allclose(matrix.inverse_diagonal(), expected, atol=1e-12)


def passes_of(walk, params=PARAMS):
    return run_passes(params, [PairedFrames(frames_of(walk))], ignore)[0]


def test_derivatives_are_those_of_the_residuals():
    passes = passes_of(simulate_walk(WalkParams(duration_s=10), 0))
    rng = np.random.default_rng(1)
    count = len(passes.rows)
    path = Path(
        quaternion.normalize(rng.standard_normal((count, 4))), rng.standard_normal((count, 3))
    )
    before = steps_of(PARAMS, passes, path, True)
    change = 1e-6 * rng.standard_normal((count, 6))
    after = steps_of(PARAMS, passes, path.moved(change), True)
    by_turn = (before.by_turn @ change[:-1, :3, None])[..., 0]
    expected = np.diff(change[:, 3:], axis=0) + by_turn
    np.testing.assert_allclose(
        (after.residual - before.residual)[:, 3:], expected, rtol=1e-4, atol=1e-11
    )
    off = errors_of(passes, path.moved(change)).place_m - errors_of(passes, path).place_m
    np.testing.assert_allclose(off, -change[passes.predicted, 3:], atol=1e-12)


def test_without_errors_it_is_exact():
    walk = simulate_walk(PERFECT, 0)
    fused = smooth(frames_of(walk))
    position_m, orientation_deg = errors(walk, fused)
    assert position_m.max() < 1e-4
    assert orientation_deg.max() < 1e-4
    assert (fused.status == Status.OPTIMIZED).all()
    assert (fused.sigma_position_m > 0).all()
    np.testing.assert_allclose(
        fused.sigma_position_m, np.sqrt(np.mean(fused.sigma_position_axes_m**2, axis=1))
    )
    assert fused.sigma_orientation_axes_deg.shape == (len(fused), 3)


def test_the_future_helps():
    walks = [simulate_walk(WalkParams(duration_s=60), seed) for seed in range(6)]
    frames = [PairedFrames(frames_of(walk)) for walk in walks]
    causal, after = fuse_walks(METHOD, PARAMS, frames), smooth_walks(PARAMS, frames)
    pairs = [
        [errors(*pair) for pair in zip(walks, fused, strict=True)] for fused in (after, causal)
    ]
    ratios = np.array(
        [np.median(a, axis=1) / np.median(b, axis=1) for a, b in zip(*pairs, strict=True)]
    )
    assert (np.exp(np.mean(np.log(ratios), axis=0)) < [0.8, 1.0]).all()
    first = [np.mean([each[0][:10] for each in own]) for own in pairs]
    assert first[0] < 0.8 * first[1]


def test_walks_together_equal_walks_alone():
    walks = [
        PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=length), 2)))
        for length in (10, 15)
    ]
    for walk, fused in zip(walks, smooth_walks(PARAMS, walks), strict=True):
        alone = smooth(walk.inputs)
        np.testing.assert_allclose(
            alone.world_from_cam.translation_m, fused.world_from_cam.translation_m, atol=1e-9
        )
        np.testing.assert_allclose(alone.sigma_position_m, fused.sigma_position_m, atol=1e-9)


def test_ticks_once_a_time_step():
    walks = [PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=s), 2))) for s in (5, 8)]
    ticks = []
    smooth_walks(PARAMS, walks, tick=lambda: ticks.append(1))
    assert len(ticks) == 16


def test_each_tracking_world_lies_where_its_predictions_say():
    walk = simulate_walk(PERFECT, 3)
    inputs = turned_world(frames_of(walk), 30)
    inputs.tracking_reset[30] = True
    fused = smooth(inputs)
    assert errors(walk, fused)[0].max() < 1e-4
    assert errors(walk, fused)[1].max() < 1e-4


def test_a_world_without_predictions_is_nowhere():
    walk = simulate_walk(PERFECT, 3)
    inputs = turned_world(frames_of(walk), 30)
    inputs.tracking_reset[30] = True
    inputs.has_apr[30:] = False
    fused = smooth(inputs)
    assert (fused.status[30:] == Status.UNLOCALIZED).all()
    assert np.isnan(fused.world_from_cam.translation_m[30:]).all()
    assert np.isnan(fused.sigma_position_m[30:]).all()
    assert errors(walk, fused, slice(30))[0].max() < 1e-4


def test_without_any_prediction_nothing_is_known():
    inputs = frames_of(simulate_walk(WalkParams(duration_s=5), 0))
    inputs.has_apr[:] = False
    fused = smooth(inputs)
    assert (fused.status == Status.UNLOCALIZED).all()


def test_a_single_prediction_is_carried_both_ways():
    walk = simulate_walk(PERFECT, 1)
    inputs = frames_of(walk)
    inputs.has_apr[:] = False
    inputs.has_apr[40] = True
    fused = smooth(inputs)
    assert errors(walk, fused)[0].max() < 1e-4
    assert fused.status[40] == Status.OPTIMIZED
    assert (np.delete(fused.status, 40) == Status.TRACKED).all()


@pytest.mark.parametrize("is_new", [False, True], ids=["same world", "new world, unreported"])
def test_a_world_that_was_lost_is_verified(is_new):
    walk = simulate_walk(CLEAN, 4)
    inputs = frames_of(walk)
    inputs = turned_world(inputs, 64) if is_new else inputs
    inputs.tracking_ok[60:64] = False
    inputs.has_apr[62] = False
    fused = smooth(inputs)
    assert (
        fused.status[60:64] == [Status.PREDICTED] * 2 + [Status.UNLOCALIZED, Status.PREDICTED]
    ).all()
    np.testing.assert_array_equal(
        fused.world_from_cam.translation_m[60], inputs.apr_world_from_cam.translation_m[60]
    )
    position_m, orientation_deg = errors(walk, fused, inputs.tracking_ok)
    assert position_m.max() < 0.3
    assert orientation_deg.max() < 1.0
    passes = run_passes(PARAMS, [PairedFrames(inputs)], ignore)[0]
    np.testing.assert_array_equal(np.flatnonzero(~passes.is_linked), [59] * is_new)


def test_frames_without_predictions_are_less_sure():
    walk = simulate_walk(WalkParams(duration_s=120), 5)
    inputs = frames_of(walk)
    inputs.has_apr[80:160] = False
    inputs.has_apr[:10] = False
    fused = smooth(inputs)
    assert np.isfinite(fused.world_from_cam.translation_m).all()
    assert (fused.status[:10] == Status.TRACKED).all()
    assert (fused.status[10:80] == Status.OPTIMIZED).mean() > 0.9
    inside = fused.sigma_position_m[80:160]
    assert inside.argmax() in range(20, 60)
    assert inside.max() > 1.1 * fused.sigma_position_m[[79, 160]].max()


def test_wild_predictions_have_no_say():
    walk = simulate_walk(CLEAN, 6)
    inputs = frames_of(walk)
    rng = np.random.default_rng(6)
    is_wild = rng.random(len(inputs.timestamp_s)) < 0.25
    apr = inputs.apr_world_from_cam
    wild_m = apr.translation_m + np.where(is_wild[:, None], rng.normal(0, 15, (120, 3)), 0)
    turns = quaternion.from_rotvec(np.where(is_wild[:, None], rng.normal(0, 1, (120, 3)), 0))
    wild = Rigid3(wild_m, quaternion.multiply(turns, apr.quat_xyzw))
    clean, fused = smooth(inputs), smooth(inputs._replace(apr_world_from_cam=wild))
    assert errors(walk, fused)[0].max() < errors(walk, clean)[0].max() + 0.05
    assert errors(walk, fused)[1].max() < errors(walk, clean)[1].max() + 0.3


def test_a_heading_that_was_wrong_for_long_is_overruled_by_more_that_agree():
    walk = simulate_walk(WalkParams(duration_s=60, tracker=NO_TRACKER_ERRORS), 7)
    inputs = frames_of(walk)
    apr = inputs.apr_world_from_cam
    half_turn = np.array([0.0, 0.0, 1.0, 0.0])
    turned = Rigid3(apr.translation_m, quaternion.multiply(half_turn, apr.quat_xyzw))
    is_turned = np.arange(len(inputs.timestamp_s)) < 30
    inputs = inputs._replace(apr_world_from_cam=rigid.choose(is_turned, turned, apr))
    assert errors(walk, smooth(inputs))[1].max() < 5.0


def test_outside_the_map_nothing_is_claimed():
    walk = simulate_walk(WalkParams(duration_s=120), 8)
    inputs = frames_of(walk)
    anywhere = np.random.default_rng(8).permutation(len(inputs.timestamp_s))
    inputs = inputs._replace(apr_world_from_cam=inputs.apr_world_from_cam.at(anywhere))
    assert (smooth(inputs).status == Status.UNLOCALIZED).mean() > 0.95


def test_drift_that_is_given_is_used():
    walk = simulate_walk(WalkParams(duration_s=60), 9)
    passes_params = replace(
        PARAMS,
        tilt_drift_rad2_per_m=0.0,
        heading_drift_rad2_per_m=0.0,
        position_drift_m2_per_m=0.0,
        scale_error=0.0,
    )
    inputs = frames_of(walk)
    rigid_world = smooth(inputs, passes_params).world_from_cam @ inputs.vio_from_cam.inverse()
    spread_deg = quaternion.angle_between_deg(rigid_world.quat_xyzw, rigid_world.quat_xyzw[0])
    assert spread_deg.max() < 0.1
    loose = replace(passes_params, heading_drift_rad2_per_m=1e-3, position_drift_m2_per_m=0.1)
    free_world = smooth(inputs, loose).world_from_cam @ inputs.vio_from_cam.inverse()
    spread_deg = quaternion.angle_between_deg(free_world.quat_xyzw, free_world.quat_xyzw[0])
    assert spread_deg.max() > 1.0


def test_known_gravity_keeps_the_world_level():
    walk = simulate_walk(WalkParams(duration_s=40), 10)
    inputs = frames_of(walk)
    known = smooth(inputs, replace(PARAMS, gravity="known")).world_from_cam
    up_in_cam = quaternion.rotate(
        quaternion.inverse(inputs.vio_from_cam.quat_xyzw), np.array([0.0, 1.0, 0.0])
    )
    up = quaternion.rotate(known.quat_xyzw, up_in_cam)
    assert np.degrees(np.arctan2(np.linalg.norm(up[:, :2], axis=1), up[:, 2])).max() < 0.1


def test_backwards_is_the_same():
    inputs = frames_of(simulate_walk(WalkParams(duration_s=40), 11))
    given = replace(
        PARAMS,
        gravity="known",
        tilt_drift_rad2_per_m=1e-5,
        heading_drift_rad2_per_m=1e-5,
        position_drift_m2_per_m=1e-3,
    )
    forwards = smooth(inputs, given).world_from_cam
    backwards = smooth_walks(given, [reverse(PairedFrames(inputs))])[0].world_from_cam
    off_m = rigid.distance_m(forwards, backwards.at(slice(None, None, -1)))
    assert off_m.max() < 0.05


def test_the_windowed_view_density_is_that_of_all_pairs(monkeypatch):
    passes = passes_of(simulate_walk(WalkParams(duration_s=60), 12))
    whole = view_shares(passes, 0.5)
    monkeypatch.setattr(walk_model, "_REACH", 119)
    np.testing.assert_allclose(view_shares(passes, 0.5), whole, atol=1e-12)
    monkeypatch.setattr(walk_model, "_REACH", 10)
    assert (view_shares(passes, 0.5) >= whole - 1e-12).all()


def repeated(passes, copies):
    """The same walk several times over, as if its start were next to its end."""

    def tiled(part):
        return np.tile(part, (copies, 1))

    is_predicted = np.isin(np.arange(len(passes.rows)), passes.predicted)
    return passes._replace(
        rows=np.arange(copies * len(passes.rows)),
        vio_from_cam=tree_map(tiled, passes.vio_from_cam),
        since=tiled(np.append(passes.since, passes.since[-1:], axis=0))[:-1],
        is_linked=np.ones(copies * len(passes.rows) - 1, dtype=bool),
        world_from_vio=tree_map(tiled, passes.world_from_vio),
        predicted=np.flatnonzero(np.tile(is_predicted, copies)),
        world_from_cam=tree_map(tiled, passes.world_from_cam),
        stated=tiled(passes.stated),
    )


def test_memory_grows_with_the_walk_and_not_with_its_square(monkeypatch):
    monkeypatch.setattr(walk_model, "_REACH", 64)
    passes = passes_of(simulate_walk(WalkParams(duration_s=100), 13))
    peaks = []
    for copies in (2, 8):
        longer = repeated(passes, copies)
        tracemalloc.start()
        after_walk.smooth(PARAMS, longer)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 4.4 * peaks[0]


def test_stated_sigmas_are_those_of_the_errors():
    """They are scales of Student's t with two degrees of freedom, as the causal method's.

    Where prior knowledge helps (a level world, here), orientation is better than it is stated.
    """
    walks = [simulate_walk(WalkParams(duration_s=120), seed) for seed in range(16)]
    smoothed = smooth_walks(PARAMS, [PairedFrames(frames_of(walk)) for walk in walks])
    found = [errors(walk, fused) for walk, fused in zip(walks, smoothed, strict=True)]
    sigmas = [(fused.sigma_position_m, fused.sigma_orientation_deg) for fused in smoothed]
    error, sigma = np.concatenate(found, axis=1), np.concatenate(sigmas, axis=1)
    promised = np.sqrt(3 * stats.f.ppf(0.5, 3, 2))
    position, orientation = np.median(error / sigma, axis=1) / promised
    assert 0.7 < position < 1.4
    assert 0.4 < orientation < 1.4
    # And they tell good from bad: frames that are surer are righter.
    for own, stated in zip(error, sigma, strict=True):
        is_surer = stated < np.median(stated)
        assert np.median(own[is_surer]) < np.median(own[~is_surer])
