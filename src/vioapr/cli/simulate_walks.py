"""`vioapr simulate walks`: walks without images, in an instant."""

from __future__ import annotations

from pathlib import Path

from vioapr.cli.console import console, progress
from vioapr.errors import ParameterError, UnwritableError
from vioapr.formats import tum
from vioapr.simulation.walks import WalkParams, simulate_walk


def simulate_walks(out: Path, walks: int = 5, seed: int = 0) -> None:
    """Simulate walks: ground truth, VIO and the predictions of a regressor, without images.

    Files are like a user's own: try `vioapr inspect`, `fuse` and `evaluate` on them.

    Args:
        out: Folder to write a folder a walk to.
        walks: Number of walks.
        seed: Of the first walk; the same seed gives the same walks.
    """
    if walks < 1:
        raise ParameterError(f"--walks: expected at least 1, got {walks}")
    if seed < 0:
        raise ParameterError(f"--seed: expected a number of at least 0, got {seed}")
    with progress("simulating walks", walks) as tick:
        for index in range(walks):
            _write_walk(out / f"walk{index + 1:02d}", seed + index)
            tick()
    console.print(f"evaluate them: vioapr evaluate {out}", soft_wrap=True, markup=False)


def _write_walk(folder: Path, seed: int) -> None:
    walk = simulate_walk(WalkParams(), seed)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    tum.write(folder / "gt.tum", walk.gt)
    tum.write(folder / "vio_sim.tum", walk.vio)
    tum.write(folder / "apr_simulated.tum", walk.apr)
