"""Our errors against evo's, run as a program (it is GPL: neither imported nor a dependency)."""

import os
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from vioapr.evaluation.metrics import pose_errors, relative_errors
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.geometry.umeyama import align_umeyama
from vioapr.simulation.walks import WalkParams, simulate_walk

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("evo")
    walk = simulate_walk(WalkParams(duration_s=100), seed=9)
    tum.write(folder / "gt.tum", walk.gt)
    tum.write(folder / "vio.tum", walk.vio)
    tum.write(folder / "apr.tum", walk.apr)
    return folder


def read(path):
    return tum.read(path, ReadOptions()).target_from_source


def run_evo(folder, program, *arguments):
    executable = Path(sys.executable).parent / program
    if not executable.exists():
        pytest.skip(f"{program} is not installed")
    result = folder / "result.zip"
    result.unlink(missing_ok=True)
    environment = os.environ | {"HOME": str(folder), "MPLBACKEND": "agg"}
    subprocess.run(
        [executable, "tum", "gt.tum", *arguments, "--save_results", result],
        cwd=folder, env=environment, check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    with zipfile.ZipFile(result) as archive:
        return np.load(BytesIO(archive.read("error_array.npy")))


@pytest.mark.parametrize("kind", ["trans_part", "angle_deg"])
def test_absolute_errors(folder, kind):
    evo = run_evo(folder, "evo_ape", "apr.tum", "-r", kind)
    ours = pose_errors(read(folder / "gt.tum"), read(folder / "apr.tum"))
    field = ours.position_m if kind == "trans_part" else ours.orientation_deg
    np.testing.assert_allclose(field, evo, atol=1e-9)


@pytest.mark.parametrize("with_scale", [False, True])
def test_absolute_errors_after_alignment(folder, with_scale):
    flags = ["--align", "--correct_scale"] if with_scale else ["--align"]
    evo = run_evo(folder, "evo_ape", "vio.tum", *flags)
    gt, vio = read(folder / "gt.tum"), read(folder / "vio.tum")
    world_from_vio = align_umeyama(vio.translation_m, gt.translation_m, with_scale=with_scale)
    ours = pose_errors(gt, world_from_vio.apply_to(vio))
    np.testing.assert_allclose(ours.position_m, evo, atol=1e-9)


def test_relative_point_distances(folder):
    evo = run_evo(
        folder, "evo_rpe", "vio.tum", "-r", "point_distance", "--delta", "1", "--delta_unit", "f"
    )
    ours = relative_errors(read(folder / "gt.tum"), read(folder / "vio.tum"))
    np.testing.assert_allclose(ours.distance_m, evo, atol=1e-9)
