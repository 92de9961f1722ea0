import numpy as np
from tests.helpers import random_rigid

from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.outliers import find_breaks, find_misplaced, with_bad_worlds
from vioapr.mapping.vio_interpolation import interpolate_by_vio
from vioapr.scene.frames import Frames, Intrinsics, Tracking

NO_CAMERA = Intrinsics(*(np.full(20, np.nan) for _ in range(6)))


def smooth(count=20):
    positions = np.column_stack([0.1 * np.arange(count), np.zeros((count, 2))])
    half = np.radians(2) * np.arange(count) / 2
    quats = np.column_stack([np.zeros((count, 2)), np.sin(half), np.cos(half)])
    return Rigid3(positions, quats)


def recorded(vio, tracking=None):
    states = np.full(20, Tracking.NORMAL) if tracking is None else np.array(tracking)
    return Frames(
        np.arange(20) / 4, ("",) * 20, states.astype(np.uint8), vio, NO_CAMERA, np.arange(20)
    )


def test_frames_between_are_carried_exactly(rng):
    vio = smooth()
    world = random_rigid(rng) @ vio
    mapped = np.array([0, 4, 8, 18])
    rows, poses = interpolate_by_vio(recorded(vio), mapped, world.at(mapped))
    assert rows.tolist() == [1, 2, 3, 5, 6, 7]  # the last gap is 2.5 s long
    assert rigid.distance_m(poses, world.at(rows)).max() < 1e-9
    assert rigid.angle_deg(poses, world.at(rows)).max() < 1e-4


def test_nothing_is_carried_over_a_jump_a_loss_or_a_new_world(rng):
    vio = smooth()
    world = random_rigid(rng) @ vio
    mapped = np.array([0, 4, 8, 12])
    jumped = Rigid3(vio.translation_m.copy(), vio.quat_xyzw)
    jumped.translation_m[6:] += [0.2, 0.0, 0.0]
    rows, _ = interpolate_by_vio(recorded(jumped), mapped, world.at(mapped))
    assert rows.tolist() == [1, 2, 3, 9, 10, 11]
    for state in (Tracking.RESET, Tracking.LOST):
        states = [Tracking.NORMAL] * 20
        states[6] = state
        poses = Rigid3(vio.translation_m.copy(), vio.quat_xyzw.copy())
        if state == Tracking.LOST:
            poses.translation_m[6], poses.quat_xyzw[6] = np.nan, np.nan
        rows, _ = interpolate_by_vio(recorded(poses, states), mapped, world.at(mapped))
        assert rows.tolist() == [1, 2, 3, 9, 10, 11]


def test_too_few_mapped_frames_carry_nothing():
    rows, poses = interpolate_by_vio(recorded(smooth()), np.array([3]), smooth().at(slice(3, 4)))
    assert len(rows) == len(poses.translation_m) == 0


def test_breaks_and_lone_images():
    vio = smooth()
    world = Rigid3(vio.translation_m.copy(), vio.quat_xyzw)
    world.translation_m[5] += [0.0, 4.0, 0.0]  # alone in a wrong place
    world.translation_m[12:] += [0.0, 3.0, 0.0]  # all that follow: as well a jump of VIO
    times, same = np.arange(20) / 4, np.zeros(20, dtype=int)
    breaks = find_breaks(world, vio, same, times)
    assert np.flatnonzero(breaks).tolist() == [4, 5, 11]
    assert find_misplaced(breaks).tolist() == [5]
    apart = same + (np.arange(20) >= 12)
    assert np.flatnonzero(find_breaks(world, vio, apart, times)).tolist() == [4, 5]
    assert not find_breaks(world, vio, same, times * 100).any()
    assert find_misplaced(breaks[:0]).tolist() == []
    missing = Rigid3(np.full((20, 3), np.nan), vio.quat_xyzw)
    assert not find_breaks(world, missing, same, times).any()


def test_a_world_with_many_misplaced_images_is_not_trusted():
    world = np.repeat([0, 1], 10)
    is_misplaced = np.isin(np.arange(20), [0, 3, 5, 12])
    found = with_bad_worlds(is_misplaced, world)
    assert np.flatnonzero(found).tolist() == [*range(10), 12]
