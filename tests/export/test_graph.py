"""The graph in eager PyTorch against the NumPy localizer, frame by frame."""

import numpy as np
import pytest
from tests.localizers import EXPORTED, events, vio_pose

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.export.graph import FusionGraph  # noqa: E402

IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)


def make(name):
    method = METHODS[name]
    return FusionGraph(method, method.params_type())


def flat(pose):
    return np.concatenate([*pose]).astype(np.float32)


def run(graph, apr, has_apr, vio, time_s, is_ok, is_reset, state, sigmas=(np.nan, np.nan)):
    one = torch.ones(1)
    params = [float(getattr(graph.params, name)) for name in graph.param_names]
    with torch.no_grad():
        return graph(
            torch.from_numpy(apr),
            *(one * sigma for sigma in sigmas),
            one * has_apr,
            torch.from_numpy(vio),
            one * time_s,
            one * is_ok,
            one * is_reset,
            state,
            torch.tensor(params) if params else None,
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPORTED)
def test_it_equals_the_numpy_localizer(name, walk):
    graph, localizer = make(name), Localizer(name)
    state = torch.zeros(graph.layout.size)
    seen = set()
    for row, time_s in enumerate(walk.gt.timestamp_s):
        has_apr, is_ok, is_reset = events(row)
        sigmas = (0.5 + row % 3, 1.0 + row % 4) if row % 5 else (np.nan, np.nan)
        apr = flat(walk.apr.target_from_source.at(row))
        vio = flat(vio_pose(walk, row))
        outputs = run(graph, apr, has_apr, vio, time_s, is_ok, is_reset, state, sigmas)
        state = outputs["next_state"]
        estimate = localizer.update(
            time_s,
            Rigid3(apr[:3], apr[3:]) if has_apr else None,
            Rigid3(vio[:3], vio[3:]),
            is_ok,
            tracking_reset=is_reset,
            apr_sigma_m=sigmas[0] if row % 5 else None,
            apr_sigma_deg=sigmas[1] if row % 5 else None,
        )
        assert int(outputs["status"]) == estimate.status
        assert int(outputs["confirmed_run"]) == estimate.confirmed_run
        seen.add(estimate.status)
        for pose in ("world_from_cam", "world_from_vio"):
            expected = np.concatenate([*getattr(estimate, pose)])
            # The walk is 10 m wide: 1e-5 of that.
            np.testing.assert_allclose(outputs[pose].numpy(), expected, atol=1e-4)
    assert len(seen) >= 3


@pytest.mark.parametrize("name", EXPORTED)
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e20])
def test_a_pose_that_is_none_counts_as_none(name, value):
    graph = make(name)
    bad = IDENTITY.copy()
    bad[1] = value
    outputs = run(graph, bad, 1, bad, 0.0, 1, 0, torch.zeros(graph.layout.size))
    assert int(outputs["status"]) == Status.UNLOCALIZED
    assert torch.isnan(outputs["world_from_cam"]).all()
    assert torch.isfinite(outputs["next_state"]).all()


@pytest.mark.parametrize("name", EXPORTED)
def test_a_state_of_another_model_starts_anew(name):
    graph = make(name)
    foreign = torch.full((graph.layout.size,), 3.0)
    fresh = torch.zeros(graph.layout.size)
    for state in (foreign, torch.full_like(fresh, torch.nan)):
        found = run(graph, IDENTITY, 1, IDENTITY, 0.0, 1, 0, state)
        expected = run(graph, IDENTITY, 1, IDENTITY, 0.0, 1, 0, fresh)
        for key in expected:
            torch.testing.assert_close(found[key], expected[key], equal_nan=True)


def test_the_papers_parameters_are_inputs():
    graph = make("vio-apr")
    states = {pairs: torch.zeros(graph.layout.size) for pairs in (2, 4)}
    statuses = {pairs: [] for pairs in states}
    for row in range(6):
        for pairs, state in states.items():
            params = torch.tensor([0.4, 4.0, float(pairs), 8.0])
            flag, pose = torch.ones(1), torch.from_numpy(IDENTITY)
            apr = (pose, flag, flag, flag)
            outputs = graph(*apr, pose, flag * row, flag, flag * 0, state, params)
            states[pairs] = outputs["next_state"]
            statuses[pairs].append(int(outputs["status"]))
    assert statuses[2] == [0, 0, 2, 2, 2, 2]
    assert statuses[4] == [0, 0, 0, 0, 2, 2]
