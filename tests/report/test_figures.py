import dataclasses
import re

import numpy as np
import pytest

from vioapr.errors import UnwritableError
from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.evaluate import evaluate_cases
from vioapr.evaluation.metrics import PoseErrors, Summary
from vioapr.evaluation.tables import group_results
from vioapr.fusion.methods import get_method
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.report import figures
from vioapr.report.formatting import format_error, format_levels, format_median, format_share
from vioapr.report.style import MAX_POINTS, method_colors, render, thin
from vioapr.scene.walks import find_walks
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow

METHODS = ("apr", "vio", "vio-apr")


def evaluated(cases, methods=METHODS):
    return evaluate_cases(cases, {name: get_method(name).params_type() for name in methods})


def simulated_case(seed=0, duration_s=60.0, **names):
    walk = simulate_walk(WalkParams(duration_s=duration_s), seed)
    frames = pair_frames(walk.apr, walk.vio, 0.01)
    labels = {"set_name": "set", "walk": f"walk{seed}", "vio": "sim0", "apr": "net"} | names
    return Case(**labels, frames=frames, gt_world_from_cam=walk.gt.target_from_source)


def with_errors(result, position_m, status=None):
    """A result with given errors, NaN where there is no pose."""
    position_m = np.asarray(position_m, dtype=float)
    is_known = np.isfinite(position_m)[:, None]
    poses = Rigid3(*(np.where(is_known, part, np.nan) for part in result.world_from_cam))
    if status is None:
        status = np.where(is_known[:, 0], Status.TRACKED, Status.UNLOCALIZED)
    return dataclasses.replace(
        result, world_from_cam=poses, errors=PoseErrors(position_m, 10 * position_m), status=status
    )


def one_frame(result):
    first = slice(0, 1)
    case = dataclasses.replace(
        result.case,
        frames=dataclasses.replace(
            result.case.frames, inputs=result.case.frames.inputs.at(first), names=None
        ),
        gt_world_from_cam=result.case.gt_world_from_cam.at(first),
    )
    return dataclasses.replace(
        result,
        case=case,
        timestamp_s=result.timestamp_s[first],
        gt_world_from_cam=result.gt_world_from_cam.at(first),
        world_from_cam=result.world_from_cam.at(first),
        status=result.status[first],
        errors=result.errors.at(first),
        raw_errors=result.raw_errors.at(first),
    )


def lines(axis):
    """A label's line: its x and y values."""
    return {line.get_label(): (line.get_xdata(), line.get_ydata()) for line in axis.get_lines()}


def legend_of(axis):
    return [text.get_text() for text in axis.get_legend().get_texts()]


@pytest.fixture(scope="module")
def results():
    return evaluated([simulated_case()])


@pytest.fixture(scope="module")
def groups(walks_dir):
    return group_results(evaluated(load_cases(find_walks([walks_dir]))))[:2]


@pytest.fixture(scope="module")
def saved(groups, tmp_path_factory):
    return figures.save_figures(groups, tmp_path_factory.mktemp("report"))


def test_drift_plots_the_results_own_errors(results):
    axes = figures.drift_figure(results).axes
    for axis, name in zip(axes, PoseErrors._fields, strict=True):
        drawn = lines(axis)
        times, raw = drawn["raw net"]
        np.testing.assert_array_equal(raw, getattr(results[0].raw_errors, name))
        np.testing.assert_array_equal(times, results[0].timestamp_s - results[0].timestamp_s[0])
        for result in results[1:]:
            np.testing.assert_array_equal(
                drawn[result.method][1], getattr(result.errors, name), strict=True
            )


def test_drift_marks_each_stage_where_it_is(results):
    fused = results[-1]
    drawn = lines(figures.drift_figure(results).axes[0])
    for status in (Status.KEYFRAME, Status.OPTIMIZED, Status.TRACKED):
        rows = fused.has_status(status)
        assert rows.any()
        np.testing.assert_array_equal(
            drawn[f"vio-apr: {status.label}"][1], fused.errors.position_m[rows]
        )


def test_drift_shades_frames_without_pose(results):
    errors = np.full(len(results[2].status), 0.5)
    errors[10:15] = np.nan
    axis = figures.drift_figure([results[0], with_errors(results[2], errors)]).axes[0]
    (band,) = axis.patches
    times = results[0].timestamp_s - results[0].timestamp_s[0]
    assert (band.get_x(), band.get_width()) == (times[10], times[15] - times[10])
    assert np.isnan(lines(axis)["vio-apr"][1][10:15]).all()


def test_drift_says_that_its_axes_are_logarithmic(results):
    for axis in figures.drift_figure(results).axes:
        assert axis.get_yscale() == "log"
        assert "log scale" in axis.get_ylabel()


def test_an_outlier_stays_in_view(results):
    errors = np.full(len(results[2].status), 0.5)
    errors[7] = 4000.0
    axis = figures.drift_figure([with_errors(results[2], errors)]).axes[0]
    assert axis.get_ylim()[1] > 4000


def test_other_methods_are_drawn_as_they_come(results):
    other = dataclasses.replace(results[2], method="chain")
    drawn = lines(figures.drift_figure([other]).axes[0])
    assert {"raw net", "chain", "chain: keyframe"} <= set(drawn)
    assert "vio" not in drawn


@pytest.mark.parametrize("count", [1, 599, 600, 601, 100_000])
def test_thinning_keeps_extremes_and_gaps(count, rng):
    values = rng.random(count)
    values[count // 2] = 50.0
    values[count // 3] = -3.0
    values[count // 4 : count // 4 + 10] = np.nan
    rows = thin(values)
    assert len(rows) <= MAX_POINTS
    assert (np.diff(rows) > 0).all()
    if count > 100:
        assert {np.nanargmax(values), np.nanargmin(values)} <= set(rows.tolist())
        assert np.isnan(values[rows]).any()


def test_trajectories_show_raw_left_and_methods_beside(results):
    figure = figures.trajectory_figure(results)
    panels = figure.axes[:3]
    assert [axis.get_title(loc="left") for axis in panels] == ["raw net", "vio", "vio-apr"]
    limits = {(axis.get_xlim(), axis.get_ylim()) for axis in panels}
    assert len(limits) == 1
    raw = panels[0].collections[0]
    np.testing.assert_allclose(np.sort(raw.get_array()), np.sort(results[0].errors.position_m))
    assert {axis.collections[0].norm.vmax for axis in panels} == {
        np.percentile(results[0].errors.position_m, 95)
    }
    assert all(axis.get_aspect() == 1.0 for axis in panels)


def test_points_beyond_the_panel_are_counted(results):
    raw = results[0]
    positions = raw.case.frames.inputs.apr_world_from_cam.translation_m.copy()
    positions[:4] += 1e6
    inputs = raw.case.frames.inputs
    poses = Rigid3(positions, inputs.apr_world_from_cam.quat_xyzw)
    frames = dataclasses.replace(raw.case.frames, inputs=inputs._replace(apr_world_from_cam=poses))
    (far,) = evaluated([dataclasses.replace(raw.case, frames=frames)], ["apr"])
    inside = np.ptp(raw.gt_world_from_cam.translation_m[:, :2], axis=0).max()
    axis = figures.trajectory_figure([far]).axes[0]
    assert np.ptp(axis.get_xlim()) < 3 * inside
    (note,) = (text.get_text() for text in axis.texts)
    outside = int(re.search(r"(\d+) outside", note).group(1))
    assert 4 <= outside <= 4 + 0.1 * len(far.status)


def test_axes_are_the_two_that_the_walk_extends_along(results):
    result = results[0]
    gt = result.gt_world_from_cam
    upright = Rigid3(gt.translation_m[:, [0, 2, 1]], gt.quat_xyzw)
    axis = figures.trajectory_figure(results).axes[0]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("x (m)", "y (m)")
    axis = figures.trajectory_figure([dataclasses.replace(result, gt_world_from_cam=upright)]).axes[
        0
    ]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("x (m)", "z (m)")


def test_of_many_methods_the_best_are_shown(results):
    count = len(results[2].status)
    mostly_lost = np.where(np.arange(count) < 0.4 * count, 0.01, np.nan)
    errors = {"a": 3.0, "b": 1.0, "c": 2.0, "d": mostly_lost, "e": 0.5}
    made = [
        dataclasses.replace(with_errors(results[2], np.zeros(count) + value), method=name)
        for name, value in errors.items()
    ]
    panels = figures.trajectory_figure([results[0], *made]).axes[:4]
    titles = [axis.get_title(loc="left") for axis in panels]
    assert titles == ["raw net", "b", "c", "e"]


def test_distribution_counts_frames_without_pose(results):
    count = len(results[2].status)
    lost = np.arange(count) >= 0.6 * count
    errors = np.where(lost, np.nan, np.linspace(0.2, 2.0, count))
    axis = figures.distribution_figure([with_errors(results[2], errors)]).axes[0]
    label = next(text for text in legend_of(axis) if text.startswith("vio-apr"))
    x, y = lines(axis)[label]
    assert y[0] == 0
    assert y[-1] == pytest.approx(60, abs=1)
    assert (np.diff(y) >= 0).all()
    # The curve crosses half of its own height at the median that the legend states.
    median = np.nanmedian(errors)
    assert np.interp(median, x, y) == pytest.approx(y[-1] / 2, abs=1)
    assert label == f"vio-apr: median {format_error(median)} m, 60 % of frames"
    assert "all frames" in axis.get_ylabel()
    assert "99th percentile" in axis.get_xlabel()


def test_distribution_pools_all_walks(groups):
    group = groups[0]
    axis = figures.distribution_figure(group.results).axes[0]
    pooled = np.concatenate([r.errors.position_m for r in group.results if r.method == "vio-apr"])
    (label,) = (text for text in legend_of(axis) if text.startswith("vio-apr:"))
    assert f"median {np.nanmedian(pooled):.2f} m" in label
    assert len(legend_of(axis)) == 3


def test_risk_grows_with_coverage_to_the_mean_error(results):
    count = len(results[2].status)
    errors = np.linspace(0.0, 2.0, count)
    sure = dataclasses.replace(
        with_errors(results[2], errors),
        sigma_position_m=errors + 1,
        sigma_orientation_deg=np.ones(count),
    )
    position, orientation = figures.risk_figure([results[0], sure]).axes
    x, y = lines(position)["vio-apr: area 0.500 m"]
    assert (x[-1], y[-1]) == (100, pytest.approx(1.0))
    assert (np.diff(y) > 0).all()
    # Equal sigmas tell nothing: the mean error at every coverage.
    _, y = lines(orientation)["vio-apr: area 10.00°"]
    np.testing.assert_allclose(y, 10)
    assert len(legend_of(position)) == 1


def test_risk_is_drawn_for_methods_that_state_sigmas(groups):
    assert figures.count_figure_ticks(groups) == 3 * len(groups)
    case = groups[0].results[0].case
    (group,) = group_results(evaluated([case], ["apr", "chain"]))
    axis = figures.risk_figure(group.results).axes[0]
    assert [text.split(":")[0] for text in legend_of(axis)] == ["chain"]
    assert figures.count_figure_ticks([group]) == 4
    assert group.title in figures.caption(group, "risk")


def test_representative_case_has_the_median_raw_error():
    cases = [simulated_case(seed, duration_s=20.0) for seed in range(5)]
    results = evaluated(cases, ["apr"])
    made = [
        dataclasses.replace(
            result, raw_errors=PoseErrors(*(np.full(len(result.status), value),) * 2)
        )
        for result, value in zip(results, [5.0, 1.0, 3.0, np.nan, 4.0], strict=True)
    ]
    (group,) = group_results(made)
    assert figures.representative_case(group) is cases[2]  # the lower of 3 and 4
    assert [r.case for r in figures.results_of(group, cases[2])] == [cases[2]]
    (lost,) = group_results(made[3:4])
    assert figures.representative_case(lost) is cases[3]


def test_captions_say_which_walk_and_why(groups, saved):
    for files in saved:
        if files.kind == "distribution":
            assert files.group.title in files.caption
            continue
        case = figures.representative_case(files.group)
        assert case.title in files.caption
        assert "raw median position error" in files.caption


def test_three_figures_a_group_as_png_and_svg(groups, saved):
    assert len(saved) == figures.count_figure_ticks(groups) == 3 * len(groups)
    assert saved[0].png.name == "SetA_sim_bad_drift.png"
    for files in saved:
        assert files.png.read_bytes().startswith(b"\x89PNG")
        svg = files.svg.read_text()
        assert "<svg" in svg
        assert "<dc:date>" not in svg
        assert len(svg) < 500_000


def test_figures_are_reproducible(groups, saved, tmp_path):
    again = figures.save_figures(groups[:1], tmp_path)
    for first, second in zip(saved, again, strict=False):
        assert first.svg.read_bytes() == second.svg.read_bytes()
        assert first.png.read_bytes() == second.png.read_bytes()


def test_names_become_safe_file_names(tmp_path):
    names = [
        {"set_name": "../../etc", "apr": "<b>net</b>"},
        {"set_name": "../../ETC", "apr": "b net b"},
        {"set_name": "名前", "apr": "x" * 300},
        {"set_name": "", "apr": "_$名前\\frac{$"},
    ]
    cases = [simulated_case(index, 20.0, **name) for index, name in enumerate(names)]
    saved = figures.save_figures(group_results(evaluated(cases, ["apr"])), tmp_path)
    stems = [files.png.name for files in saved]
    assert len({name.lower() for name in stems}) == 12
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]{1,160}", name) for name in stems)
    assert {files.png.parent for files in saved} == {tmp_path / "figures"}


def test_one_color_a_method_everywhere(results):
    colors = method_colors(["apr", "vio", "vio-apr", "new", "newer"])
    assert len(set(colors.values())) == 5
    assert method_colors(["vio-apr"])["vio-apr"] == colors["vio-apr"]
    drift = figures.drift_figure(results).axes[0]
    drawn = {line.get_label(): line.get_color() for line in drift.get_lines()}
    assert drawn["vio-apr"] == colors["vio-apr"]
    assert drawn["vio-apr: keyframe"] == colors["vio-apr"]
    assert drawn["raw net"] == colors["apr"]


@pytest.mark.parametrize("kind", figures.FIGURES)
class TestDegenerateInputs:
    @pytest.mark.slow
    def test_one_frame(self, results, kind):
        render(figures.FIGURES[kind]([one_frame(result) for result in results]))

    @pytest.mark.slow
    def test_raw_predictions_only(self, results, kind):
        render(figures.FIGURES[kind](results[:1]))

    @pytest.mark.slow
    def test_a_method_that_never_has_a_pose(self, results, kind):
        lost = with_errors(results[2], np.full(len(results[2].status), np.nan))
        render(figures.FIGURES[kind]([results[0], lost]))

    @pytest.mark.slow
    def test_no_poses_and_no_predictions_at_all(self, results, kind):
        nothing = np.full(len(results[2].status), np.nan)
        lost = dataclasses.replace(
            with_errors(results[2], nothing), raw_errors=PoseErrors(nothing, nothing)
        )
        render(figures.FIGURES[kind]([lost]))

    @pytest.mark.slow
    def test_perfect_poses(self, results, kind):
        perfect = with_errors(results[2], np.zeros(len(results[2].status)))
        render(figures.FIGURES[kind]([perfect]))

    @pytest.mark.slow
    def test_a_long_walk(self, results, kind):
        result, rows = results[2], np.arange(50_000) % len(results[2].status)
        long = dataclasses.replace(
            result,
            case=dataclasses.replace(
                result.case,
                frames=dataclasses.replace(
                    result.case.frames, inputs=result.case.frames.inputs.at(rows)
                ),
                gt_world_from_cam=result.case.gt_world_from_cam.at(rows),
            ),
            timestamp_s=np.arange(len(rows)) / 60,
            gt_world_from_cam=result.gt_world_from_cam.at(rows),
            world_from_cam=result.world_from_cam.at(rows),
            status=result.status[rows],
            errors=result.errors.at(rows),
            raw_errors=result.raw_errors.at(rows),
        )
        _, svg = render(figures.FIGURES[kind]([long]))
        assert len(svg) < 600_000


def test_a_folder_that_cannot_be_made(groups, tmp_path):
    (tmp_path / "figures").write_text("in the way")
    with pytest.raises(UnwritableError, match="cannot be written"):
        figures.save_figures(groups[:1], tmp_path)


def test_figures_as_text():
    summary = Summary(0.8, 2.081, 0.0512, np.nan, 0.034, 0.235, 0.929, 0.8968)
    assert format_median(summary) == "0.800 / 2.08"
    assert format_levels(summary) == "3.4/23.5/92.9"
    assert format_share(summary) == "89.7 %"
    assert format_error(0.0) == "0.00"
    nothing = Summary(*[np.nan] * 8)
    assert [f(nothing) for f in (format_median, format_levels, format_share)] == ["–"] * 3
