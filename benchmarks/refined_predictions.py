"""Methods on predictions that were refined and state sigmas; for docs/results/accuracy.md.

    VIOAPR_HRAPR=... python benchmarks/refined_predictions.py [--clone FOLDER] [--json FILE]
        [--methods NAMES] [--seed N] [--draws N] [--update-docs]

The folder is a clone of https://github.com/lck666666/HR-APR. Refinement lowers the median error and
leaves, or makes, outliers: other error levels and heavier tails on the same walks. The default
method also runs with sigmas that the similarity scores tell, learnt from the other scenes.
Figures are ratios to the raw regressor's on the same frames, geometric means over regressors of
each one's mean over walks.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, replace_section, write_json
from hrapr_walks import KINDS, Predictions, check_readings, make_cases, read_all

from vioapr.cli.console import progress
from vioapr.evaluation.evaluate import Result, count_ticks, evaluate_cases
from vioapr.evaluation.risk_coverage import risk_coverage
from vioapr.evaluation.tables import Group, group_results, to_records
from vioapr.fusion.methods import DEFAULT_METHOD, METHODS, default_params
from vioapr.schemas.base import to_plain

WITH_SIGMAS = f"{DEFAULT_METHOD} + sigmas"
_FIGURES = ("median_m", "median_deg", "p95_m", "p95_deg")


def run_methods(
    scenes: Sequence[Predictions], methods: Sequence[str], seed: int, draws: int
) -> list[Result]:
    """Run methods on all cases, and the default one once more with sigmas."""
    params = default_params(methods)
    cases = list(make_cases(scenes, seed=seed, draws=draws, with_sigmas=False))
    with progress("fusing", count_ticks(cases, params)) as tick:
        results = evaluate_cases(cases, params, tick=tick)
    if DEFAULT_METHOD in params:
        stated = list(make_cases(scenes, seed=seed, draws=draws, with_sigmas=True))
        alone = {DEFAULT_METHOD: params[DEFAULT_METHOD]}
        with progress("fusing with sigmas", count_ticks(stated, alone)) as tick:
            more = evaluate_cases(stated, alone, tick=tick)
        results += [replace(result, method=WITH_SIGMAS) for result in more]
    return results


def ratios(groups: Sequence[Group]) -> dict[str, dict[str, Any]]:
    """By set and kind: the raw figures, and each method's over them, means over regressors."""
    made: dict[str, dict[str, Any]] = {}
    for set_name in dict.fromkeys(group.set_name for group in groups):
        for kind in KINDS:
            own = [g for g in groups if g.set_name == set_name and g.apr.split()[1] == kind]
            raw = np.array([[getattr(g.raw, name) for name in _FIGURES] for g in own])
            made[f"{set_name}, {kind}"] = {
                "raw": np.exp(np.log(raw).mean(axis=0)).tolist(),
                "methods": {
                    method: _mean_ratio(own, method)
                    for method in dict.fromkeys(row.method for group in own for row in group.rows)
                },
            }
    return made


def _mean_ratio(groups: Sequence[Group], method: str) -> dict[str, Any]:
    """Of all frames with a pose: four ratios, and content jumps and what is wrong and sure."""
    rows = [
        next(r for r in g.rows if (r.method, r.subset) == (method, "all frames")) for g in groups
    ]
    values = [[getattr(r.fused, n) / getattr(r.raw, n) for n in _FIGURES] for r in rows]
    others = [next(r for r in g.reliability if r.method == method).figures for g in groups]
    return {
        "ratios": np.exp(np.log(values).mean(axis=0)).tolist(),
        "jumps_per_min": float(np.mean([o.jumps_per_min for o in others])),
        "wrong_and_sure": float(np.mean([o.wrong_and_sure for o in others])),
    }


def similarity_risk(results: Sequence[Result]) -> dict[str, list[float]]:
    """Of raw positions with a stated sigma: mean error and risk area, by regressor and kind."""
    pooled: dict[str, list[tuple[Any, Any]]] = {}
    for result in results:
        sigma_m = result.case.frames.inputs.apr_sigma_m
        if result.method == WITH_SIGMAS and sigma_m is not None:
            key = f"{result.case.set_name}, {result.case.apr}"
            sigma = np.asarray(sigma_m)[result.case.has_gt]
            pooled.setdefault(key, []).append((result.raw_errors.position_m, sigma))
    found: dict[str, list[float]] = {}
    for key, pairs in pooled.items():
        error, sigma = (np.concatenate(part) for part in zip(*pairs, strict=True))
        mean = float(np.nanmean(error[np.isfinite(sigma)]))
        found[key] = [mean, risk_coverage(error, sigma).area]
    return found


def markdown(cells: dict[str, dict[str, Any]]) -> str:
    """A row a set and kind."""
    methods = [name for name in next(iter(cells.values()))["methods"] if name != "apr"]
    lines = [
        "| set, predictions | raw median, p95 (m / deg) | " + " | ".join(methods) + " |",
        "|---|---|" + "---|" * len(methods),
    ]
    for key, cell in cells.items():
        raw = "{:.3f} / {:.2f}, {:.2f} / {:.1f}".format(*cell["raw"])
        texts = [_text(cell["methods"][name]) for name in methods]
        lines.append(f"| {key} | {raw} | " + " | ".join(texts) + " |")
    note = (
        "\nRatios to raw: median m, deg, 95th percentile m, deg; in brackets content jumps a "
        "minute and, where sigmas are stated, the share of frames that are wrong and sure.\n"
    )
    return "\n".join(lines) + "\n" + note


def _text(cell: dict[str, Any]) -> str:
    wrong = cell["wrong_and_sure"]
    sure = "" if np.isnan(wrong) else f", {100 * wrong:.0f} %"
    figures = " ".join(f"{value:.2f}".lstrip("0") for value in cell["ratios"])
    return f"{figures} ({cell['jumps_per_min']:.0f}{sure})"


def main() -> None:
    """Read, check the conventions, run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--clone", type=Path, default=os.environ.get("VIOAPR_HRAPR"))
    parser.add_argument("--json", type=Path)
    parser.add_argument(
        "--methods", default=",".join(n for n, m in METHODS.items() if m.is_batched)
    )
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--draws", type=int, default=2)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    if not options.clone:
        sys.exit("name a clone of HR-APR's repository: --clone FOLDER, or set VIOAPR_HRAPR")
    scenes = read_all(Path(options.clone))
    readings = {
        f"{one.scene}, {one.regressor}, {kind}": check_readings(one, kind)
        for one in scenes
        for kind in one.world_from_cam
    }
    results = run_methods(scenes, options.methods.split(","), options.seed, options.draws)
    groups = group_results(results)
    cells, similarity = ratios(groups), similarity_risk(results)
    text = markdown(cells)
    print(text)
    for key, (mean, area) in similarity.items():
        print(f"similarity, {key}: mean error {mean:.3f} m, risk area {area:.3f} m")
    if options.json:
        content = {
            "seed": options.seed,
            "draws": options.draws,
            "cells": cells,
            "similarity": similarity,
            "readings": {
                key: {name: [float(v) for v in medians] for name, medians in found.items()}
                for key, found in readings.items()
            },
            "groups": to_plain(to_records(groups)),
        }
        write_json(options.json, content)
    if options.update_docs:
        replace_section(RESULTS / "accuracy.md", "refined", text)


if __name__ == "__main__":
    main()
