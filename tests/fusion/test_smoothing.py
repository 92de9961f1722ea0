import numpy as np
import pytest
from tests.helpers import frames_of

from vioapr.errors import ParameterError
from vioapr.fusion.chain.offline import smooth_walks as smooth_by_chain
from vioapr.fusion.methods import METHODS, get_method
from vioapr.fusion.pairing import PairedFrames, reverse
from vioapr.fusion.smoothing import SMOOTHERS, smooth_walk
from vioapr.simulation.walks import WalkParams, simulate_walk


def test_the_method_smooths_by_itself():
    frames = PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=10), 0)))
    chain = get_method("chain")
    fused = smooth_walk(chain, chain.params_type(), frames)
    (expected,) = smooth_by_chain(chain.params_type(), [frames])
    np.testing.assert_array_equal(
        fused.world_from_cam.translation_m, expected.world_from_cam.translation_m
    )


def test_reversing_twice_changes_nothing_but_where_worlds_begin():
    inputs = frames_of(simulate_walk(WalkParams(duration_s=10), 0))
    inputs.tracking_reset[7] = True
    backwards = reverse(PairedFrames(inputs)).inputs
    # 20 frames: the world that begins at frame 7 ends, backwards, before frame 6.
    np.testing.assert_array_equal(np.flatnonzero(backwards.tracking_reset), [19 - 6])
    again = reverse(PairedFrames(backwards)).inputs
    np.testing.assert_allclose(again.timestamp_s, inputs.timestamp_s)
    np.testing.assert_array_equal(np.flatnonzero(again.tracking_reset), [7])


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(SMOOTHERS)))
def test_methods_that_cannot_are_refused(name):
    method = get_method(name)
    frames = PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=5), 0)))
    with pytest.raises(ParameterError, match=f"can use the future: chain; {name} cannot"):
        smooth_walk(method, method.params_type(), frames)
