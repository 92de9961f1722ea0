"""`vioapr simulate walks`: walks without images, in an instant."""

from __future__ import annotations

from pathlib import Path

from vioapr.cli.console import console, progress
from vioapr.errors import ParameterError
from vioapr.scene.walks import write_walk
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
            walk = simulate_walk(WalkParams(), seed + index)
            folder = out / f"walk{index + 1:02d}"
            write_walk(folder, gt=walk.gt, vios={"sim": walk.vio}, aprs={"simulated": walk.apr})
            tick()
    console.print(f"evaluate them: vioapr evaluate {out}", soft_wrap=True, markup=False)
