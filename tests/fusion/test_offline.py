from dataclasses import replace

import numpy as np
import pytest
from tests.helpers import frames_of

from vioapr.errors import AssociationError, ParameterError
from vioapr.fusion.methods import METHODS, get_method
from vioapr.fusion.offline import fuse_walk, fuse_walks, run_steps
from vioapr.fusion.pairing import PairedFrames, check_pairing, pair_frames
from vioapr.fusion.types import Status
from vioapr.fusion.vio_apr import VioAprParams
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.trajectory import Trajectory, associate

VIO_APR = METHODS["vio-apr"]


def paired(seed, duration_s=60.0):
    walk = simulate_walk(WalkParams(duration_s=duration_s), seed)
    return pair_frames(walk.apr, walk.vio)


def line(times, names=None, is_timed=True):
    count = len(times)
    return Trajectory.from_arrays(
        times,
        np.outer(np.arange(count), [1.0, 0, 0]),
        np.tile([0.0, 0, 0, 1], (count, 1)),
        names,
        is_timed=is_timed,
    )


def test_frames_are_the_union_in_order_of_time():
    frames = pair_frames(line([1.0, 2.5, 4.0]), line([0.0, 1.0, 2.0, 3.0, 4.0])).inputs
    assert frames.timestamp_s.tolist() == [0, 1, 2, 2.5, 3, 4]
    assert frames.has_apr.tolist() == [False, True, False, True, False, True]
    assert frames.tracking_ok.tolist() == [True, True, True, False, True, True]
    assert frames.apr_world_from_cam.translation_m[[1, 3, 5], 0].tolist() == [0, 1, 2]
    assert frames.vio_from_cam.translation_m[[0, 1, 2, 4, 5], 0].tolist() == [0, 1, 2, 3, 4]


def test_frames_by_name():
    apr = line([0, 1], ["b.jpg", "c.jpg"], is_timed=False)
    frames = pair_frames(apr, line([0, 1, 2], ["a.jpg", "b.jpg", "c.jpg"], is_timed=False))
    assert frames.names == ("a.jpg", "b.jpg", "c.jpg")
    assert frames.inputs.has_apr.tolist() == [False, True, True]


def test_walks_that_do_not_meet_are_refused():
    with pytest.raises(AssociationError, match="cover 0.000 to 1.000 s, VIO 10.000 to 11.000 s"):
        pair_frames(line([0.0, 1.0]), line([10.0, 11.0]))
    with pytest.raises(AssociationError, match="nothing in common, e.g. 'a' and 'b'"):
        pair_frames(line([0], ["a"], is_timed=False), line([0], ["b"], is_timed=False))


def between_frames(walk, shift_s, rate_hz=30.0):
    """A simulated walk's VIO at a rate, and predictions at other times than its frames."""
    times = np.arange(walk.vio.timestamp_s[0], walk.vio.timestamp_s[-1], 1 / rate_hz)
    apr = walk.apr.at_rows(slice(0, -1))
    return replace(apr, timestamp_s=apr.timestamp_s + shift_s), walk.vio.interpolate(times)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vio-apr", "chain"])
def test_predictions_between_vio_frames_lose_nothing(name):
    apr, vio = between_frames(simulate_walk(WalkParams(duration_s=60), 1), 0.0165)
    frames = pair_frames(apr, vio)
    assert frames.inputs.tracking_ok.all()
    assert frames.inputs.has_apr.sum() == len(apr)
    assert check_pairing(frames, len(apr)) == []
    fused = fuse_walk(METHODS[name], METHODS[name].params_type(), frames)
    assert fused.is_localized.mean() > 0.9
    exact = pair_frames(*between_frames(simulate_walk(WalkParams(duration_s=60), 1), 0.0))
    expected = fuse_walk(METHODS[name], METHODS[name].params_type(), exact)
    assert abs(fused.is_localized.mean() - expected.is_localized.mean()) < 0.02


def test_interpolated_vio_lies_between_its_frames():
    apr, vio = line([0.06, 0.55]), line(np.arange(20) / 10)
    inputs = pair_frames(apr, vio).inputs
    rows = np.flatnonzero(inputs.has_apr)
    np.testing.assert_allclose(inputs.vio_from_cam.translation_m[rows, 0], [0.6, 5.5])
    assert inputs.tracking_ok.all()


def test_frames_at_exact_stamps_are_bit_equal_with_others_between():
    walk = simulate_walk(WalkParams(duration_s=30, rate_hz=10), 3)
    exact = pair_frames(walk.apr, walk.vio).inputs
    times = np.sort(np.concatenate([walk.apr.timestamp_s, [4.043, 9.061]]))
    mixed = pair_frames(walk.apr.interpolate(times), walk.vio).inputs
    rows = np.isin(mixed.timestamp_s, exact.timestamp_s)
    assert rows.sum() == len(rows) - 2
    for part, wanted in zip(mixed.vio_from_cam, exact.vio_from_cam, strict=True):
        np.testing.assert_array_equal(part[rows], wanted)


def test_walks_that_meet_between_frames_alone_are_fused():
    apr, vio = between_frames(simulate_walk(WalkParams(duration_s=30), 1), 0.05, rate_hz=5.0)
    assert not len(associate(vio, apr))
    assert pair_frames(apr, vio).inputs.tracking_ok.all()


def test_predictions_without_vio_are_counted_with_a_remedy():
    apr, vio = between_frames(simulate_walk(WalkParams(duration_s=40), 1), 0.0165)
    lost = (vio.timestamp_s > 10) & (vio.timestamp_s < 12.1)
    frames = pair_frames(apr, vio.at_rows(np.flatnonzero(~lost)))
    assert (~frames.inputs.tracking_ok).sum() == 5  # one on each side is still between frames
    (warning,) = check_pairing(frames, len(apr))
    assert str(warning).startswith(
        f"5 of {len(apr)} predictions have no VIO pose within 0.01 s, 5 of them while VIO goes on"
    )
    assert "`tolerance_s`" in warning.remedy


def test_a_tracker_that_starts_a_little_later_is_no_reason_to_warn():
    walk = simulate_walk(WalkParams(duration_s=60), 1)
    few, many = (pair_frames(walk.apr, walk.vio.at_rows(slice(start, None))) for start in (5, 60))
    assert check_pairing(few, len(walk.apr)) == []
    (warning,) = check_pairing(many, len(walk.apr))
    assert str(warning).startswith("60 of 120 predictions have no VIO pose within 0.01 s, and")


def test_predictions_left_out_by_name_are_counted():
    names = [f"{k}.jpg" for k in range(9)]
    apr = line(range(9), names, is_timed=False)
    vio = line(range(6), names[:6], is_timed=False)
    (warning,) = check_pairing(pair_frames(apr, vio), len(apr))
    assert str(warning).startswith("3 of 9 predictions are left out")
    assert check_pairing(pair_frames(vio, apr), len(vio)) == []


def test_retrospective_view_confirms_the_run_from_its_beginning():
    frames = paired(0)
    live = fuse_walk(VIO_APR, VioAprParams(), frames, view="live")
    later = fuse_walk(VIO_APR, VioAprParams(), frames, view="retrospective")
    first = int(np.argmax(live.status == Status.KEYFRAME))
    assert (live.status[first - 2 : first] == Status.UNLOCALIZED).all()
    assert (later.status[first - 2 : first] == Status.KEYFRAME).all()
    apr = frames.inputs.apr_world_from_cam
    np.testing.assert_array_equal(
        later.world_from_cam.translation_m[first - 2], apr.translation_m[first - 2]
    )
    changed = later.status != live.status
    assert (later.status[changed] == Status.KEYFRAME).all()
    np.testing.assert_array_equal(
        later.world_from_cam.translation_m[~changed], live.world_from_cam.translation_m[~changed]
    )


def test_retrospective_view_skips_frames_without_predictions():
    walk = simulate_walk(WalkParams(duration_s=30, rate_hz=4), seed=2)
    sparse = walk.apr.at_rows(slice(None, None, 4))
    later = fuse_walk(VIO_APR, VioAprParams(), pair_frames(sparse, walk.vio))
    keyframes = np.flatnonzero(later.status == Status.KEYFRAME)
    assert len(keyframes) > 3
    assert (keyframes % 4 == 0).all()


@pytest.mark.slow
def test_a_batch_of_walks_of_different_lengths_equals_each_alone():
    walks = [paired(seed, duration) for seed, duration in enumerate([20.0, 60.0, 35.0])]
    for name, method in METHODS.items():
        if not method.is_batched:
            continue
        params = method.params_type()
        for together, frames in zip(fuse_walks(method, params, walks), walks, strict=True):
            alone = fuse_walk(method, params, frames)
            assert len(together) == len(frames), name
            np.testing.assert_array_equal(together.status, alone.status)
            np.testing.assert_allclose(
                together.world_from_cam.translation_m,
                alone.world_from_cam.translation_m,
                atol=1e-9,
            )


def test_no_walks_are_no_results():
    assert fuse_walks(VIO_APR, VioAprParams(), []) == []


def test_ticks_count_frames():
    ticks = []
    frames = paired(0, 20.0)
    run_steps(VIO_APR, VioAprParams(), frames.inputs, tick=lambda: ticks.append(1))
    assert len(ticks) == len(frames)


def test_an_unknown_view_is_refused():
    with pytest.raises(ParameterError, match="unknown view 'both'"):
        fuse_walk(VIO_APR, VioAprParams(), paired(0, 5.0), view="both")  # type: ignore[arg-type]


def test_an_unknown_method_is_refused():
    with pytest.raises(ParameterError, match="unknown method 'x': expected one of apr, vio"):
        get_method("x")


def test_state_does_not_grow():
    frames = frames_of(simulate_walk(WalkParams(duration_s=50)))
    state = VIO_APR.init(VioAprParams(), (), frames.timestamp_s)

    def size(state):
        return sum(size(s) if isinstance(s, tuple) else s.nbytes for s in state)

    sizes = set()
    for k in range(len(frames.timestamp_s)):
        state, _ = VIO_APR.step(VioAprParams(), state, frames.at((k, ...)))
        sizes.add(size(state))
    assert len(sizes) == 1


def test_paired_frames_know_their_times():
    frames = PairedFrames(frames_of(simulate_walk(WalkParams(duration_s=5))))
    assert len(frames) == 10
    assert frames.timestamp_s[0] == 0.5
