"""Clock offsets are found by turns, whatever the devices' axes, and none where there is none."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.trajectory.clock_offset import find_clock_offset

TURN = Rigid3(np.zeros(3), quaternion.from_rotvec(np.array([1.0, 0.3, -0.8])))
GOOD = RegressorErrors(0.2, 1.0, 0.05, 0.3, 0.02)


def shifted(track, seconds):
    return replace(track, timestamp_s=track.timestamp_s + seconds)


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=120, rate_hz=10, regressor=GOOD), seed=2)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [-0.4, 2.0, -13.7, 1.7e9])
def test_an_offset_is_found(walk, seconds):
    found = find_clock_offset(walk.apr, shifted(walk.vio, seconds))
    assert found is not None
    assert found.offset_s == pytest.approx(seconds, abs=0.06)
    assert found.sigma_s < 0.05


@pytest.mark.parametrize("seconds", [0.15, -0.15])
def test_a_short_offset_is_found_between_smooth_tracks(walk, seconds):
    found = find_clock_offset(walk.gt, shifted(walk.vio, seconds))
    assert found is not None
    assert found.offset_s == pytest.approx(seconds, abs=0.02)


def test_a_rotated_device_does_not_matter(walk):
    body = walk.vio.with_transforms(walk.vio.target_from_source @ TURN)
    found = find_clock_offset(walk.apr, shifted(body, 3.0))
    assert found is not None
    assert found.offset_s == pytest.approx(3.0, abs=0.06)


def test_different_rates(walk):
    sparse = walk.apr.at_rows(np.arange(0, len(walk.apr), 5))
    found = find_clock_offset(sparse, shifted(walk.vio, 1.3))
    assert found is not None
    assert found.offset_s == pytest.approx(1.3, abs=0.1)


def test_the_other_way_round_the_sign_turns(walk):
    found = find_clock_offset(shifted(walk.vio, 2.0), walk.apr)
    assert found is not None
    assert found.offset_s == pytest.approx(-2.0, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("errors", [GOOD, RegressorErrors(), RegressorErrors(2, 6, 0.5, 3, 0.1)])
def test_one_clock_gives_none(seed, errors):
    walk = simulate_walk(WalkParams(duration_s=90, rate_hz=4, regressor=errors), seed)
    assert find_clock_offset(walk.apr, walk.vio) is None


def test_other_walks_still_and_short_ones_give_none(walk):
    other = simulate_walk(WalkParams(duration_s=120, rate_hz=10), seed=77)
    assert find_clock_offset(walk.apr, other.vio) is None
    still = replace(walk.vio, quat_xyzw=np.tile(walk.vio.quat_xyzw[:1], (len(walk.vio), 1)))
    assert find_clock_offset(walk.apr, still) is None
    assert find_clock_offset(walk.apr.at_rows(slice(0, 50)), walk.vio) is None
    assert find_clock_offset(replace(walk.apr, is_timed=False), walk.vio) is None


@pytest.mark.parametrize("factor", [1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9])
def test_times_in_a_wrong_unit_take_no_more_memory(factor, walk):
    scaled = [
        replace(track, timestamp_s=track.timestamp_s * factor) for track in (walk.apr, walk.vio)
    ]
    tracemalloc.start()
    for tracks in (scaled, (scaled[0], walk.vio), (walk.apr, scaled[1])):
        find_clock_offset(*tracks)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 200e6


def test_a_track_of_kilohertz_takes_no_more_memory():
    walk = simulate_walk(WalkParams(duration_s=60, rate_hz=2, regressor=GOOD), seed=2)
    times = np.arange(walk.vio.timestamp_s[0], walk.vio.timestamp_s[-1], 1e-3)
    fast = walk.vio.interpolate(times)
    tracemalloc.start()
    find_clock_offset(fast, shifted(fast, 0.0))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 300e6
