"""The tables' figures against numbers that can be worked out by hand."""

import numpy as np
import pytest

from vioapr.evaluation.metrics import PoseErrors
from vioapr.fusion.types import Status
from vioapr.recipes.comparison import AVERAGE, compare, compare_references
from vioapr.recipes.datasets import DATA_SETS
from vioapr.recipes.pooling import PooledErrors
from vioapr.recipes.report import comparison_table, format_figures, reference_table
from vioapr.schemas.reproduction import Pair, PublishedPair

GROUPS = DATA_SETS["marvin"].groups
NAN = float("nan")


def five_frames(offset_m: float = 0.0) -> PooledErrors:
    """Two keyframes, two optimized frames, one without a pose of VIO-APR."""
    raw = PoseErrors(
        np.array([0.1, 0.3, 6.0, 8.0, 1.0]) + offset_m, np.array([1.0, 3.0, 20.0, 40.0, 9.0])
    )
    vio_apr = PoseErrors(
        np.array([0.1, 0.3, 0.4, 0.6, NAN]) + offset_m, np.array([1.0, 3.0, 2.0, 4.0, NAN])
    )
    chain = PoseErrors(np.full(5, 0.2) + offset_m, np.full(5, 1.5))
    states = [Status.KEYFRAME] * 2 + [Status.OPTIMIZED] * 2
    status = {
        "vio-apr": np.array([*states, Status.UNLOCALIZED]),
        "chain": np.array([*states, Status.TRACKED]),
    }
    return PooledErrors(raw, {"vio-apr": vio_apr, "chain": chain}, status)


@pytest.fixture
def lines():
    comparisons = compare({("posenet", "Square"): five_frames()}, GROUPS, ["posenet"])
    assert [(c.number, c.kind, c.model) for c in comparisons] == [
        (2, "median", "posenet"),
        (4, "levels", "posenet"),
    ]
    return {
        (c.number, line.subset, line.method, line.scene): line
        for c in comparisons
        for line in c.lines
    }


def test_medians_of_keyframes(lines):
    line = lines[2, "only keyframes", "vio-apr", "Square"]
    # The regressor's column is over all five frames, as in the paper.
    assert line.raw.ours == pytest.approx((1.0, 9.0))
    assert line.raw.paper == (1.11, 3.61)
    assert line.fused.ours == pytest.approx((0.2, 2.0))
    assert line.fused.difference == pytest.approx((0.2 - 0.68, 2.0 - 2.75))
    assert line.share.ours == pytest.approx((40.0,))
    assert line.raw_same == pytest.approx((0.2, 2.0))


def test_medians_of_optimized_frames_are_beside_the_regressors_on_the_same(lines):
    line = lines[2, "only optimized", "vio-apr", "Square"]
    assert line.raw.ours == pytest.approx((7.0, 30.0))
    assert line.raw.paper == (1.08, 3.69)
    assert line.fused.ours == pytest.approx((0.5, 3.0))


def test_medians_of_both(lines):
    line = lines[2, "keyframes + optimized", "vio-apr", "Square"]
    assert line.raw.ours == pytest.approx((1.0, 9.0))
    assert line.fused.ours == pytest.approx((0.35, 2.5))
    assert line.raw_same == pytest.approx((3.15, 11.5))
    assert line.share.ours == pytest.approx((80.0,))


def test_levels_are_of_the_counted_frames(lines):
    keyframes = lines[4, "only keyframes", "vio-apr", "Square"]
    # Of the five: one within 0.25 m, 2 deg; two within 0.5 m, 5 deg; three within 5 m, 10 deg.
    assert keyframes.raw.ours == pytest.approx((20, 40, 60))
    assert keyframes.fused.ours == pytest.approx((50, 100, 100))
    assert (keyframes.share.ours, keyframes.share.paper) == (pytest.approx((40,)), (30.3,))
    optimized = lines[4, "only optimized", "vio-apr", "Square"]
    assert optimized.raw.ours == pytest.approx((0, 0, 0))
    assert optimized.fused.ours == pytest.approx((0, 50, 100))
    assert optimized.fused.difference == pytest.approx((-1.3, 50 - 28.3, 100 - 95.5))


def test_chain_is_over_all_frames(lines):
    line = lines[2, "all frames", "chain", "Square"]
    assert line.fused == Pair(pytest.approx((0.2, 1.5)), None)
    assert line.share.ours == pytest.approx((100.0,))
    assert line.raw.ours == line.raw_same == pytest.approx((1.0, 9.0))
    assert lines[2, "all frames", "vio-apr", "Square"].share.ours == pytest.approx((80.0,))


def test_missing_scenes_are_in_the_tables_and_spoil_the_average(lines):
    bar = lines[2, "only keyframes", "vio-apr", "Bar"]
    assert (bar.raw, bar.share.ours) == (Pair(None, (0.66, 2.82)), None)
    average = lines[2, "only keyframes", "vio-apr", AVERAGE]
    assert average.raw == Pair(None, (0.83, 3.47))


def test_the_average_is_the_mean_over_scenes():
    pooled = {
        ("posenet", scene): five_frames(offset_m)
        for scene, offset_m in (("Stairs", 0.0), ("Office", 0.3), ("Atrium", 0.6))
    }
    table, _ = compare(pooled, GROUPS, ["posenet", "ms-transformer"])
    assert table.number == 3
    average = next(line for line in table.lines if line.scene == AVERAGE)
    assert average.raw.ours == pytest.approx((1.3, 9.0))
    assert average.fused.ours == pytest.approx((0.5, 2.0))
    assert average.fused.paper == (0.56, 4.54)


def test_a_subset_of_no_frame_has_no_figures():
    errors = five_frames()
    errors.status["vio-apr"][:] = Status.UNLOCALIZED
    table, _ = compare({("posenet", "Square"): errors}, GROUPS, ["posenet"])
    line = table.lines[0]
    assert (line.fused.ours, line.fused.difference, line.raw_same) == (None, None, None)
    assert line.share.ours == (0.0,)


def test_text_of_a_table():
    table, levels = compare({("posenet", "Square"): five_frames()}, GROUPS, ["posenet"])
    text = comparison_table(table)
    assert text.title == "Table 2, outdoor scenes, PN: median m / deg"
    assert text.sections[0][0] == (
        "keyframes", "Square", "1.00 / 9.00", "1.11 / 3.61", "-0.11 / +5.39",
        "0.20 / 2.00", "0.68 / 2.75", "-0.48 / -0.75", "40.0", "0.20 / 2.00",
    )  # fmt: skip
    assert [section[0][0] for section in text.sections] == [
        "keyframes", "optimized", "both", "all: vio-apr", "all: chain",
    ]  # fmt: skip
    row = comparison_table(levels).sections[0][0]
    assert row[2:5] == ("20.0/40.0/60.0", "3.2/18.4/87.0", "+16.8/+21.6/-27.0")
    assert row[8:] == ("40.0", "30.3", "50.0/100.0/100.0")
    assert all(len(row) == len(text.header) for part in text.sections for row in part)


def test_references_beside_raw_medians():
    pooled = {("posenet", "chess"): five_frames()}
    scenes = DATA_SETS["7scenes"].scenes
    lines = compare_references("7scenes", scenes, ["posenet"], pooled)
    assert [line.scene for line in lines] == list(scenes)
    assert lines[0].medians["posenet"] == PublishedPair(pytest.approx((1.0, 9.0)), (0.104, 4.02))
    assert lines[0].dfnet == (0.033, 1.12)
    assert (lines[2].medians["posenet"], lines[2].dfnet) == (PublishedPair(None, None), None)
    (rows,) = reference_table("7-Scenes", lines, ["posenet"]).sections
    assert rows[0] == ("chess", "1.000 / 9.00", "0.104 / 4.02", "+0.896 / +4.98", "0.033 / 1.12")
    assert rows[2] == ("heads", "–", "–", "–", "–")


def test_formats():
    assert format_figures((2.0, 3.98), "median") == "2.00 / 3.98"
    assert format_figures((25.0, 0.0, 100.0), "levels") == "25.0/0.0/100.0"
    assert format_figures(None, "median") == "–"
