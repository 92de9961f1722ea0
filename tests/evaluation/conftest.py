"""A small set of simulated walks on disk, and what the methods make of them."""

import pytest

from vioapr.formats import tum
from vioapr.simulation.walks import WalkParams, simulate_walk


def write_walk(folder, seed, duration_s=40.0):
    """Two draws of odometry and two regressors, one of them gzipped."""
    folder.mkdir(parents=True)
    walk = simulate_walk(WalkParams(duration_s=duration_s), seed)
    other = simulate_walk(WalkParams(duration_s=duration_s), seed + 100)
    tum.write(folder / "gt.tum", walk.gt)
    tum.write(folder / "vio_sim0.tum", walk.vio)
    tum.write(folder / "vio_sim1.tum", walk.vio)
    tum.write(folder / "apr_good.tum", walk.apr)
    tum.write(folder / "apr_bad.tum.gz", other.apr)


@pytest.fixture(scope="session")
def walks_dir(tmp_path_factory):
    root = tmp_path_factory.mktemp("walks")
    write_walk(root / "SetA" / "walk1", 1)
    write_walk(root / "SetA" / "walk2", 2, 60.0)
    write_walk(root / "SetB" / "walk1", 3)
    return root
