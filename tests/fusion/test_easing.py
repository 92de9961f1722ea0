"""Content that is not to jump."""

import numpy as np
import pytest

from vioapr.errors import ParameterError
from vioapr.fusion.easing import EasingParams, ease, no_easing
from vioapr.fusion.localizer import Localizer
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.walks import WalkParams, simulate_walk

PARAMS = EasingParams()
NO = np.asarray(False)
CONTENT = np.array([0.0, 0.0, 3.0])


def pose(position, rotvec=(0.0, 0.0, 0.0)):
    return Rigid3(np.asarray(position, float), quaternion.from_rotvec(np.asarray(rotvec, float)))


def follow(targets, vio=None, seconds=0.1, resets=()):
    state, shown = no_easing((), np.zeros(())), []
    camera = pose([2.0, 1.0, 0.0]) if vio is None else vio
    for row, target in enumerate(targets):
        time_s, reset = np.asarray(row * seconds), np.asarray(row in resets)
        state, eased = ease(PARAMS, state, time_s, target, camera, reset)
        shown.append(eased)
    return shown


def test_content_is_put_in_place_at_first_and_in_a_new_world():
    here, there = pose([1.0, 2.0, 3.0], [0, 0, 0.5]), pose([-9.0, 0.0, 0.0], [0, 0, 2.0])
    shown = follow([Rigid3.unknown(), here, here, there, there], resets=(3,))
    assert np.isnan(shown[0].display_from_vio.translation_m).all()
    assert [bool(one.is_placed_anew) for one in shown] == [False, True, False, True, False]
    for eased, wanted in zip(shown[1:], [here, here, there, there], strict=True):
        assert rigid.distance_m(eased.display_from_vio, wanted) < 1e-12
        assert eased.left_m < 1e-12


def test_corrections_take_time_and_end():
    start, end = pose([0.0, 0.0, 0.0]), pose([0.3, 0.0, 0.0])
    shown = follow([start] + [end] * 40)
    left = np.array([one.left_m for one in shown])
    # In the first step 0.1 s times 0.1 m/s and 60 % a second of 0.3 m.
    np.testing.assert_allclose(left[1], 0.3 - 0.1 * (0.1 + 0.6 * 0.3))
    assert (np.diff(left[1:]) <= 0).all()
    assert left[-1] == 0
    assert rigid.distance_m(shown[-1].display_from_vio, end) < 1e-9


def test_it_turns_about_the_camera():
    camera = pose([4.0, -2.0, 1.0])
    start = pose([1.0, 1.0, 1.0])
    turned = pose([0.0] * 3, [0.0, 0.0, 0.1]) @ start
    # The correction that leaves the camera's place in the world as it is.
    moved_m = start.apply(camera.translation_m) - turned.apply(camera.translation_m)
    end = Rigid3(turned.translation_m + moved_m, turned.quat_xyzw)
    for eased in follow([start] + [end] * 10, camera):
        place_m = eased.display_from_vio.apply(camera.translation_m)
        np.testing.assert_allclose(place_m, start.apply(camera.translation_m), atol=1e-12)


def test_what_is_unknown_for_a_while_leaves_content_where_it_is():
    here = pose([1.0, 0.0, 0.0])
    shown = follow([here, Rigid3.unknown(), Rigid3.unknown(), here])
    for eased in shown:
        assert rigid.distance_m(eased.display_from_vio, here) < 1e-12


def ordinary_walk(seed):
    """A camera at 20 Hz with predictions at 2 Hz, of a regressor of indoor accuracy."""
    regressor = RegressorErrors(bias_m=0.2, bias_deg=2.0, noise_m=0.1, noise_deg=1.0)
    return simulate_walk(WalkParams(duration_s=60, rate_hz=20, regressor=regressor), seed)


@pytest.mark.slow
def test_on_ordinary_walks_nothing_jumps_and_accuracy_stays():
    plain_m, eased_m = [], []
    for seed in range(4):
        walk, localizer, last = ordinary_walk(seed), Localizer(), None
        for row, time_s in enumerate(walk.gt.timestamp_s):
            gt, apr, vio = (
                track.target_from_source.at(row) for track in (walk.gt, walk.apr, walk.vio)
            )
            estimate = localizer.update(float(time_s), apr if row % 10 == 0 else None, vio)
            display = estimate.eased.display_from_vio
            if last is not None and not estimate.eased.is_placed_anew:
                for point in (vio.translation_m, vio.apply(CONTENT)):
                    assert np.linalg.norm(display.apply(point) - last.apply(point)) < 0.05
            last = display
            if row > 100:
                plain_m.append(float(rigid.distance_m(gt, estimate.world_from_cam)))
                eased_m.append(float(rigid.distance_m(gt, display @ vio)))
    assert np.median(eased_m) < 1.02 * np.median(plain_m)


def test_batches_and_backends_agree(rng):
    xp = pytest.importorskip("array_api_strict", reason="array-api-strict is not installed")
    count = 6

    def poses():
        return Rigid3(
            rng.normal(size=(count, 3)), quaternion.normalize(rng.normal(size=(count, 4)))
        )

    targets, cameras = [poses() for _ in range(5)], [poses() for _ in range(5)]

    def run(convert, rows):
        state = no_easing((count,) if rows is None else (), convert(np.zeros(())))
        for row, (target, camera) in enumerate(zip(targets, cameras, strict=True)):
            parts = [Rigid3(*(convert(p if rows is None else p[rows]) for p in one))
                     for one in (target, camera)]  # fmt: skip
            shape = (count,) if rows is None else ()
            time_s, reset = convert(np.full(shape, 0.1 * row)), convert(np.zeros(shape)) > 0
            state, eased = ease(PARAMS, state, time_s, *parts, reset)
        return np.asarray(eased.display_from_vio.translation_m)

    batch = run(np.asarray, None)
    np.testing.assert_allclose(run(xp.asarray, None), batch, atol=1e-12)
    np.testing.assert_allclose(run(np.asarray, 3), batch[3], atol=1e-12)


@pytest.mark.parametrize("name", ["least_m_s", "least_deg_s", "share_per_s"])
def test_speeds_that_are_none_are_refused(name):
    with pytest.raises(ParameterError, match=f"{name}: expected a number above 0, got 0"):
        EasingParams(**{name: 0.0})
