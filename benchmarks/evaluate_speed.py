"""Errors and summaries of 1,000 walks of 200 frames: vioapr beside evo's Python API.

Both start from the same arrays of positions and quaternions and end with the statistics of
every walk's absolute position and orientation errors and of its relative distances between
consecutive frames. evo takes one walk at a time; vioapr takes all in one batch.
evo is GPL and is used by this script alone: pip install evo.

    python benchmarks/evaluate_speed.py [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import describe_machine, publish, time_interleaved, write_json
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from rich.table import Table

from vioapr.evaluation.metrics import PoseErrors, pose_errors, relative_errors, summarize
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import WalkParams, simulate_walk

REPEATS = 3


def make_walks(walks: int, frames: int) -> tuple[np.ndarray, Rigid3, Rigid3]:
    """Times, ground truth and estimates, shapes (frames,), (walks, frames) twice."""
    drawn = [simulate_walk(WalkParams(duration_s=frames / 2.0), seed) for seed in range(walks)]

    def stack(trajectories: list) -> Rigid3:
        return Rigid3(
            np.stack([t.position_m for t in trajectories]),
            np.stack([t.quat_xyzw for t in trajectories]),
        )

    times = drawn[0].gt.timestamp_s
    return times, stack([d.gt for d in drawn]), stack([d.apr for d in drawn])


def run_ours(gt: Rigid3, estimate: Rigid3) -> np.ndarray:
    """Median position error, orientation error and relative distance error, (walks, 3)."""
    absolute = summarize(pose_errors(gt, estimate))
    relative = summarize(PoseErrors(*relative_errors(gt, estimate)))
    return np.stack([absolute.median_m, absolute.median_deg, relative.median_m], axis=-1)


def run_evo(times: np.ndarray, gt: Rigid3, estimate: Rigid3) -> np.ndarray:
    """The same by evo, one walk at a time."""
    wxyz = [3, 0, 1, 2]
    rows = []
    for k in range(len(gt.translation_m)):
        pair = tuple(
            PoseTrajectory3D(p.translation_m[k], p.quat_xyzw[k][:, wxyz], times)
            for p in (gt, estimate)
        )
        asked = (
            metrics.APE(metrics.PoseRelation.translation_part),
            metrics.APE(metrics.PoseRelation.rotation_angle_deg),
            metrics.RPE(metrics.PoseRelation.point_distance, 1, metrics.Unit.frames),
        )
        row = []
        for metric in asked:
            metric.process_data(pair)
            row.append(metric.get_all_statistics()["median"])
        rows.append(row)
    return np.array(rows)


def main() -> None:
    """Time both in turn and print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    parser.add_argument("--quick", action="store_true", help="50 walks, to see that it runs")
    options = parser.parse_args()
    walks, frames = (50 if options.quick else 1000), 200
    times, gt, estimate = make_walks(walks, frames)

    def ours() -> np.ndarray:
        return run_ours(gt, estimate)

    def evo() -> np.ndarray:
        return run_evo(times, gt, estimate)

    difference = float(np.abs(ours() - evo()).max())
    seconds = time_interleaved({"vioapr": ours, "evo": evo}, REPEATS)
    ratios = [theirs / own for own, theirs in zip(*seconds.values(), strict=True)]
    own, theirs = (float(np.median(values)) for values in seconds.values())
    table = Table(title=f"{walks} walks of {frames} frames, median of {REPEATS} runs in turn")
    for column in ("", "seconds", "ratio"):
        table.add_column(column)
    table.add_row("vioapr, one batch", f"{own:.3f}", "1")
    table.add_row("evo, walk by walk", f"{theirs:.3f}", f"{np.median(ratios):.0f}")
    publish(table, "performance.md", "evaluation", update_docs=options.update_docs)
    print(f"largest difference between the medians of the two: {difference:.1e}")
    if options.json:
        results = {
            "machine": describe_machine(["numpy", "evo"]),
            "walks": walks,
            "frames": frames,
            "vioapr_s": own,
            "evo_s": theirs,
            "evo_over_vioapr": float(np.median(ratios)),
            "largest_difference": difference,
        }
        write_json(options.json, results)


if __name__ == "__main__":
    main()
