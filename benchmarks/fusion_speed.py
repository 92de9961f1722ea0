"""Speed and memory of the fusion methods, side by side with GTSAM's iSAM2.

    python benchmarks/fusion_speed.py [--quick] [--json PATH]

Three questions, on simulated walks with fixed seeds:
1. Streaming: microseconds a frame of one walk, through `Localizer` and through the bare step.
2. Batched: microseconds a frame when many walks are stepped together.
3. Memory: does it grow with the length of the walk, and does a frame take longer then?

iSAM2 solves another problem, one graph over all frames, and is here because it is what one
would otherwise take for streaming. To be fair to it, it runs also without our wrapper: bare
calls with poses converted beforehand, GTSAM's default Cholesky factors, no marginals. Of all
its rows the fastest is the reference of the ratios.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from common import describe_machine, publish, summarize_us, time_interleaved, write_json
from rich.console import Console
from rich.table import Table

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import get_method
from vioapr.fusion.offline import run_steps
from vioapr.fusion.pose_graph import PoseGraphParams
from vioapr.fusion.types import FrameInput
from vioapr.geometry.rigid import Rigid3
from vioapr.runtime.machine import resident_bytes
from vioapr.simulation.walks import WalkParams, simulate_walk

BATCHED_METHODS = ("apr", "vio", "vio-apr", "chain", "pose-filter", "mapnet-pgo")
RATE_HZ = 2.0
_LAST_FRAMES = 200
"""Frames before every memory reading that are timed."""


@dataclass(frozen=True)
class Config:
    """Size of the job."""

    json: Path | None = None
    """Where to write the results."""
    update_docs: bool = False
    """Put the tables into docs/results/performance.md."""
    quick: bool = False
    """A small job that only shows that everything runs."""
    walks: int = 256
    """Walks in a batch."""
    frames: int = 200
    """Frames of a walk."""
    isam2_walks: int = 4
    """Walks of the batch that iSAM2 gets, one after the other."""
    repeats: int = 5
    """Repeats of every measurement, run in turns; the median counts."""
    memory_frames: tuple[int, ...] = (1_000, 10_000, 50_000)
    """Walk lengths after which memory is read."""
    isam2_memory_frames: tuple[int, ...] = (1_000, 3_000, 10_000)
    """The same for iSAM2, whose frames take ever longer."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="PART")] = (
        "memory",
        "streaming",
        "batched",
    )
    """Which parts to run."""


def make_quick(config: Config) -> Config:
    """The same job, small."""
    return Config(
        json=config.json,
        quick=True,
        walks=16,
        frames=30,
        isam2_walks=2,
        repeats=5,
        memory_frames=(300, 600),
        isam2_memory_frames=(300, 600),
        only=config.only,
    )


def simulate_batch(walks: int, frames: int) -> FrameInput:
    """Frames of shape (frames, walks), with prediction and tracking; seeds 0 to walks - 1."""
    params = WalkParams(duration_s=frames / RATE_HZ, rate_hz=RATE_HZ)
    simulated = [simulate_walk(params, seed) for seed in range(walks)]

    def stack(name: str) -> Rigid3:
        poses = [getattr(walk, name).target_from_source for walk in simulated]
        return Rigid3(*(np.stack([pose[i] for pose in poses], axis=1) for i in range(2)))

    shape = (frames, walks)
    return FrameInput(
        np.stack([walk.gt.timestamp_s for walk in simulated], axis=1),
        stack("apr"),
        np.ones(shape, dtype=bool),
        stack("vio"),
        np.ones(shape, dtype=bool),
        np.zeros(shape, dtype=bool),
    )


def run_method(name: str, params: Any, frames: FrameInput) -> None:
    """Step a method through frames of shape (time, ...)."""
    run_steps(get_method(name), params, frames)


def run_localizer(name: str, frames: FrameInput) -> None:
    """Stream one walk through the public interface."""
    localizer = Localizer(name)
    for row, timestamp_s in enumerate(frames.timestamp_s):
        localizer.update(
            float(timestamp_s), frames.apr_world_from_cam.at(row), frames.vio_from_cam.at(row)
        )


class BareIsam2:
    """The same graph as method pose-graph, by the fewest GTSAM calls that give live poses."""

    def __init__(self, frames: FrameInput, updates: int) -> None:
        """Convert poses and build noise models, which is not timed.

        Args:
            frames: One walk, shape (n,), every frame with a prediction.
            updates: iSAM2 updates a frame.
        """
        import gtsam

        self._gtsam, self._updates = gtsam, updates
        self._predictions = self._to_pose3(frames.apr_world_from_cam)
        vio = self._to_pose3(frames.vio_from_cam)
        self._motions = [a.between(b) for a, b in pairwise(vio)]
        params, noise = PoseGraphParams(), gtsam.noiseModel
        self._prior_noise = noise.Robust.Create(
            noise.mEstimator.Cauchy.Create(params.cauchy_k),
            self._sigmas(params.prior_sigma_m, params.prior_sigma_deg),
        )
        self._between_noise = self._sigmas(params.between_sigma_m, params.between_sigma_deg)

    def _sigmas(self, sigma_m: float, sigma_deg: float) -> Any:
        sigmas = np.repeat([np.deg2rad(sigma_deg), sigma_m], 3)
        return self._gtsam.noiseModel.Diagonal.Sigmas(sigmas)

    def _to_pose3(self, poses: Rigid3) -> list[Any]:
        return [self._gtsam.Pose3(matrix) for matrix in poses.to_matrix()]

    def __call__(self) -> np.ndarray:
        """Stream the walk; the positions, shape (n, 3), m."""
        gtsam = self._gtsam
        session, newest, positions = gtsam.ISAM2(), None, []
        for key, prediction in enumerate(self._predictions):
            factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            factors.add(gtsam.PriorFactorPose3(key, prediction, self._prior_noise))
            guess = prediction
            if newest is not None:
                motion = self._motions[key - 1]
                factors.add(gtsam.BetweenFactorPose3(key - 1, key, motion, self._between_noise))
                guess = newest.compose(motion)
            values.insert(key, guess)
            session.update(factors, values)
            for _ in range(self._updates - 1):
                session.update()
            newest = session.calculateEstimatePose3(key)
            positions.append(newest.translation())
        return np.array(positions)


def isam2_jobs(walks: list[FrameInput]) -> dict[str, Callable[[], Any]]:
    """iSAM2 over some walks, by our method and by bare calls."""

    def run_all(jobs: list[Callable[[], Any]]) -> None:
        for job in jobs:
            job()

    jobs: dict[str, Callable[[], Any]] = {}
    for updates in (1, 3):
        params = PoseGraphParams(sigmas=False, updates=updates)
        label = f"{updates} update{'s' if updates > 1 else ''}"
        jobs[f"iSAM2, pose-graph, {label}"] = partial(
            run_all, [partial(run_method, "pose-graph", params, walk) for walk in walks]
        )
        jobs[f"iSAM2, bare GTSAM, {label}"] = partial(
            run_all, [BareIsam2(walk, updates) for walk in walks]
        )
    return jobs


def measure(
    jobs: dict[str, Callable[[], Any]], frames: dict[str, int], repeats: int
) -> dict[str, dict[str, float]]:
    """Microseconds a frame, and how many times faster than iSAM2's fastest row."""
    rows = {
        name: summarize_us(seconds, frames[name])
        for name, seconds in time_interleaved(jobs, repeats).items()
    }
    reference = min(row["median_us"] for name, row in rows.items() if name.startswith("iSAM2"))
    return {
        name: {**row, "times_faster": reference / row["median_us"]} for name, row in rows.items()
    }


def measure_streaming(config: Config, batch: FrameInput) -> dict[str, dict[str, float]]:
    """One walk, frame by frame."""
    walk = batch.at((slice(None), 0))
    jobs: dict[str, Callable[[], Any]] = {}
    for name in BATCHED_METHODS:
        params = get_method(name).params_type()
        jobs[f"{name}, step"] = partial(run_method, name, params, walk)
        jobs[f"{name}, Localizer"] = partial(run_localizer, name, walk)
    jobs |= isam2_jobs([walk])
    return measure(jobs, dict.fromkeys(jobs, config.frames), config.repeats)


def measure_batched(config: Config, batch: FrameInput) -> dict[str, dict[str, float]]:
    """All walks at once; iSAM2, which cannot, takes some of them one by one."""
    jobs: dict[str, Callable[[], Any]] = {
        name: partial(run_method, name, get_method(name).params_type(), batch)
        for name in BATCHED_METHODS
    }
    frames = dict.fromkeys(jobs, config.frames * config.walks)
    isam2 = isam2_jobs([batch.at((slice(None), walk)) for walk in range(config.isam2_walks)])
    frames |= dict.fromkeys(isam2, config.frames * config.isam2_walks)
    return measure(jobs | isam2, frames, config.repeats)


def endless_frames(walk: FrameInput) -> Iterator[FrameInput]:
    """One walk's frames over and over."""
    rows = [walk.at(row) for row in range(len(walk.timestamp_s))]
    return cycle(rows)


def measure_memory(config: Config, walk: FrameInput) -> dict[str, list[dict[str, float]]]:
    """State and process memory after ever longer walks, and the time of the last frames."""
    lean = PoseGraphParams(sigmas=False, updates=1)
    ours = ("vio-apr", "chain")
    jobs = {
        **{name: (get_method(name).params_type(), config.memory_frames) for name in ours},
        "pose-graph": (lean, config.isam2_memory_frames),
    }
    return {
        name: _grow(name, params, endless_frames(walk), marks)
        for name, (params, marks) in jobs.items()
    }


def _grow(
    name: str, params: Any, frames: Iterator[FrameInput], marks: tuple[int, ...]
) -> list[dict[str, float]]:
    method = get_method(name)
    state = method.init(params, (), np.zeros(()))
    warm_up = 100
    for frame in islice(frames, warm_up):
        state, _ = method.step(params, state, frame)
    before, done, rows = resident_bytes(), warm_up, []
    for mark in marks:
        last = _LAST_FRAMES
        for frame in islice(frames, mark - done - last):
            state, _ = method.step(params, state, frame)
        start = time.perf_counter()
        for frame in islice(frames, last):
            state, _ = method.step(params, state, frame)
        seconds, done, now = time.perf_counter() - start, mark, resident_bytes()
        rows.append(
            {
                "frames": mark,
                "state_bytes": _array_bytes(state),
                "process_growth_kib": (
                    float("nan") if now is None or before is None else (now - before) / 1024
                ),
                "us_a_frame": 1e6 * seconds / last,
            }
        )
    return rows


def _array_bytes(state: Any) -> float:
    """Bytes of all arrays in nested tuples; NaN for a state that is not made of arrays."""
    if isinstance(state, tuple):
        return sum(_array_bytes(part) for part in state)
    return state.nbytes if isinstance(state, np.ndarray | np.generic) else float("nan")


def speed_table(title: str, rows: dict[str, dict[str, float]]) -> Table:
    """A table of one measurement."""
    table = Table("method", title=title, title_justify="left")
    for heading in ("us a frame", "fastest", "slowest", "times faster than iSAM2"):
        table.add_column(heading, justify="right")
    for name, row in rows.items():
        times = [f"{row[key]:.2f}" for key in ("median_us", "min_us", "max_us")]
        table.add_row(name, *times, f"{row['times_faster']:.2f}")
    return table


def memory_table(rows: dict[str, list[dict[str, float]]]) -> Table:
    """A table of the memory measurement."""
    table = Table("method", title="Memory and time as one walk gets longer", title_justify="left")
    for heading in (
        "frames",
        "state, bytes",
        "process growth, KiB",
        f"us a frame, the last {_LAST_FRAMES}",
    ):
        table.add_column(heading, justify="right")
    for name, marks in rows.items():
        for row in marks:
            state = "-" if np.isnan(row["state_bytes"]) else f"{row['state_bytes']:.0f}"
            numbers = [f"{row['process_growth_kib']:.0f}", f"{row['us_a_frame']:.1f}"]
            table.add_row(name, f"{row['frames']:.0f}", state, *numbers)
    return table


def main(config: Config) -> None:
    """Run, print and save."""
    if config.quick:
        config = make_quick(config)

    def show(table: Table, section: str) -> None:
        publish(table, "performance.md", section, update_docs=config.update_docs)

    console = Console(width=100)
    machine = describe_machine(("numpy", "gtsam", "array-api-compat"))
    console.print(", ".join(f"{key} {value}" for key, value in machine.items()), highlight=False)
    results: dict[str, Any] = {"machine": machine}
    if "memory" in config.only:  # first, while the process is small
        walk = simulate_batch(1, config.frames).at((slice(None), 0))
        results["memory"] = measure_memory(config, walk)
        show(memory_table(results["memory"]), "memory")
    batch = simulate_batch(config.walks, config.frames)
    if "streaming" in config.only:
        results["streaming"] = measure_streaming(config, batch)
        title = f"One walk of {config.frames} frames"
        show(speed_table(title, results["streaming"]), "streaming")
    if "batched" in config.only:
        results["batched"] = measure_batched(config, batch)
        title = f"{config.walks} walks of {config.frames} frames, together"
        show(speed_table(title, results["batched"]), "batched")
    if config.json is not None:
        shown = {key: getattr(config, key) for key in ("walks", "frames", "isam2_walks", "repeats")}
        write_json(config.json, {"job": shown, **results})


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
