"""`vioapr demo`: a first look without any data."""

from __future__ import annotations

from pathlib import Path

from vioapr.cli.console import console, progress
from vioapr.cli.evaluate import print_tables, publish
from vioapr.errors import FormatError, ParameterError
from vioapr.evaluation.evaluate import count_ticks, evaluate_cases
from vioapr.evaluation.tables import group_results
from vioapr.evaluation.walks import find_walks, load_cases
from vioapr.formats import tum
from vioapr.fusion.methods import METHODS
from vioapr.recording.simulated_walk import WalkParams, simulate_walk


def demo(out: Path = Path("vioapr-demo"), walks: int = 5, seed: int = 0) -> None:
    """Simulate walks, fuse them, print the tables and write a report.

    The walks are files like a user's own: try `vioapr inspect`, `fuse` and `evaluate` on them.

    Args:
        out: Folder to write the walks and the report to.
        walks: Number of walks.
        seed: Seed of the simulation; the same seed gives the same walks.
    """
    if walks < 1:
        raise ParameterError(f"--walks: expected at least 1, got {walks}")
    if seed < 0:
        raise ParameterError(f"--seed: expected a number of at least 0, got {seed}")
    with progress("simulating walks", walks) as tick:
        for index in range(walks):
            _write_walk(out / "Simulated" / f"walk{index + 1:02d}", seed + index)
            tick()
    methods = {name: METHODS[name].params_type() for name in ("apr", "vio", "vio-apr", "consensus")}
    cases = load_cases(find_walks([out / "Simulated"]))
    with progress("fusing", count_ticks(cases, list(methods))) as tick:
        groups = group_results(evaluate_cases(cases, methods, tick=tick))
    print_tables(groups)
    console.print(f"walks: {(out / 'Simulated').resolve()}", soft_wrap=True)
    publish(
        groups,
        out / "report",
        title="vioapr on simulated walks",
        params_of_method=methods,
        view="retrospective",
    )


def _write_walk(folder: Path, seed: int) -> None:
    walk = simulate_walk(WalkParams(), seed)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FormatError(folder, f"cannot be made: {error.strerror}") from None
    tum.write(folder / "gt.tum", walk.gt)
    tum.write(folder / "vio_sim.tum", walk.vio)
    tum.write(folder / "apr_simulated.tum", walk.apr)
