import json
import shutil

import numpy as np
import pytest

from vioapr.formats import tum
from vioapr.simulation.walks import WalkParams, simulate_walk


@pytest.mark.slow
def test_table_json_and_figures(run, walk_dir, tmp_path):
    code, out, err = run(
        "vio-quality", walk_dir, "--json", tmp_path / "q.json", "--figures", tmp_path / "figures"
    )
    assert code == 0, err
    assert "Set sim" in out
    assert "diverges" not in out
    (track,) = json.loads((tmp_path / "q.json").read_text())["tracks"]
    assert (track["walk"], track["vio"], track["diverges"]) == ("walk", "sim", False)
    assert 0 < track["ate_m"] < 1
    for name in ("vio_errdis", "vio_drift"):
        for ending in ("png", "svg"):
            assert (tmp_path / "figures" / f"{name}.{ending}").stat().st_size > 1000


def test_a_diverging_tracker_is_named(run, tmp_path):
    walk = simulate_walk(WalkParams(duration_s=60), seed=1)
    walk.vio.position_m[:, 0] += np.arange(len(walk.vio)) ** 2.0
    tum.write(tmp_path / "w_gt.tum", walk.gt)
    tum.write(tmp_path / "w_arkit.tum", walk.vio)
    code, out, err = run("vio-quality", tmp_path / "w")
    assert code == 0, err
    assert "w arkit: the tracker diverges" in out


def test_a_rate_that_no_frames_have(run, walk_dir):
    code, out, _ = run("vio-quality", walk_dir, "--rate-hz", "70")
    assert code == 0
    assert "choose another --rate-hz" in out


def test_bad_input(fails, tmp_path):
    assert "expected a scene, or walks" in fails("vio-quality", tmp_path)
    assert "expected a scene, or walks" in fails("vio-quality", tmp_path / "no" / "such")
    assert "expected a positive number" in fails("vio-quality", tmp_path, "--rate-hz", "0")


def test_walks_that_cannot_be_compared_are_named(run, fails, walk_dir):
    shutil.copytree(walk_dir, walk_dir.parent / "broken")
    broken = walk_dir.parent / "broken" / "vio_sim.tum"
    broken.write_text("no poses\n")
    code, out, err = run("vio-quality", walk_dir.parent, "--format", "csv")
    assert code == 0
    assert [line.split(",")[1] for line in out.splitlines()] == ["walk", "walk"]
    assert err.startswith(f"WARNING skipped: {broken}: ")
    assert str(broken) in fails("vio-quality", broken.parent)
