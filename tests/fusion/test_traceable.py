"""Every batched method can be traced: one graph, no branches on data, for phones."""

import numpy as np
import pytest
from tests.helpers import convert_frames, frames_of, to_numpy

from vioapr.fusion.methods import METHODS
from vioapr.simulation.walks import WalkParams, simulate_walk

BATCHED = [name for name, method in METHODS.items() if method.is_batched]


@pytest.mark.slow
@pytest.mark.parametrize("name", BATCHED)
def test_the_traced_step_equals_the_eager_one(name):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    pytest.importorskip("array_api_compat.torch")
    method = METHODS[name]
    params = method.params_type()
    frames = convert_frames(frames_of(simulate_walk(WalkParams(duration_s=20), seed=1)), torch)
    state = method.init(params, (), frames.timestamp_s)

    class Step(torch.nn.Module):
        def forward(self, state, frame):
            return method.step(params, state, frame)

    program = torch.export.export(Step(), (state, frames.at(0))).module()
    traced_state = state
    for row in range(len(frames.timestamp_s)):
        state, eager = method.step(params, state, frames.at((row, ...)))
        traced_state, traced = program(traced_state, frames.at((row, ...)))
        assert traced.status == eager.status
        np.testing.assert_allclose(
            to_numpy(traced.world_from_cam.translation_m),
            to_numpy(eager.world_from_cam.translation_m),
            atol=1e-9,
        )
