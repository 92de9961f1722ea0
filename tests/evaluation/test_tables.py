import csv
import io
import json

import numpy as np
import pytest
from tests.schemas.validators import validator

from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import count_ticks, evaluate_cases
from vioapr.evaluation.metrics import summarize
from vioapr.evaluation.tables import (
    CSV_COLUMNS,
    compare_methods,
    group_results,
    tabulate,
    to_csv,
    to_records,
)
from vioapr.fusion.apr import AprParams
from vioapr.fusion.methods import default_params, get_method
from vioapr.fusion.offline import fuse_walks
from vioapr.fusion.types import Status
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import convert, to_plain
from vioapr.schemas.results import GroupRecord

METHODS = ("apr", "vio", "vio-apr")


@pytest.fixture(scope="module")
def cases(walks_dir):
    return load_cases(find_walks([walks_dir]))


@pytest.fixture(scope="module")
def results(cases):
    return evaluate_cases(cases, {name: get_method(name).params_type() for name in METHODS})


@pytest.fixture(scope="module")
def groups(results):
    return group_results(results)


def test_a_result_for_every_method_and_case(cases, results):
    assert len(results) == len(METHODS) * len(cases)
    ticks = []
    params = {name: get_method(name).params_type() for name in METHODS}
    evaluate_cases(cases, params, tick=lambda: ticks.append(1))
    assert len(ticks) == count_ticks(cases, METHODS)


def test_groups_join_the_draws_of_an_odometry(groups):
    assert [(g.set_name, g.vio, g.apr, g.cases) for g in groups] == [
        ("SetA", "sim", "bad", 4), ("SetA", "sim", "good", 4),
        ("SetB", "sim", "bad", 2), ("SetB", "sim", "good", 2),
    ]  # fmt: skip


def test_rows_are_the_papers_subsets_and_all_frames(groups):
    rows = [(row.method, row.subset) for row in groups[1].rows]
    assert rows == [
        ("apr", "all frames"),
        ("vio", "all frames"),
        ("vio-apr", "only keyframes"),
        ("vio-apr", "only optimized"),
        ("vio-apr", "keyframes + optimized"),
        ("vio-apr", "all frames"),
    ]


def test_figures_are_means_over_walks(groups):
    group = groups[1]
    row = next(r for r in group.rows if r.subset == "only keyframes")
    summaries = [
        summarize(r.errors, r.status == Status.KEYFRAME)
        for r in group.results
        if r.method == "vio-apr"
    ]
    assert row.fused.median_m == pytest.approx(np.mean([s.median_m for s in summaries]))
    assert row.fused.share == pytest.approx(np.mean([s.share for s in summaries]))


def test_keyframes_equal_the_raw_regressor_on_the_same_frames(groups):
    row = next(r for r in groups[1].rows if r.subset == "only keyframes")
    np.testing.assert_allclose(row.fused, row.raw)


def test_raw_is_evaluated_on_the_same_frames(groups):
    for row in groups[1].rows:
        assert row.raw.share == pytest.approx(row.fused.share)
    everything = groups[1].rows[0]
    np.testing.assert_allclose(everything.fused, groups[1].raw)


def test_shares_of_keyframes_and_optimized_add_up(groups):
    shares = {row.subset: row.fused.share for row in groups[1].rows if row.method == "vio-apr"}
    assert shares["keyframes + optimized"] == pytest.approx(
        shares["only keyframes"] + shares["only optimized"]
    )
    assert shares["all frames"] >= shares["keyframes + optimized"]


def test_json_is_plain_and_complete(groups):
    data = json.loads(json.dumps(to_plain(to_records(groups)), allow_nan=False))
    assert data[1]["apr"] == "good"
    assert data[1]["rows"][2]["subset"] == "only keyframes"
    assert data[1]["rows"][2]["fused"]["median_m"] == groups[1].rows[2].fused.median_m
    walk = data[1]["walks"][0]
    assert walk["frames"] == sum(walk["statuses"].values())


def test_json_reads_as_the_records_it_was_written_from(groups):
    for record in to_records(groups):
        plain = to_plain(record)
        assert to_plain(convert("here", plain, GroupRecord)) == plain


def test_json_is_what_its_schema_accepts(groups):
    for record in to_records(groups):
        validator("group-record").validate(to_plain(record))


def test_reliability_is_a_row_a_method_of_means_over_walks(groups):
    rows = {row.method: row for row in groups[1].reliability}
    assert list(rows) == list(METHODS)
    own = [r.reliability for r in groups[1].results if r.method == "vio-apr"]
    figures = rows["vio-apr"].figures
    assert rows["vio-apr"].walks == len(own) == 4
    assert figures.jumps_per_min == pytest.approx(np.mean([r.jumps_per_min for r in own]))
    assert figures.largest_jump_m == max(r.largest_jump_m for r in own)
    assert figures.mean_m == pytest.approx(np.mean([r.mean_m for r in own]))
    # Raw predictions move the map at every frame, odometry that is placed once never.
    assert rows["apr"].figures.jumps_per_min > 60
    assert rows["vio"].figures.largest_jump_m < 1e-9
    data = to_plain(to_records(groups))[1]
    row = data["reliability"][2]
    assert row["figures"]["largest_jump_m"] == figures.largest_jump_m
    assert row["figures"]["risk_area_m"] is None  # vio-apr states no sigmas
    assert data["walks"][-1]["reliability"]["mean_m"] == own[-1].mean_m


def test_content_jumps_are_those_of_the_live_view(cases):
    params = {"vio-apr": get_method("vio-apr").params_type()}
    live, later = (evaluate_cases(cases[:1], params, view=v)[0] for v in ("live", "retrospective"))
    assert (live.status != later.status).any()
    np.testing.assert_array_equal(live.content.step_m, later.content.step_m)


def test_a_method_with_sigmas_has_risk_figures(cases):
    (result,) = evaluate_cases(cases[:1], default_params(["chain"]))
    found = result.reliability
    assert np.isfinite(found).all()
    assert found.risk_50_m <= np.nanmax(result.errors.position_m)
    rows = list(csv.DictReader(io.StringIO(to_csv([result]))))
    assert float(rows[5]["sigma_position_m"]) == result.sigma_position_m[5]
    assert float(rows[5]["content_step_m"]) == result.content.step_m[5]
    assert rows[0]["content_step_m"] == "nan"


def test_one_call_fuses_and_groups(cases, results, groups):
    found = tabulate(cases, default_params(METHODS))
    assert [result.method for result in found.results] == [result.method for result in results]
    assert to_plain(to_records(found.groups)) == to_plain(to_records(groups))


@pytest.mark.slow
def test_a_localizers_walk_stands_among_the_methods_it_is_compared_with(cases):
    case = cases[0]
    fused = fuse_walks(get_method("apr"), AprParams(), [case.frames], view="live")[0]
    ticks = []
    (own,) = compare_methods(case, "mine", fused, tick=lambda: ticks.append(1))
    others = ("apr", "vio", "vio-apr", "chain")
    assert [result.method for result in own.results] == [*others, "mine"]
    np.testing.assert_array_equal(own.results[-1].errors, own.results[0].errors)
    assert len(ticks) == count_ticks([case], others)
    (replaced,) = compare_methods(case, "vio", fused)
    assert [result.method for result in replaced.results] == list(others)
    np.testing.assert_array_equal(replaced.results[1].errors, own.results[0].errors)


def test_csv_has_a_row_a_frame(results):
    rows = list(csv.DictReader(io.StringIO(to_csv(results))))
    assert ",".join(rows[0]) == CSV_COLUMNS
    assert len(rows) == sum(len(r.status) for r in results)
    fused = [r for r in rows if r["method"] == "vio-apr" and r["status"] == "unlocalized"]
    assert fused
    assert all(r["x"] == "nan" and r["position_error_m"] == "nan" for r in fused)
    assert rows[0]["set"] == "SetA"
    assert rows[0]["vio"] == "sim0"
    assert float(rows[0]["position_error_m"]) == results[0].errors.position_m[0]
