"""Accuracy of every method on the benchmark of real predictions; writes docs/results/accuracy.md.

    VIOAPR_DATA=... python benchmarks/accuracy.py [--json FILE] [--update-docs]

Figures are means over walks of each walk's median and 95th percentile, beside the share of
frames that have a pose and the raw regressor on the same frames.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from common import data_folder, replace_section, write_json
from rich.console import Console

from vioapr.cli.console import progress
from vioapr.cli.evaluate import print_tables
from vioapr.evaluation.cases import load_cases
from vioapr.evaluation.evaluate import count_ticks
from vioapr.evaluation.tables import Group, tabulate, to_records
from vioapr.fusion.methods import METHODS, default_params
from vioapr.report.formatting import format_levels, format_median, format_p95, format_share
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import to_plain

DOCS = Path(__file__).parent.parent / "docs" / "results" / "accuracy.md"


def markdown(groups: list[Group]) -> str:
    """The groups' rows as one table."""
    lines = [
        "| set, odometry, regressor | method | frames | share | median m / deg | raw | "
        "p95 m / deg | raw | levels % | raw |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for group in groups:
        label = f"**{group.set_name}, {group.vio}, {group.apr}** ({group.cases})"
        for row in group.rows:
            figures = [
                text(summary)
                for text in (format_median, format_p95, format_levels)
                for summary in (row.fused, row.raw)
            ]
            cells = [label, row.method, row.subset, format_share(row.fused), *figures]
            lines.append("| " + " | ".join(cells) + " |")
            label = ""
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run every method on every walk."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    parser.add_argument("--methods", default=",".join(METHODS))
    options = parser.parse_args()
    data = data_folder()
    cases = load_cases(find_walks([data / "bench"]))
    params = default_params(options.methods.split(","))
    with progress("fusing", count_ticks(cases, params)) as tick:
        groups = tabulate(cases, params, tick=tick).groups
    print_tables(groups)
    if options.json:
        write_json(options.json, {"groups": to_plain(to_records(groups))})
    if options.update_docs:
        replace_section(DOCS, "table", markdown(groups))
        Console().print(f"updated {DOCS}")


if __name__ == "__main__":
    main()
