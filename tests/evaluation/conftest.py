"""A small set of simulated walks on disk, and what the methods make of them."""

import pytest

from vioapr.formats import tum
from vioapr.scene.walks import write_walk
from vioapr.simulation.walks import WalkParams, simulate_walk


def write_draws(folder, seed, duration_s=40.0):
    """Two draws of odometry and two regressors, one of them gzipped."""
    walk = simulate_walk(WalkParams(duration_s=duration_s), seed)
    other = simulate_walk(WalkParams(duration_s=duration_s), seed + 100)
    write_walk(folder, gt=walk.gt, vios=dict.fromkeys(("sim0", "sim1"), walk.vio))
    write_walk(folder, aprs={"good": walk.apr})
    tum.write(folder / "apr_bad.tum.gz", other.apr)


@pytest.fixture(scope="session")
def walks_dir(tmp_path_factory):
    root = tmp_path_factory.mktemp("walks")
    write_draws(root / "SetA" / "walk1", 1)
    write_draws(root / "SetA" / "walk2", 2, 60.0)
    write_draws(root / "SetB" / "walk1", 3)
    return root
