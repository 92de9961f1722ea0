"""What a calibration gains on walks that it was not made from, and how many walks it takes.

    VIOAPR_DATA=... python benchmarks/calibration.py [--json FILE] [--sets NAMES] [--update-docs]

Every walk is judged with what other walks say: one or two of them (those of the same scene first),
those of the same scene where there are any ("scene"), or all others of the set ("set"). Figures are
ratios to the raw regressor (median m / deg, p95 m / deg), geometric means over walks, with and
without calibration, and the share of frames within 1, 2 and 3 stated sigmas.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common import data_folder, publish, write_json
from rich.table import Table

from vioapr.cli.console import progress
from vioapr.evaluation.calibration.calibrate import by_walk, group_by_pair, judge_left_out
from vioapr.evaluation.calibration.choice import Choice, choose_settings
from vioapr.evaluation.calibration.sigmas import PROMISED
from vioapr.evaluation.calibration.trials import Trials
from vioapr.evaluation.cases import Case, load_cases
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import to_plain
from vioapr.schemas.calibration import LeftOut


class Fold(NamedTuple):
    """A walk to be judged, and the walks to calibrate with, those of its own scene first."""

    held: list[Case]
    same_scene: list[list[Case]]
    others: list[list[Case]]

    def pick(self, count: str) -> list[Case]:
        """Cases of a number of walks; of "scene", of all of it; of "set", of all scenes."""
        walks = [*self.same_scene, *self.others]
        if count == "scene":
            walks = self.same_scene or self.others
        elif count != "set":
            walks = walks[: int(count)]
        return [case for walk in walks for case in walk]


def scene_of(walk: str) -> str:
    """A walk's name without its last part, which is its number."""
    return walk.rsplit("_", 1)[0]


def folds_of(cases: Sequence[Case]) -> list[Fold]:
    """Every walk with the others; these begin at the next one, so that each comes first once."""
    walks = list(by_walk(cases).values())
    folds: list[Fold] = []
    for index, held in enumerate(walks):
        rest = walks[index + 1 :] + walks[:index]
        scene = scene_of(held[0].walk)
        same = [walk for walk in rest if scene_of(walk[0].walk) == scene]
        others = [walk for walk in rest if scene_of(walk[0].walk) != scene]
        folds.append(Fold(held, same, others))
    return folds


def judge_group(cases: Sequence[Case], counts: Sequence[str]) -> dict[str, Any]:
    """Judge one set, tracker and regressor, with calibrations by each number of walks."""
    trials = Trials(progress)
    folds = folds_of(cases)
    counts = [count for count in counts if not count.isdigit() or int(count) < len(folds)]
    picks = [fold.pick(count) for count in counts for fold in folds]
    chosen = choose_settings(picks, trials)
    set_name, tracker, regressor = cases[0].group
    results: dict[str, Any] = {}
    for number, count in enumerate(counts):
        own = chosen[number * len(folds) : (number + 1) * len(folds)]
        results[count] = judge_folds(folds, own, trials)
    return {
        "set": set_name,
        "tracker": tracker,
        "regressor": regressor,
        "walks": len(folds),
        "by_count": results,
    }


def judge_folds(folds: Sequence[Fold], choices: Sequence[Choice], trials: Trials) -> dict[str, Any]:
    """All walks together, and each by itself with the setting that was chosen for it."""
    held = [fold.held for fold in folds]
    whole = judge_left_out(held, choices, trials)
    singles: list[dict[str, Any]] = []
    for fold, choice in zip(folds, choices, strict=True):
        alone = judge_left_out([fold.held], [choice], trials)
        setting = to_plain(choice.setting)
        singles.append({"walk": fold.held[0].walk, "setting": setting, **to_plain(alone)})
    return {**to_plain(whole), "by_walk": singles}


def pool(records: Iterable[dict[str, Any]], count: str) -> dict[str, Any]:
    """Several groups' figures: geometric means of ratios, means of coverage, over all walks."""
    walks = [walk for one in records for walk in one["by_count"].get(count, {}).get("by_walk", [])]
    if not walks:
        return {}
    ratios = {
        name: np.exp(np.mean([np.log(list(walk[name].values())) for walk in walks], axis=0))
        for name in ("calibrated", "uncalibrated")
    }
    coverage = {
        name: np.mean([list(walk[name].values()) for walk in walks], axis=0)
        for name in ("position", "orientation")
    }
    return {name: value.round(4).tolist() for name, value in (ratios | coverage).items()}


def sets_of(records: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Groups by set and tracker."""
    grouped: dict[str, list[dict[str, Any]]] = {}
    for record in records:
        grouped.setdefault(f"{record['set']} {record['tracker']}", []).append(record)
    return grouped


def table_of(records: Sequence[dict[str, Any]], counts: Sequence[str]) -> Table:
    """A row a set, tracker and number of walks to calibrate with."""
    promised = " ".join(f"{100 * share:.0f}" for share in PROMISED)
    table = Table(title="Ratios to the raw regressor, and shares within 1, 2, 3 sigma")
    for header in ("set, tracker", "walks", "calibrated", "without", "worst regressor"):
        table.add_column(header)
    for header in (f"position % ({promised})", "orientation %"):
        table.add_column(header)
    for name, members in sets_of(records).items():
        for count in counts:
            pooled = pool(members, count)
            if not pooled:
                continue
            results = [one["by_count"].get(count) for one in members]
            groups = [list(one["calibrated"].values()) for one in results if one]
            cells = [
                " ".join(f"{ratio:.2f}" for ratio in ratios)
                for ratios in (
                    pooled["calibrated"],
                    pooled["uncalibrated"],
                    np.max(groups, axis=0),
                )
            ]
            shares = [
                " ".join(f"{100 * share:.0f}" for share in pooled[part])
                for part in ("position", "orientation")
            ]
            table.add_row(name, count, *cells, *shares)
    return table


def main() -> None:
    """Judge every set, tracker and regressor."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--sets", default="", help="names, separated by commas; default: all")
    parser.add_argument("--trackers", default="", help="the same of trackers")
    parser.add_argument("--regressors", default="", help="the same of regressors")
    parser.add_argument("--counts", default="1,2,scene,set", help="of walks to calibrate with")
    parser.add_argument("--all-draws", action="store_true", help="of simulated trackers")
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = data_folder()
    cases = load_cases(find_walks([data / "bench"]))
    chosen = (options.sets, options.trackers, options.regressors)
    for member, names in enumerate(chosen):
        wanted = [name for name in names.split(",") if name]
        cases = [case for case in cases if not wanted or case.group[member] in wanted]
    if not options.all_draws:
        cases = [case for case in cases if case.vio in (case.group[1], f"{case.group[1]}0")]
    counts = options.counts.split(",")
    records: list[dict[str, Any]] = []
    for set_name in dict.fromkeys(case.set_name for case in cases):
        own = [case for case in cases if case.set_name == set_name]
        for group in group_by_pair(own).values():
            records.append(judge_group(group, counts))
    publish(table_of(records, counts), "calibration.md", "walks", update_docs=options.update_docs)
    if options.json:
        pooled = {
            name: {count: pool(members, count) for count in counts}
            for name, members in sets_of(records).items()
        }
        promised = dict(zip(LeftOut.__struct_fields__[3:], [PROMISED.tolist()] * 2, strict=True))
        write_json(options.json, {"promised": promised, "sets": pooled, "groups": records})


if __name__ == "__main__":
    main()
