"""The smoother of method `chain` against the raw regressor; a section of docs/results/accuracy.md.

    VIOAPR_DATA=... python benchmarks/offline.py [--json FILE] [--update-docs]

Ratios over the benchmark of real predictions: median m / deg, p95 m / deg of each walk over those
of its raw predictions, as geometric means over walks and regressors. Once with drifts as learned
on the walk itself, once with drifts as measured on the other walks of the same tracker: the median
over 5 m of odometer, by VIO against ground truth, times a factor. Trackers that drift seldom but
far (DSO) need a larger one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import data_folder, describe_machine, publish, write_json
from numpy.typing import NDArray
from rich.table import Table
from scipy import stats

from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.metrics import pose_errors
from vioapr.fusion.chain.offline import smooth_walks
from vioapr.fusion.chain.params import ChainParams, Gravity
from vioapr.fusion.chain.passes import Passes, run_passes
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.geometry import quaternion
from vioapr.scene.walks import find_walks
from vioapr.work.progress import ignore

SPAN_M = 5.0
FACTORS = {"dso": 300.0}
"""From the median drift to the one that steps are given; 10 for the others."""
GRAVITY: dict[str, Gravity] = {"sim": "known", "dslam": "none", "dso": "none", "arkit": "none"}
MEDIANS = stats.chi2.ppf(0.5, [2, 1, 3])
"""Of squared drifts of tilt, heading and position, in units of the variance per axis."""
Kind = tuple[str, str]


def tracker_of(case: Case) -> str:
    """Simulated trackers differ in nothing but chance."""
    return case.vio.rstrip("0123456789")


def measure_drift(case: Case, passes: Passes) -> NDArray[np.float64] | None:
    """Of tilt, heading and position in a metre, rad^2 and m^2, shape (3,); None if too short."""
    rows = np.flatnonzero(case.has_gt[passes.rows])
    way_m = np.concatenate([[0.0], np.cumsum(passes.since[:, 0])])
    later = np.searchsorted(way_m[rows], way_m[rows] + SPAN_M)
    first, second = rows[later < len(rows)], rows[later[later < len(rows)]]
    if len(first) < 3:
        return None
    gt, vio = case.gt_world_from_cam.at(passes.rows), passes.vio_from_cam
    world = quaternion.multiply(gt.quat_xyzw, quaternion.inverse(vio.quat_xyzw))
    turn = quaternion.to_rotvec(
        quaternion.multiply(world[second], quaternion.inverse(world[first]))
    )
    moved = quaternion.rotate(world[first], vio.translation_m[second] - vio.translation_m[first])
    off_m = gt.translation_m[second] - gt.translation_m[first] - moved
    squares = [np.sum(part**2, axis=1) for part in (turn[:, :2], turn[:, 2:], off_m)]
    per_metre = np.median(squares / (way_m[second] - way_m[first]), axis=1)
    return np.asarray(per_metre / MEDIANS, dtype=np.float64)


def calibrated(cases: Sequence[Case]) -> list[ChainParams]:
    """Parameters for each case, from the other walks with the same tracker."""
    passes = run_passes(ChainParams(), [case.frames for case in cases], ignore)
    drifts = [measure_drift(*pair) for pair in zip(cases, passes, strict=True)]
    params: list[ChainParams] = []
    for case in cases:
        others = [
            drift
            for other, drift in zip(cases, drifts, strict=True)
            if other.walk != case.walk and drift is not None
        ]
        factor = FACTORS.get(tracker_of(case), 10.0)
        tilt, heading, position = (factor * np.median(others, axis=0)).tolist()
        params.append(
            ChainParams(
                gravity=GRAVITY[tracker_of(case)],
                tilt_drift_rad2_per_m=tilt,
                heading_drift_rad2_per_m=heading,
                position_drift_m2_per_m=position,
            )
        )
    return params


def figures_of(case: Case, fused: FusedWalk) -> NDArray[np.float64]:
    """Ratios to the raw regressor, then shares within 1, 2, 3 sigma: shape (10,)."""
    rows = case.has_gt & fused.is_localized
    errors = pose_errors(case.gt_world_from_cam.at(rows), fused.world_from_cam.at(rows))
    has_apr = case.has_gt & case.frames.inputs.has_apr
    raw = pose_errors(
        case.gt_world_from_cam.at(has_apr), case.frames.inputs.apr_world_from_cam.at(has_apr)
    )
    ours, theirs = (
        np.concatenate([np.percentile(each, share, axis=1) for share in (50, 95)])
        for each in (errors, raw)
    )
    assert fused.sigma_position_m is not None
    assert fused.sigma_orientation_deg is not None
    sigmas = fused.sigma_position_m[rows], fused.sigma_orientation_deg[rows]
    within = [
        np.mean(error < k * sigma)
        for error, sigma in zip(errors, sigmas, strict=True)
        for k in (1, 2, 3)
    ]
    return np.array([*np.log(ours / theirs), *within], dtype=np.float64)


def measure(cases: Sequence[Case]) -> dict[Kind, dict[str, list[float]]]:
    """For each set and tracker, and with drifts learned and calibrated: the mean figures."""
    kinds: dict[Kind, list[Case]] = {}
    for case in cases:
        kinds.setdefault((case.set_name, tracker_of(case)), []).append(case)
    found: dict[Kind, dict[str, list[float]]] = {}
    for kind, own in kinds.items():
        learned = smooth_walks(ChainParams(), [case.frames for case in own])
        given = [
            smooth_walks(params, [case.frames])[0]
            for case, params in zip(own, calibrated(own), strict=True)
        ]
        found[kind] = {}
        for name, fused in (("learned", learned), ("calibrated", given)):
            mean = np.mean([figures_of(*pair) for pair in zip(own, fused, strict=True)], axis=0)
            found[kind][name] = [*np.exp(mean[:4]).tolist(), *mean[4:].tolist()]
    return found


def table_of(found: dict[Kind, dict[str, list[float]]]) -> Table:
    """A row a set and tracker."""
    table = Table(title="Ratios to the raw regressor: median m, deg, p95 m, deg")
    for header in ("set, odometry", "drift", "ratios", "% within 1, 2, 3 sigma: m", "deg"):
        table.add_column(header)
    for (set_name, tracker), rows in found.items():
        for name, values in rows.items():
            ratios = " ".join(f"{value:.2f}" for value in values[:4])
            within = [f"{100 * value:.0f}" for value in values[4:]]
            table.add_row(
                f"{set_name}, {tracker}", name, ratios, " ".join(within[:3]), " ".join(within[3:])
            )
    return table


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = data_folder()
    start_s = time.perf_counter()
    found = measure(load_cases(find_walks([data / "bench"])))
    publish(table_of(found), "accuracy.md", "offline-chain", update_docs=options.update_docs)
    if options.json:
        figures = {", ".join(kind): rows for kind, rows in found.items()}
        seconds = time.perf_counter() - start_s
        machine = describe_machine(["numpy", "scipy"])
        write_json(options.json, {"machine": machine, "seconds": seconds, "figures": figures})


if __name__ == "__main__":
    main()
