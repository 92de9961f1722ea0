"""Figures on real predictions, against those of an independent prototype."""

import pytest

from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import evaluate_cases
from vioapr.evaluation.tables import group_results
from vioapr.fusion.vio_apr import VioAprParams
from vioapr.scene.walks import find_walks

REFERENCE = {
    # set, odometry, regressor: median m, median deg, share of frames
    ("Cambridge", "sim", "posenet"): (1.06, 3.98, 0.76),
    ("Cambridge", "sim", "mst"): (0.80, 2.08, 0.90),
    ("Cambridge", "sim", "dfnet"): (0.685, 2.25, 0.78),
    ("7Scenes", "sim", "posenet"): (0.177, 5.81, 0.99),
    ("ADVIO", "arkit", "posenet"): (1.10, 4.12, 0.63),
}
RAW = {
    ("Cambridge", "sim", "posenet"): (1.16, 4.13),
    ("Cambridge", "sim", "mst"): (0.92, 2.18),
    ("ADVIO", "arkit", "posenet"): (1.18, 3.66),
}


@pytest.fixture(scope="module")
def groups(bench_dir):
    folders = find_walks([bench_dir / name for name in ("Cambridge", "7Scenes", "ADVIO")])
    results = evaluate_cases(load_cases(folders), {"vio-apr": VioAprParams()})
    return {(g.set_name, g.vio, g.apr): g for g in group_results(results)}


@pytest.mark.slow
@pytest.mark.parametrize("key", REFERENCE, ids="-".join)
def test_keyframes_and_optimized(groups, key):
    row = next(r for r in groups[key].rows if r.subset == "keyframes + optimized")
    found = (row.fused.median_m, row.fused.median_deg, row.fused.share)
    assert found == pytest.approx(REFERENCE[key], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("key", RAW, ids="-".join)
def test_raw_predictions(groups, key):
    assert groups[key].raw[:2] == pytest.approx(RAW[key], rel=0.02)
