"""Method `chain` on walks that nothing was chosen by; for docs/results/accuracy.md.

    VIOAPR_DATA=... python benchmarks/fresh_walks.py [--json FILE] [--against FILE]
        [--seed N] [--draws N] [--update-docs]

The benchmark's walks were looked at while the method was made. Here are others: new odometries
over the same predictions, frames between those of the benchmark, predictions' errors put onto other
walks of ARKit, and simulated walks. Figures are means over walks of each walk's median
and 95th percentile on all frames with ground truth, prediction and tracking. To judge a change of
the method, run it with the version before (`--json`) and then with the one after (`--against`).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from chain import DOCS, by_group, errors_of, figures_of, run_chain
from common import data_folder, replace_section, write_json
from numpy.typing import NDArray

from vioapr.cli.console import progress
from vioapr.evaluation.cases import Case
from vioapr.evaluation.evaluate import Result, count_ticks, evaluate_cases
from vioapr.formats.registry import read_trajectory
from vioapr.fusion.methods import METHODS
from vioapr.fusion.pairing import pair_frames
from vioapr.fusion.types import Status
from vioapr.geometry.frames import cam_from_arcam, z_up_from_y_up
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.walks import WalkFiles, find_walks
from vioapr.simulation.trackers import track
from vioapr.simulation.walks import simulate_walk
from vioapr.trajectory import Trajectory

ADVIO_WALKS = ("02", "03", "05", "12", "13", "18", "22")
"""Those whose ARKit track neither diverges nor rides an escalator."""
BLOCK = 20
"""Consecutive predictions whose errors are put onto another walk together."""
REGRESSORS = {"posenet": "pn", "mst": "mst", "dfnet": "dfnet"}
_PARTS = ("x", "y", "z", "qx", "qy", "qz", "qw")
NAMES = ("raw", "vio-apr keyframes + optimized", "raw on these", "vio-apr all", "chain")


def make_case(key: tuple[str, str, str, str], apr: Trajectory, vio: Trajectory, gt: Trajectory):
    """A case of trajectories on one clock; ground truth has a pose for every frame."""
    frames = pair_frames(apr, vio)
    rows = np.searchsorted(gt.timestamp_s, frames.timestamp_s - 1e-4)
    return Case(*key, frames, gt.target_from_source.at(rows))


def redrawn_cases(walks: list[WalkFiles], seed: int, draws: int) -> Iterator[Case]:
    """The benchmark's predictions with phones' odometries of other seeds."""
    for number, walk in enumerate(walks):
        gt = read_trajectory(walk.gt)
        aprs = {name: read_trajectory(path) for name, path in walk.aprs.items()}
        for draw in range(draws):
            rng = np.random.default_rng([seed, number, draw])
            vio = gt.with_transforms(track(rng, gt.timestamp_s, gt.target_from_source))
            for name, apr in aprs.items():
                yield make_case((walk.set_name, walk.walk, f"sim{draw}", name), apr, vio, gt)


def other_frames_cases(data: Path) -> Iterator[Case]:
    """7Scenes with real odometries, 5 frames a second, between the benchmark's."""
    for path in sorted((data / "sevenscenes_merged").glob("*.csv.gz")):
        walk = path.name.removesuffix(".csv.gz").replace("seq-", "seq")
        table = np.genfromtxt(path, delimiter=",", names=True)
        upright = _upright_from_table(data / "bench" / "7ScenesRealOdometry" / walk, table)
        for phase in (1, 4):
            rows = table[table["frame"] % 6 == phase]
            gt = _column(rows, "gt", upright)
            for vio_name in ("dslam", "dso"):
                vio = _column(rows, vio_name)
                for name, column in REGRESSORS.items():
                    key = ("7ScenesOtherFrames", walk, f"{vio_name}{phase}", name)
                    yield make_case(key, _column(rows, column, upright), vio, gt)


def _upright_from_table(folder: Path, table: NDArray) -> Rigid3:
    """From the table's world to the benchmark's, which knows up."""
    upright = read_trajectory(folder / "gt.tum")
    same = _column(table[table["t"] <= upright.timestamp_s[0] + 1e-3], "gt")
    return upright.target_from_source.at(0) @ same.target_from_source.at(-1).inverse()


def _column(rows: NDArray, name: str, world: Rigid3 | None = None) -> Trajectory:
    values = np.stack([rows[f"{name}_{part}"] for part in _PARTS], axis=-1)
    known = np.isfinite(values).all(axis=-1)
    quats = values[known, 3:] / np.linalg.norm(values[known, 3:], axis=-1, keepdims=True)
    poses = Rigid3(values[known, :3], quats)
    return Trajectory.from_arrays(rows["t"][known], *(poses if world is None else world @ poses))


def arkit_cases(data: Path, seed: int, draws: int) -> Iterator[Case]:
    """ARKit's walks, twice a second, with the errors of the Cambridge predictions."""
    cambridge = find_walks([data / "bench" / "Cambridge"])
    for number, walk in enumerate(ADVIO_WALKS):
        paths = (data / "advio" / "tum10hz" / f"advio-{walk}_{kind}.tum.gz"
                 for kind in ("gt", "arkit"))  # fmt: skip
        gt, vio = (read_trajectory(path, "tum").at_rows(slice(2, None, 5)) for path in paths)
        gt = gt.with_transforms(z_up_from_y_up(cam_from_arcam(gt.target_from_source)))
        vio = vio.with_transforms(cam_from_arcam(vio.target_from_source))
        for draw in range(draws):
            for name in REGRESSORS:
                rng = np.random.default_rng([seed, number, draw])
                errors = _draw_errors(rng, cambridge, name, len(gt))
                apr = gt.with_transforms(gt.target_from_source @ errors)
                yield make_case(("ADVIO", walk, f"arkit{draw}", name), apr, vio, gt)


def _draw_errors(rng: np.random.Generator, walks: list[WalkFiles], name: str, count: int) -> Rigid3:
    """Of a regressor, gt_cam_from_apr_cam, in blocks of consecutive frames."""
    blocks = []
    while len(blocks) * BLOCK < count:
        walk = walks[rng.integers(len(walks))]
        gt, apr = (read_trajectory(path).target_from_source for path in (walk.gt, walk.aprs[name]))
        start = rng.integers(gt.batch_shape[0] - BLOCK)
        blocks.append((gt.inverse() @ apr).at(slice(start, start + BLOCK)))
    parts = (np.concatenate(part)[:count] for part in zip(*blocks, strict=True))
    return Rigid3(*parts)


def simulated_cases(seed: int, draws: int) -> Iterator[Case]:
    """Walks that are simulated altogether."""
    for draw in range(5 * draws):
        walk = simulate_walk(seed=1000 * seed + draw)
        key = ("Simulated", f"walk{draw}", "sim", "sim")
        yield make_case(key, walk.apr, walk.vio, walk.gt)


def all_cases(data: Path, seed: int, draws: int) -> list[Case]:
    """Of all kinds."""
    walks = find_walks([data / "bench" / name for name in ("Cambridge", "7Scenes")])
    return [
        *redrawn_cases(walks, seed, draws),
        *other_frames_cases(data),
        *arkit_cases(data, seed, draws),
        *simulated_cases(seed, draws),
    ]


def figures_of_vio_apr(result: Result) -> list[list[float]]:
    """Raw, keyframes + optimized, raw on these, all frames with raw poses before the first."""
    errors, raw = (
        np.stack([e.position_m, e.orientation_deg]) for e in (result.errors, result.raw_errors)
    )
    counts = np.isfinite(raw[0]) & (result.case.frames.inputs.tracking_ok[result.case.has_gt])
    chosen = result.has_status(Status.KEYFRAME, Status.OPTIMIZED) & counts
    everywhere = np.where(np.isfinite(errors), errors, raw)
    return [
        [*figures_of((part[0, rows], part[1, rows])), float(rows.sum() / counts.sum())]
        for part, rows in ((raw, counts), (errors, chosen), (raw, chosen), (everywhere, counts))
    ]


def measure(cases: list[Case]) -> dict[str, dict[str, list[float]]]:
    """By cell and method: median m, median deg, p95 m, p95 deg, share of frames."""
    params = {"vio-apr": METHODS["vio-apr"].params_type()}
    with progress("fusing by the paper's method", count_ticks(cases, list(params))) as tick:
        paper = evaluate_cases(cases, params, tick=tick)
    rows = []
    for case, fused, result in zip(cases, run_chain(cases), paper, strict=True):
        errors = errors_of(case, fused)
        ours = [*figures_of(errors), float(np.isfinite(errors[0]).mean())]
        rows.append([*figures_of_vio_apr(result), ours])
    return {
        ", ".join(key): dict(zip(NAMES, values.tolist(), strict=True))
        for key, values in by_group(cases, rows).items()
    }


def markdown(cells: dict[str, dict[str, list[float]]], counts: dict[str, int]) -> str:
    """One row a cell."""
    lines = [
        "| set, odometry, regressor (walks) | " + " | ".join(NAMES) + " |",
        "|---|" + "---|" * len(NAMES),
    ]
    for key, figures in cells.items():
        texts = [_text(figures[name]) for name in NAMES]
        lines.append(f"| {key} ({counts[key]}) | " + " | ".join(texts) + " |")
    return "\n".join(lines) + "\n"


def _text(figures: list[float]) -> str:
    share = "" if figures[4] > 0.9999 else f" ({100 * figures[4]:.0f} %)"
    return "{:.3f} / {:.2f}, p95 {:.3f} / {:.2f}".format(*figures[:4]) + share


def compare(before: dict, after: dict) -> str:
    """Ratios of the figures of `chain` to an earlier version's."""
    ratios = {key: np.divide(after[key]["chain"][:4], before[key]["chain"][:4]) for key in after}
    ratios["mean"] = np.mean([*ratios.values()], axis=0)
    ratios["largest"] = np.max([*ratios.values()], axis=0)
    lines = ["| cell | median m / deg, p95 m / deg over the version before |", "|---|---|"]
    lines += [f"| {key} | {' / '.join(f'{v:.3f}' for v in row)} |" for key, row in ratios.items()]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Draw, measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = data_folder()
    cases = all_cases(data, options.seed, options.draws)
    groups = [", ".join(case.group) for case in cases]
    cells = measure(cases)
    text = markdown(cells, {key: groups.count(key) for key in cells})
    print(text)
    if options.against:
        print(compare(json.loads(options.against.read_text())["cells"], cells))
    if options.json:
        write_json(options.json, {"seed": options.seed, "draws": options.draws, "cells": cells})
    if options.update_docs:
        replace_section(DOCS, "fresh", text)


if __name__ == "__main__":
    main()
