"""The graph in eager PyTorch against the NumPy localizer, frame by frame."""

import numpy as np
import pytest
from tests.localizers import EXPORTED, events, vio_pose

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS
from vioapr.fusion.types import Status
from vioapr.geometry.quaternion import normalize
from vioapr.geometry.rigid import Rigid3, between

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.export.graph import CarryGraph, FusionGraph  # noqa: E402

IDENTITY = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)


def make(name):
    method = METHODS[name]
    return FusionGraph(method, method.params_type())


def flat(pose):
    return np.concatenate([*pose]).astype(np.float32)


def run(
    graph, apr, has_apr, vio, time_s, is_ok, is_reset, state, sigmas=(np.nan, np.nan), taken=None
):
    one = torch.ones(1)
    taken_s, taken_at = (time_s, vio) if taken is None else taken
    with torch.no_grad():
        return graph(
            torch.from_numpy(apr),
            *(one * sigma for sigma in sigmas),
            one * has_apr,
            torch.from_numpy(vio),
            one * time_s,
            one * is_ok,
            one * is_reset,
            one * taken_s,
            torch.from_numpy(taken_at),
            state,
            params_of(graph),
        )


def params_of(graph):
    params = [float(getattr(graph.params, name)) for name in graph.param_names]
    return torch.tensor(params) if params else None


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
        poses = {name: getattr(estimate, name) for name in ("world_from_cam", "world_from_vio")}
        poses["display_from_vio"] = estimate.eased.display_from_vio
        for name_, pose in poses.items():
            expected = np.concatenate([*pose])
            # The walk is 10 m wide: 1e-5 of that.
            np.testing.assert_allclose(outputs[name_].numpy(), expected, atol=1e-4)
        assert float(outputs["display_left_m"]) == pytest.approx(estimate.eased.left_m, abs=1e-4)
        assert bool(outputs["display_placed_anew"]) == bool(estimate.eased.is_placed_anew)
    assert len(seen) >= 3


@pytest.mark.parametrize("name", EXPORTED)
def test_a_frame_without_prediction_is_carried_the_same(name, walk):
    graph = make(name)
    state = torch.zeros(graph.layout.size)
    for row in range(16):
        apr, vio = (flat(track.target_from_source.at(row)) for track in (walk.apr, walk.vio))
        flags = (row / 2, row != 9, row == 12)
        outputs = run(graph, apr, row < 8 or row == 10, vio, *flags, state)
        one = torch.ones(1)
        tensors = (torch.from_numpy(vio), *(one * flag for flag in flags))
        with torch.no_grad():
            carried = CarryGraph(graph)(*tensors, state, params_of(graph))
        is_same = all(torch.equal(outputs[k].isnan(), carried[k].isnan()) for k in outputs)
        if row >= 8 and row != 10:
            assert is_same
            for key in outputs:
                torch.testing.assert_close(carried[key], outputs[key], equal_nan=True)
        state = outputs["next_state"]


@pytest.mark.parametrize("late", [1, 3])
@pytest.mark.parametrize("name", EXPORTED)
def test_a_late_prediction_is_moved_on_as_vio_has_moved(name, late, walk):
    graph, localizer = make(name), Localizer(name)
    state = torch.zeros(graph.layout.size)
    poses = [flat(vio_pose(walk, row)) for row in range(40)]
    statuses = []
    for row in range(40):
        taken_row = max(row - late, 0)
        apr = flat(walk.apr.target_from_source.at(taken_row))
        vio, then = poses[row], poses[taken_row]
        taken = (taken_row / 2, then)
        outputs = run(graph, apr, row >= late, vio, row / 2, 1, 0, state, taken=taken)
        state = outputs["next_state"]
        moved = Rigid3(apr[:3], apr[3:]) @ between(
            Rigid3(then[:3], then[3:]), Rigid3(vio[:3], vio[3:])
        )
        moved = Rigid3(moved.translation_m.astype(float), normalize(moved.quat_xyzw.astype(float)))
        given = moved if row >= late else None
        estimate = localizer.update(row / 2, given, Rigid3(vio[:3], vio[3:]))
        expected = np.concatenate([*estimate.world_from_cam])
        np.testing.assert_allclose(outputs["world_from_cam"].numpy(), expected, atol=1e-4)
        statuses.append(int(outputs["status"]))
    assert max(statuses) >= Status.KEYFRAME


@pytest.mark.parametrize(
    ("age_s", "lost_at", "reset_at", "is_used"),
    [
        (0, None, None, True),
        (2, None, None, True),
        (6, None, None, False),  # too old
        (-1, None, None, False),  # of a picture that is still to come
        (2, 18, None, True),  # lost and found before it was taken
        (2, 20, None, False),
        (2, None, 18, True),
        (2, None, 20, False),
    ],
)
def test_late_predictions_of_another_world_are_dropped(age_s, lost_at, reset_at, is_used):
    graph = make("chain")
    state = torch.zeros(graph.layout.size)
    for row in range(20):
        flags = (row, row != lost_at, row == reset_at)
        state = run(graph, IDENTITY, row < 15, IDENTITY, *flags, state)["next_state"]
        if row + 1 == 20 and 20 in (lost_at, reset_at):
            flags = (20, lost_at != 20, reset_at == 20)
            state = run(graph, IDENTITY, 0, IDENTITY, *flags, state)["next_state"]
    place = IDENTITY.copy()
    place[0] = 0.1
    taken = (21 - age_s, IDENTITY)
    outputs = run(graph, place, 1, IDENTITY, 21, 1, 0, state, taken=taken)
    assert (int(outputs["status"]) == Status.OPTIMIZED) == is_used


def test_a_late_prediction_without_pose_is_dropped():
    graph = make("chain")
    state = run(graph, IDENTITY, 1, IDENTITY, 0.0, 1, 0, torch.zeros(graph.layout.size))
    place, nothing = IDENTITY.copy(), np.full(7, np.nan, dtype=np.float32)
    place[0] = 0.1
    outputs = run(graph, place, 1, IDENTITY, 1.0, 1, 0, state["next_state"], taken=(0.5, nothing))
    assert int(outputs["status"]) == Status.TRACKED


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
            frame = (pose, flag * row, flag, flag * 0, flag * row, pose)
            outputs = graph(*apr, *frame, state, params)
            states[pairs] = outputs["next_state"]
            statuses[pairs].append(int(outputs["status"]))
    assert statuses[2] == [0, 0, 2, 2, 2, 2]
    assert statuses[4] == [0, 0, 0, 0, 2, 2]
