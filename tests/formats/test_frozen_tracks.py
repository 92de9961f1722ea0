"""Tracks that stand still while others move, or that end before they begin, are named."""

from dataclasses import replace

import numpy as np
import pytest

from vioapr.formats.frozen_tracks import check_count, check_frozen
from vioapr.formats.pair_checks import Track
from vioapr.formats.walk_checks import check_walk
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.trajectory import Trajectory


@pytest.fixture(scope="module")
def walk():
    return simulate_walk(WalkParams(duration_s=60, rate_hz=4), seed=5)


def tracks(apr, vio, gt=None):
    given = Track("apr.tum", "apr", apr), Track("vio.tum", "vio", vio)
    return ([given[0]], [given[1]], None if gt is None else Track("gt.tum", "gt", gt))


def kinds(*given):
    return [warning.kind for warning in check_walk(*tracks(*given))]


def freeze(track, first, last=None, *, turns=False):
    """The pose of a row repeated, maybe with the rotations as they were."""
    rows = np.arange(len(track))
    rows[first:last] = first
    quats = track.quat_xyzw if turns else track.quat_xyzw[rows]
    return replace(track, position_m=track.position_m[rows], quat_xyzw=quats)


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize(("first", "last"), [(0, None), (80, None), (0, 100), (60, 160)])
def test_a_frozen_tracker_is_named(first, last, turns, walk):
    vio = freeze(walk.vio, first, last, turns=turns)
    (warning,) = check_walk(*tracks(walk.apr, vio))
    count = (last or len(vio)) - first
    assert str(warning).startswith(
        f"vio.tum stays at one position in {count} of 240 poses from {vio.timestamp_s[first]:.3f} s"
    )
    assert "was tracking lost? Leave these rows out" in str(warning)
    assert kinds(walk.apr, vio, walk.gt) == ["frozen"]


def test_a_regressor_that_always_says_the_same_is_named(walk):
    (warning,) = check_walk(*tracks(freeze(walk.apr, 0), walk.vio))
    assert str(warning).startswith("apr.tum stays at one position in 240 of 240 poses")
    assert "give poses that follow the camera" in str(warning)


def test_a_tracker_that_trembles_only_is_frozen_too(walk, rng):
    noise = rng.normal(0, 1e-4, walk.vio.position_m.shape)
    assert kinds(walk.apr, replace(walk.vio, position_m=noise)) == ["frozen"]


def test_kilometres_are_a_matter_of_scale(walk):
    assert "frozen" not in kinds(walk.apr, replace(walk.vio, position_m=walk.vio.position_m / 1e3))


def test_images_instead_of_times(walk):
    names = tuple(f"{row}.jpg" for row in range(len(walk.vio)))
    apr, vio = (
        replace(track, timestamp_s=np.arange(240.0), names=names, is_timed=False)
        for track in (walk.apr, freeze(walk.vio, 100))
    )
    (warning,) = check_walk(*tracks(apr, vio))
    assert str(warning).startswith("vio.tum stays at one position in 140 of 240 poses, while")


@pytest.mark.parametrize("noise_m", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_camera_that_rests_is_not_frozen(seed, noise_m, walk):
    rng = np.random.default_rng(seed)
    seen = walk.gt.position_m[0] + rng.normal(0, noise_m, walk.gt.position_m.shape)
    seen[rng.random(len(seen)) < 0.1] += 20  # taken for another place
    apr, vio = replace(walk.apr, position_m=seen), freeze(walk.vio, 0)
    assert check_frozen(Track("vio", "vio", vio), Track("apr", "apr", apr)) is None


def test_a_short_rest_is_none(walk):
    assert "frozen" not in kinds(walk.apr, freeze(walk.vio, 100, 104))


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_track_of_hardly_any_poses_is_named(count, walk):
    few = walk.vio.at_rows(np.arange(count))
    (warning,) = check_walk(*tracks(walk.apr, few))
    assert str(warning) == (
        f"vio.tum has {count} {'pose' if count == 1 else 'poses'} only: is it the right file, and "
        "whole? A walk has at least 5"
    )
    assert kinds(walk.apr.at_rows(np.arange(count)), walk.vio) == ["few"]
    assert kinds(walk.apr, walk.vio, walk.gt.at_rows(np.arange(count))) == ["few"]
    assert check_count(Track("vio", "vio", walk.vio.at_rows(np.arange(5)))) is None


def test_one_frozen_track_hides_nothing_of_the_others(walk):
    aprs = [Track("a.tum", "apr", walk.apr), Track("b.tum", "apr", freeze(walk.apr, 0))]
    wrong = replace(walk.vio, position_m=walk.vio.position_m * 100)
    found = check_walk(aprs, [Track("vio.tum", "vio", wrong)])
    assert [warning.kind for warning in found] == ["frozen", "scale"]


def test_right_walks_give_no_warning(walk):
    assert kinds(walk.apr, walk.vio) == []
    assert kinds(walk.apr, walk.vio, walk.gt) == []
    still = Trajectory.from_arrays(
        np.arange(9.0), np.zeros((9, 3)), np.tile([0, 0, 0, 1.0], (9, 1))
    )
    assert check_frozen(Track("a", "vio", still), Track("b", "gt", still)) is None
