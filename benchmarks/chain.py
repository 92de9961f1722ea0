"""Method `chain` against its goals; writes its sections of docs/results/accuracy.md.

    VIOAPR_DATA=... python benchmarks/chain.py [--json FILE] [--update-docs]

Tables over the benchmark of real predictions, on all frames with ground truth, prediction and
tracking, as means over walks of each walk's own figures: ratios to the other methods in the same
run, the ablation, and calibration with risk and coverage. Frames on which the method gives no
answer ("not here") count in the share alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import data_folder, describe_machine, replace_section, write_json
from numpy.typing import NDArray
from scipy import stats

from vioapr.cli.console import progress
from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.evaluate import Result, count_ticks, evaluate_cases
from vioapr.fusion.chain.params import ChainParams
from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import fuse_walks
from vioapr.fusion.types import Status
from vioapr.geometry import rigid
from vioapr.scene.walks import find_walks

DOCS = Path(__file__).parent.parent / "docs" / "results" / "accuracy.md"
TAIL_DEGREES = 2
"""Degrees of freedom of the stated distribution."""
SHARES = (10, 25, 50, 75, 100)
VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "gravity known": {"gravity": "known"},
    "gravity not used": {"gravity": "none"},
    "no view weights": {"view_weights": False},
    "no drift estimation": {"estimate_drift": False},
    "no heavy tails": {"heavy_tails": False},
    "no look-at correction": {"look_at": False},
    "one hypothesis": {"hypotheses": False},
    "answers even where it says not here": {"not_here": False},
}
Errors = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Position in m and orientation in deg, shape (n,)."""


def errors_of(case: Case, fused: FusedWalk) -> Errors:
    """Of the frames that count; NaN without an answer."""
    inputs = case.frames.inputs
    rows = case.has_gt & inputs.has_apr & inputs.tracking_ok
    gt, pose = case.gt_world_from_cam.at(rows), fused.world_from_cam.at(rows)
    return rigid.distance_m(gt, pose), rigid.angle_deg(gt, pose)


def figures_of(errors: Errors) -> list[float]:
    """Median m, median deg, p95 m, p95 deg."""
    known = [error[np.isfinite(error)] for error in errors]
    return [float(f(error)) for f in (np.median, _p95) for error in known]


def _p95(values: NDArray[np.float64]) -> float:
    return float(np.percentile(values, 95))


def by_group(cases: Sequence[Case], values: Sequence[Any]) -> dict[tuple[str, ...], NDArray]:
    """Means over the walks of each group."""
    groups: dict[tuple[str, ...], list[Any]] = {}
    for case, value in zip(cases, values, strict=True):
        groups.setdefault(case.group, []).append(value)
    return {key: np.mean(groups[key], axis=0) for key in sorted(groups)}


def in_batches(
    cases: Sequence[Case], fuse: Callable[[list[Case]], list[FusedWalk]], size: int = 28
) -> list[FusedWalk]:
    """Fuse walks of like lengths together."""
    order = sorted(range(len(cases)), key=lambda index: len(cases[index].frames))
    found: dict[int, FusedWalk] = {}
    for start in range(0, len(order), size):
        rows = order[start : start + size]
        found.update(zip(rows, fuse([cases[row] for row in rows]), strict=True))
    return [found[index] for index in range(len(cases))]


def run_chain(cases: Sequence[Case], **params: Any) -> list[FusedWalk]:
    """Fuse all cases by the default method."""
    method, chosen = METHODS["chain"], ChainParams(**params)
    return in_batches(
        cases,
        lambda part: fuse_walks(method, chosen, [case.frames for case in part], view="live"),
    )


def run_others(cases: Sequence[Case]) -> tuple[list[Result], list[Result]]:
    """What the goals compare with, in the same run: VIO-APR and iSAM2."""
    names = ("vio-apr", "pose-graph")
    params = {name: METHODS[name].params_type() for name in names}
    with progress("fusing by the others", count_ticks(cases, list(names))) as tick:
        results = evaluate_cases(cases, params, tick=tick)
    return results[: len(cases)], results[len(cases) :]


def figures_of_others(
    cases: Sequence[Case], paper: Sequence[Result], graph: Sequence[Result]
) -> dict[str, dict[tuple[str, ...], NDArray]]:
    """Their figures, by what the goals ask for."""
    chosen, everywhere = [], []
    for result in paper:
        errors = (result.errors.position_m, result.errors.orientation_deg)
        is_chosen = result.has_status(Status.KEYFRAME, Status.OPTIMIZED)
        chosen.append(figures_of((errors[0][is_chosen], errors[1][is_chosen])))
        raw = (result.raw_errors.position_m, result.raw_errors.orientation_deg)
        filled = [np.where(np.isfinite(e), e, r) for e, r in zip(errors, raw, strict=True)]
        everywhere.append(figures_of((filled[0], filled[1])))
    raws = [figures_of((r.raw_errors.position_m, r.raw_errors.orientation_deg)) for r in paper]
    graphs = [figures_of((r.errors.position_m, r.errors.orientation_deg)) for r in graph]
    return {
        "raw": by_group(cases, raws),
        "vio-apr chosen": by_group(cases, chosen),
        "vio-apr all": by_group(cases, everywhere),
        "isam2": by_group(cases, graphs),
    }


def share_answered(case: Case, fused: FusedWalk) -> float:
    """Of the frames that count."""
    return float(np.isfinite(errors_of(case, fused)[0]).mean())


def goal_table(ours: dict, shares: dict, others: dict) -> tuple[str, dict]:
    """Our figures over the others'."""
    lines = [
        "| set, odometry, regressor | answers % | median m / deg | p95 m / deg | over raw | over "
        "VIO-APR keyframes + optimized | over the better of raw and VIO-APR, all frames | over "
        "iSAM2 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    ratios: dict[str, dict[str, list[float]]] = {
        name: {} for name in ("raw", "paper", "better", "isam2")
    }
    for key, figures in ours.items():
        better = np.minimum(others["raw"][key], others["vio-apr all"][key])
        rows = {
            "raw": figures / others["raw"][key],
            "paper": figures / others["vio-apr chosen"][key],
            "better": figures / better,
            "isam2": figures / others["isam2"][key],
        }
        for name, values in rows.items():
            ratios[name][", ".join(key)] = values.tolist()
        cells = [
            ", ".join(key),
            f"{100 * shares[key]:.1f}",
            f"{figures[0]:.3f} / {figures[1]:.2f}",
            f"{figures[2]:.3f} / {figures[3]:.2f}",
            *(" / ".join(f"{value:.2f}" for value in rows[name]) for name in rows),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    simulated = [key for key in ours if key[1] == "sim"]
    means = {
        name: np.mean([ratios[name][", ".join(key)] for key in simulated], axis=0)
        for name in ratios
    }
    texts = {name: " / ".join(f"{v:.2f}" for v in values) for name, values in means.items()}
    lines.append(
        f"| **mean over the {len(simulated)} simulated cells** | | | | {texts['raw']} | "
        f"{texts['paper']} | {texts['better']} | {texts['isam2']} |"
    )
    note = "\nRatios: median m / median deg / p95 m / p95 deg; below 1 is better than the other.\n"
    return "\n".join(lines) + "\n" + note, {"ratios": ratios}


def ablation_table(cases: Sequence[Case]) -> tuple[str, dict]:
    """What each part is worth: simulated odometry and real ones."""
    kinds = {"simulated odometry": ("sim",), "dslam": ("dslam",), "dso": ("dso",),
             "arkit": ("arkit",)}  # fmt: skip
    heads = [f"{kind}: median m / deg, p95 m / deg" for kind in kinds]
    lines = [
        "| variant | " + " | ".join(heads) + " |",
        "|---|" + "---|" * len(kinds),
    ]
    results = {}
    base: dict[str, NDArray] = {}
    for name, params in VARIANTS.items():
        fused = run_chain(cases, **params)
        figures = [figures_of(errors_of(*pair)) for pair in zip(cases, fused, strict=True)]
        groups = by_group(cases, figures)
        cells = []
        for kind, vios in kinds.items():
            values = np.mean([np.log(v) for key, v in groups.items() if key[1] in vios], axis=0)
            base.setdefault(kind, values)
            ratio = np.exp(values - base[kind])
            results[f"{name}, {kind}"] = ratio.tolist()
            cells.append(" / ".join(f"{value:.2f}" for value in ratio))
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    note = "\nFigures over those of the method as it is, geometric means over the cells.\n"
    return "\n".join(lines) + "\n" + note, results


def calibration_table(
    cases: Sequence[Case], fused: Sequence[FusedWalk]
) -> tuple[str, dict[str, Any]]:
    """Shares within the stated radii."""
    promised = [float(stats.f.cdf(k * k / 3, 3, TAIL_DEGREES)) for k in (1, 2, 3)]
    shares = []
    for case, walk in zip(cases, fused, strict=True):
        inputs = case.frames.inputs
        rows = case.has_gt & inputs.has_apr & inputs.tracking_ok
        sigmas = (walk.sigma_position_m, walk.sigma_orientation_deg)
        shares.append(
            [
                float(np.mean((error <= k * sigma[rows])[np.isfinite(error)]))
                for error, sigma in zip(errors_of(case, walk), sigmas, strict=True)
                if sigma is not None
                for k in (1, 2, 3)
            ]
        )
    groups = by_group(cases, shares)
    lines = [
        "| set, odometry, regressor | position within 1 / 2 / 3 sigma % | orientation |",
        "|---|---|---|",
        f"| **promised** (Student's t, {TAIL_DEGREES} degrees of freedom, 3 axes) | "
        f"{_percent(promised)} | {_percent(promised)} |",
    ]
    lines += [
        f"| {', '.join(key)} | {_percent(row[:3])} | {_percent(row[3:])} |"
        for key, row in groups.items()
    ]
    mean = np.mean(list(groups.values()), axis=0)
    lines.append(f"| **mean over all cells** | {_percent(mean[:3])} | {_percent(mean[3:])} |")
    return "\n".join(lines) + "\n", {"promised": promised, "mean": mean.tolist()}


def _percent(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " / ".join(f"{100 * value:.0f}" for value in values)


def risk_table(
    cases: Sequence[Case], fused: Sequence[FusedWalk], results: Sequence[Result]
) -> tuple[str, dict[str, Any]]:
    """Mean errors of the most certain frames, and VIO-APR's keyframes at the same coverage."""
    rows = []
    for case, walk, paper in zip(cases, fused, results, strict=True):
        inputs = case.frames.inputs
        counted = case.has_gt & inputs.has_apr & inputs.tracking_ok
        if walk.sigma_position_m is None:
            raise AssertionError("chain states its uncertainty")
        error, sigma = errors_of(case, walk)[0], walk.sigma_position_m[counted]
        is_answer = np.isfinite(error)
        error = error[is_answer][np.argsort(sigma[is_answer], kind="stable")]
        curve = [float(error[: max(1, len(error) * share // 100)].mean()) for share in SHARES]
        keyframes = paper.has_status(Status.KEYFRAME)
        covered = int(keyframes.sum())
        theirs = float(paper.errors.position_m[keyframes].mean()) if covered else np.nan
        ours = float(error[: min(covered, len(error))].mean()) if covered else np.nan
        rows.append([*curve, covered / len(keyframes), theirs, ours])
    groups = by_group(cases, rows)
    lines = [
        "| set, odometry, regressor | "
        + " | ".join(f"surest {share} %" for share in SHARES)
        + " | share of keyframes of VIO-APR % | their error | ours on as many frames |",
        "|---|" + "---|" * (len(SHARES) + 3),
    ]
    for key, row in groups.items():
        cells = [*(f"{value:.3f}" for value in row[: len(SHARES)])]
        cells += [f"{100 * row[-3]:.0f}", f"{row[-2]:.3f}", f"{row[-1]:.3f}"]
        lines.append(f"| {', '.join(key)} | " + " | ".join(cells) + " |")
    scaled = np.mean([row[: len(SHARES)] / row[len(SHARES) - 1] for row in groups.values()], axis=0)
    beats = np.mean([row[-1] / row[-2] for row in groups.values()])
    cells = [f"**{value:.2f}**" for value in scaled]
    lines.append(f"| **over all cells, relative** | {' | '.join(cells)} | | 1 | **{beats:.2f}** |")
    curve = {"shares": list(SHARES), "relative": scaled.tolist(), "over_keyframes": float(beats)}
    return "\n".join(lines) + "\n", curve


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = data_folder()
    cases = load_cases(find_walks([data / "bench"]))
    fused = run_chain(cases)
    ours = by_group(
        cases, [figures_of(errors_of(*pair)) for pair in zip(cases, fused, strict=True)]
    )
    answered = [share_answered(*pair) for pair in zip(cases, fused, strict=True)]
    shares = by_group(cases, answered)
    paper, graph = run_others(cases)
    sections = {
        "goals": goal_table(ours, shares, figures_of_others(cases, paper, graph)),
        "calibration": calibration_table(cases, fused),
        "risk": risk_table(cases, fused, paper),
        "ablation": ablation_table(cases),
    }
    for name, (text, _) in sections.items():
        print(f"\n{name}\n{text}")
        if options.update_docs:
            replace_section(DOCS, name, text)
    if options.json:
        figures = {name: data for name, (_, data) in sections.items()}
        write_json(options.json, {"machine": describe_machine(["numpy", "gtsam"]), **figures})


if __name__ == "__main__":
    main()
