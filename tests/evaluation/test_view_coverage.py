"""Where a place was looked at from, where not, and what a test image finds from near."""

import numpy as np
import pytest

from vioapr.evaluation.view_coverage import (
    SECTORS,
    Views,
    count_support,
    find_gaps,
    measure_coverage,
    sector_of,
    views_of,
)
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3

LEVEL_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
"""world_from_cam of a level camera that looks along the world's x axis."""


def line(start, end, heading_deg, count=60):
    position_m = np.linspace(start, end, count)
    return Views(position_m.astype(float), np.full(count, np.radians(heading_deg)))


def test_headings_are_counterclockwise_from_x_and_steep_looks_have_none():
    turn = quaternion.from_rotvec(np.array([[0, 0, np.pi / 2], [0, 0, 0], [0, np.pi / 2, 0]]))
    quat = quaternion.multiply(turn, np.tile(LEVEL_XYZW, (3, 1)))
    position_m = np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9]])
    views = views_of(Rigid3(position_m, quat))
    assert views.position_m == pytest.approx(position_m[:, :2])
    assert views.heading_rad[:2] == pytest.approx([np.pi / 2, 0], abs=1e-9)
    assert np.isnan(views.heading_rad[2])  # straight down


@pytest.mark.parametrize(("deg", "sector"), [(0, 0), (22, 0), (23, 1), (180, 4), (-45, 7)])
def test_sectors(deg, sector):
    assert sector_of(np.radians(np.array([float(deg)]))).tolist() == [sector]


def test_a_way_walked_once_is_seen_one_way():
    coverage = measure_coverage([line((0, 0), (16, 0), 0)])
    assert coverage.cell_m == pytest.approx(1.0)
    assert len(coverage.cell) == 17
    assert coverage.one_way == 1
    assert coverage.all_round == 0
    assert coverage.one_walk == 1
    seen = coverage.is_seen.any(axis=0)
    assert np.flatnonzero(seen).tolist() == [0, 1, SECTORS - 1]  # ahead, and half to each side


def test_the_way_back_by_another_recording_is_the_opposite_direction():
    there, back = line((0, 0), (16, 0), 0), line((16, 0), (0, 0), 180)
    coverage = measure_coverage([there, back])
    assert coverage.one_way < 0.1  # the cell at the end, where one just arrives
    assert coverage.one_walk == 1
    assert measure_coverage([there, there]).one_walk < 0.1


def test_looking_all_round_covers_all_directions():
    headings = np.radians(np.repeat(np.arange(0, 360, 15.0), 4))
    turning = Views(np.zeros((len(headings), 2)) + 0.1, headings)
    coverage = measure_coverage([turning])
    assert coverage.all_round == 1
    assert find_gaps(coverage) == []


def test_looks_up_and_down_count_for_no_direction():
    steep = Views(np.zeros((50, 2)), np.full(50, np.nan))
    assert not measure_coverage([steep, line((0, 0), (1, 0), 0, 2)]).is_seen.any()


def test_gaps_are_first_where_others_looked_in_vain():
    there = line((0, 0), (24, 0), 0, 240)
    asking = line((18, 0), (22, 0), 90, 20)
    first, *others = find_gaps(measure_coverage([there], [asking]))
    assert first.asked > 0
    assert 2 in first.sectors  # they looked along y
    assert abs(first.position_m[0] - 20) < 3
    assert abs(first.position_m[1]) < 1.5
    assert sum(gap.asked for gap in (first, *others)) == 20
    assert others  # what nobody asked for is a gap too, as it was seen one way only
    answered = find_gaps(measure_coverage([there, asking], [asking]))
    assert all(gap.asked < 5 for gap in answered)


def test_all_of_a_small_place_is_no_gap():
    assert find_gaps(measure_coverage([line((0, 0), (1.2, 0.8), 0)])) == []


def test_support_counts_images_from_near_that_look_the_same_way():
    train = [line((0, 0), (10, 0), 0, 101), line((0, 0), (10, 0), 180, 101)]
    asked = Views(
        np.array([[5.0, 0.0], [5.0, 0.0], [5.0, 4.0], [5.0, 0.0]]),
        np.radians(np.array([10.0, 90.0, 0.0, np.nan])),
    )
    assert count_support(train, asked, 0.55).tolist() == [11, 0, 0, 0]
