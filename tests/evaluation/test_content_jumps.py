"""Steps of content, by hand: where it stood by the last world_from_vio, and where it stands now."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vioapr.evaluation.content_jumps import AHEAD_M, JUMP_M, ContentSteps, content_steps
from vioapr.fusion.types import FrameInput
from vioapr.geometry.rigid import Rigid3

NAN = float("nan")


def poses(positions, turns_deg=None, axis="z"):
    """World or vio poses; an unknown one for None."""
    known = [[NAN] * 3 if p is None else p for p in positions]
    turns = np.zeros(len(known)) if turns_deg is None else np.array(turns_deg, dtype=float)
    quats = Rotation.from_euler(axis, turns[:, None], degrees=True).as_quat()
    quats[np.isnan(np.array(known)[:, 0])] = np.nan
    return Rigid3(np.array(known, dtype=float), quats)


def frames_of(vio, times=None, lost=(), reset=()):
    row = np.arange(vio.batch_shape[0])
    times = row / 2.0 if times is None else np.array(times)
    nothing = np.zeros(len(row), dtype=bool)
    return FrameInput(
        times, vio, nothing, vio, ~np.isin(row, lost), np.isin(row, reset)
    )  # fmt: skip


def still(count):
    return poses([(0, 0, 0)] * count)


def test_content_stays_while_the_map_does_however_the_camera_moves():
    vio = poses([(0, 0, 0), (5, 0, 0), (5, 9, 2)], [0, 90, 170])
    steps = content_steps(frames_of(vio), poses([(1, 2, 3)] * 3, [30] * 3))
    np.testing.assert_allclose(steps.step_m, [NAN, 0, 0], atol=1e-12)
    assert steps.largest_m == pytest.approx(0, abs=1e-12)
    assert steps.jumps_per_min == 0


def test_a_shift_moves_both_places_alike():
    steps = content_steps(frames_of(still(3)), poses([(0, 0, 0), (0.3, 0.4, 0), (0.3, 0.4, 0)]))
    np.testing.assert_allclose(steps.step_m, [NAN, 0.5, 0])


def test_a_turn_about_the_camera_shows_three_metres_ahead():
    # The camera looks along z of its axes; a turn about y by 2 deg swings what is ahead.
    steps = content_steps(frames_of(still(2)), poses([(0, 0, 0)] * 2, [0, 2], "y"))
    chord = 2 * AHEAD_M * np.sin(np.deg2rad(1))
    np.testing.assert_allclose(steps.step_m, [NAN, chord])
    # A turn about the optical axis moves neither place.
    steps = content_steps(frames_of(still(2)), poses([(0, 0, 0)] * 2, [0, 40], "z"))
    np.testing.assert_allclose(steps.step_m, [NAN, 0], atol=1e-12)


def test_a_turn_far_from_the_tracking_origin_moves_the_camera():
    # 10 m from the origin, and looking away from it: ahead is 13 m away.
    vio = poses([(0, 0, 10)] * 2)
    steps = content_steps(frames_of(vio), poses([(0, 0, 0)] * 2, [0, 2], "y"))
    np.testing.assert_allclose(steps.step_m, [NAN, 2 * 13 * np.sin(np.deg2rad(1))])
    # Looking back at it, the farther place is the camera.
    back = Rigid3(vio.translation_m, Rotation.from_euler("y", [[180], [180]], True).as_quat())
    steps = content_steps(frames_of(back), poses([(0, 0, 0)] * 2, [0, 2], "y"))
    np.testing.assert_allclose(steps.step_m, [NAN, 2 * 10 * np.sin(np.deg2rad(1))])


def test_jumps_are_above_five_centimetres_and_counted_by_the_minute():
    shifts = np.cumsum([0, 0.049, 0.051, 0.049, 0.2, 0])
    steps = content_steps(frames_of(still(6)), poses([(x, 0, 0) for x in shifts]))
    assert JUMP_M == 0.05
    assert steps.shown_s == 2.5  # 5 steps of half a second
    assert steps.jumps_per_min == pytest.approx(2 * 60 / 2.5)
    assert steps.largest_m == pytest.approx(0.2)


def test_while_it_is_unknown_where_the_map_lies_content_stays():
    places = [None, (0, 0, 0), None, None, (1, 0, 0)]
    steps = content_steps(frames_of(still(5)), poses(places))
    np.testing.assert_allclose(steps.step_m, [NAN, NAN, 0, 0, 1])
    assert steps.shown_s == 1.5


@pytest.mark.parametrize("how", ["lost", "reset"])
def test_a_new_tracking_world_is_no_jump(how):
    places = [(0, 0, 0), (0, 0, 0), (50, 0, 0), (50, 0, 0), (50.5, 0, 0)]
    steps = content_steps(frames_of(still(5), **{how: [2]}), poses(places))
    after = [NAN, NAN] if how == "lost" else [NAN, 0]
    np.testing.assert_allclose(steps.step_m, [NAN, 0, *after, 0.5])
    assert steps.shown_s == (1.0 if how == "lost" else 1.5)


def test_what_was_known_before_a_loss_is_not_compared_later():
    places = [(0, 0, 0), None, None, (9, 0, 0), (9, 0, 0)]
    steps = content_steps(frames_of(still(5), lost=[1]), poses(places))
    np.testing.assert_allclose(steps.step_m, [NAN, NAN, NAN, NAN, 0])


def test_without_a_clock_there_is_no_rate():
    places = poses([(0, 0, 0), (1, 0, 0)])
    steps = content_steps(frames_of(still(2)), places, has_clock=False)
    assert steps.largest_m == 1
    assert np.isnan(steps.jumps_per_min)


def test_nothing_shown_has_no_figures():
    for steps in (
        content_steps(frames_of(still(3)), poses([None] * 3)),
        content_steps(frames_of(still(1)), poses([(0, 0, 0)])),
        ContentSteps(np.zeros(0), 0.0),
    ):
        assert np.isnan(steps.largest_m)
        assert np.isnan(steps.jumps_per_min)
