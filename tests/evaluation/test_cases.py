from dataclasses import replace

import numpy as np
import pytest

from vioapr.errors import AssociationError, FormatError
from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import evaluate_cases
from vioapr.formats import mstransformer, tum
from vioapr.formats.base import ReadOptions
from vioapr.fusion.apr import AprParams
from vioapr.scene.walks import find_walks


def test_cases_are_all_combinations(walks_dir):
    ticks = []
    cases = load_cases(find_walks([walks_dir]), tick=lambda: ticks.append(1))
    assert len(cases) == 12
    assert len(ticks) == 3
    assert cases[0].group == ("SetA", "sim", "bad")
    assert cases[0].has_gt.all()


def test_the_draw_is_a_number_at_the_end_only(walks_dir):
    case = load_cases(find_walks([walks_dir / "SetB"]))[0]
    assert replace(case, vio="arkit6").group[1] == "arkit"
    assert replace(case, vio="3").group[1] == "3"
    assert replace(case, vio="t265_left").group[1] == "t265_left"


def test_frames_without_ground_truth_are_fused_but_not_evaluated(walks_dir, tmp_path):
    source, walk = walks_dir / "SetB" / "walk1", tmp_path / "set" / "walk"
    walk.mkdir(parents=True)
    for name in ("vio_sim0.tum", "apr_good.tum"):
        (walk / name).write_bytes((source / name).read_bytes())
    gt = tum.read(source / "gt.tum", ReadOptions())
    tum.write(walk / "gt.tum", gt.at_rows(slice(None, None, 2)))
    (case,) = load_cases(find_walks([tmp_path]))
    assert len(case.frames) == len(gt)
    assert case.has_gt.tolist() == [True, False] * (len(gt) // 2)
    assert np.isnan(case.gt_world_from_cam.translation_m[1]).all()


def test_walks_without_a_clock_have_no_rate_of_jumps(walks_dir, tmp_path):
    source, walk = walks_dir / "SetB" / "walk1", tmp_path / "set" / "walk"
    walk.mkdir(parents=True)
    for role, name in (("gt", "gt"), ("vio_x", "vio_sim0"), ("apr_x", "apr_good")):
        track = tum.read(source / f"{name}.tum", ReadOptions())
        names = tuple(f"frame-{row:04d}.png" for row in range(len(track)))
        mstransformer.FORMAT.write(walk / f"{role}.csv", replace(track, names=names))
    (case,) = load_cases(find_walks([tmp_path]))
    (timed, *_) = load_cases(find_walks([source.parent]))
    assert (case.has_clock, timed.has_clock) == (False, True)
    (result,) = evaluate_cases([case], {"apr": AprParams()})
    assert np.isnan(result.reliability.jumps_per_min)
    assert result.reliability.largest_jump_m > 0.05


def test_walks_whose_times_do_not_meet_name_the_files(walks_dir, tmp_path):
    source, walk = walks_dir / "SetB" / "walk1", tmp_path / "set" / "walk"
    walk.mkdir(parents=True)
    for name in ("gt.tum", "vio_sim0.tum"):
        (walk / name).write_bytes((source / name).read_bytes())
    apr = tum.read(source / "apr_good.tum", ReadOptions())
    (walk / "apr_late.tum").write_text(
        "".join(f"{1e6 + i} 0 0 0 0 0 0 1\n" for i in range(len(apr)))
    )
    with pytest.raises(AssociationError, match="apr_late.tum and vio_sim0.tum: no prediction"):
        load_cases(find_walks([tmp_path]))


def test_what_a_regressor_states_is_read_with_its_predictions(walks_dir, tmp_path):
    source, walk = walks_dir / "SetB" / "walk1", tmp_path / "set" / "walk"
    walk.mkdir(parents=True)
    for file in source.iterdir():
        (walk / file.name).write_bytes(file.read_bytes())
    header = "timestamp_s,sigma_position_m,sigma_orientation_deg"
    (walk / "apr_good.sigma.csv").write_text(f"{header}\n1.0,0.5,90\n")
    cases = {case.apr: case.frames.inputs for case in load_cases(find_walks([tmp_path]))}
    assert cases["bad"].apr_sigma_m is None
    stated = cases["good"]
    row = np.flatnonzero(stated.timestamp_s == 1.0)
    assert stated.apr_sigma_m[row] == 0.5
    np.testing.assert_allclose(stated.apr_sigma_rad[row], np.pi / 2)
    assert np.isnan(np.delete(stated.apr_sigma_m, row)).all()
    (walk / "apr_good.sigma.csv").write_text(f"{header}\n1.0,-0.5,90\n")
    with pytest.raises(FormatError, match=r"apr_good.sigma.csv:2: expected a sigma_position_m"):
        load_cases(find_walks([tmp_path]))
