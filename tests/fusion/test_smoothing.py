import numpy as np
import pytest
from tests.helpers import frames_of

from vioapr.errors import ParameterError
from vioapr.fusion.methods import get_method
from vioapr.fusion.offline import fuse_walk
from vioapr.fusion.pairing import PairedFrames
from vioapr.fusion.smoothing import reverse, smooth_walk, smooth_walks
from vioapr.fusion.types import Status
from vioapr.geometry import rigid
from vioapr.simulation.walks import WalkParams, simulate_walk

CHAIN = get_method("chain")
PARAMS = CHAIN.params_type()


def errors_m(walk, fused):
    return rigid.distance_m(walk.gt.target_from_source, fused.world_from_cam)


@pytest.mark.slow
def test_the_future_helps():
    gains = []
    for seed in range(3):
        walk = simulate_walk(WalkParams(duration_s=90), seed)
        frames = PairedFrames(frames_of(walk))
        causal = errors_m(walk, fuse_walk(CHAIN, PARAMS, frames))
        smooth = errors_m(walk, smooth_walk(CHAIN, PARAMS, frames))
        gains.append(np.median(smooth) / np.median(causal))
        assert smooth[:10].mean() < causal[:10].mean()
    assert np.mean(gains) < 1


def test_smoothed_poses_have_no_place_of_the_tracking_world():
    frames = PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=10), 0)))
    assert fuse_walk(CHAIN, PARAMS, frames).world_from_vio is not None
    # That of one pass would not go with poses of both.
    assert smooth_walk(CHAIN, PARAMS, frames).world_from_vio is None


def test_reversing_twice_changes_nothing_but_where_worlds_begin():
    inputs = frames_of(simulate_walk(WalkParams(duration_s=10), 0))
    inputs.tracking_reset[7] = True
    backwards = reverse(PairedFrames(inputs)).inputs
    # 20 frames: the world that begins at frame 7 ends, backwards, before frame 6.
    np.testing.assert_array_equal(np.flatnonzero(backwards.tracking_reset), [19 - 6])
    again = reverse(PairedFrames(backwards)).inputs
    np.testing.assert_allclose(again.timestamp_s, inputs.timestamp_s)
    np.testing.assert_array_equal(np.flatnonzero(again.tracking_reset), [7])


def test_frames_that_only_the_future_knows_get_a_pose():
    inputs = frames_of(simulate_walk(WalkParams(duration_s=20), 1))
    inputs.has_apr[:10] = False
    causal = fuse_walk(CHAIN, PARAMS, PairedFrames(inputs))
    smooth = smooth_walk(CHAIN, PARAMS, PairedFrames(inputs))
    assert (causal.status[:10] == Status.UNLOCALIZED).all()
    assert (smooth.status[:10] == Status.TRACKED).all()
    assert np.isfinite(smooth.world_from_cam.translation_m).all()
    assert np.isfinite(smooth.sigma_position_m).all()


def test_walks_together_equal_walks_alone():
    walks = [
        PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=length), 2)))
        for length in (10, 15)
    ]
    together = smooth_walks(CHAIN, PARAMS, walks)
    for walk, fused in zip(walks, together, strict=True):
        alone = smooth_walk(CHAIN, PARAMS, walk)
        np.testing.assert_allclose(
            alone.world_from_cam.translation_m, fused.world_from_cam.translation_m, atol=1e-9
        )


def test_a_method_without_uncertainty_is_refused():
    method = get_method("vio-apr")
    frames = PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=5), 0)))
    with pytest.raises(ParameterError, match="states its uncertainty, like chain; vio-apr"):
        smooth_walk(method, method.params_type(), frames)
