"""Every batched method can be traced: one graph, no branches on data, for phones."""

import numpy as np
import pytest
from tests.helpers import convert_frames, frames_of, to_numpy

from vioapr.fusion.methods import METHODS
from vioapr.fusion.types import Status
from vioapr.geometry.tree import tree_leaves
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow

BATCHED = [name for name, method in METHODS.items() if method.is_batched]
LENGTH = 60


def troubled_frames():
    """Predictions missing, alone and for long; a tracker lost twice and reset once; sigmas."""
    frames = frames_of(simulate_walk(WalkParams(duration_s=LENGTH / 2), seed=1))
    row = np.arange(LENGTH)
    stated_m = np.where(row % 5 == 0, np.nan, np.exp(np.sin(row)))
    return frames._replace(
        has_apr=(row % 6 != 4) & (row != 0) & ((row < 50) | (row > 56)),
        tracking_ok=~np.isin(row, [24, 25, 26, 47]),
        tracking_reset=row == 36,
        apr_sigma_m=stated_m,
        apr_sigma_rad=0.1 * stated_m,
    )


def assert_leaves_close(traced, eager):
    """Every array: of the same type, shape and, but for rounding, values."""
    pairs = list(zip(tree_leaves(traced), tree_leaves(eager), strict=True))
    for ours, theirs in pairs:
        assert ours.dtype == theirs.dtype
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(to_numpy(ours), to_numpy(theirs), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "states_sigmas"), [*((name, False) for name in BATCHED), ("chain", True)]
)
def test_the_traced_step_equals_the_eager_one(name, states_sigmas):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    pytest.importorskip("array_api_compat.torch")
    method = METHODS[name]
    params = method.params_type()
    frames = troubled_frames()
    if not states_sigmas:
        frames = frames._replace(apr_sigma_m=None, apr_sigma_rad=None)
    frames = convert_frames(frames, torch)
    state = method.init(params, (), frames.timestamp_s)

    class Step(torch.nn.Module):
        def forward(self, state, frame):
            return method.step(params, state, frame)

    program = torch.export.export(Step(), (state, frames.at(0))).module()
    traced_state = state
    statuses = set()
    for row in range(LENGTH):
        state, eager = method.step(params, state, frames.at((row, ...)))
        traced_state, traced = program(traced_state, frames.at((row, ...)))
        assert_leaves_close(traced, eager)
        assert_leaves_close(traced_state, state)
        statuses.add(int(eager.status))
    # The walk must have had the method do all that it can.
    assert len(statuses) > 1
    assert Status.UNLOCALIZED in statuses
