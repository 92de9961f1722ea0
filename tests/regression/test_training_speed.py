"""The benchmark of the input pipeline runs, on a tiny setting; its figures are not judged."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "training_speed.py"


def run(*arguments):
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)],
        env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def test_it_runs(tmp_path):
    done = run("--quick", "--json", tmp_path / "figures.json")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "figures.json").read_text())
    assert set(found["images_per_s"]) == {
        "resident + step", "ours + step", "plain + step", "ours", "plain",
    }  # fmt: skip
    assert all(rate > 0 for rate in found["images_per_s"].values())
    assert found["jpeg"]["width_px"] == 160
    assert found["machine"]["cpu"]
    assert "(goal: at least 0.95" in done.stdout
    assert "(goal: at least 5" in done.stdout


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_the_papers_setting_needs_a_gpu():
    done = run("--paper")
    assert done.returncode != 0
    assert done.stderr.strip() == "--paper: expected a GPU, found none"
