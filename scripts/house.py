"""Measure how the package is built: sizes, private helpers, imports, repetition, start-up.

    python scripts/house.py [SRC] [--json FILE]

SRC is the folder that holds `vioapr/`, by default this checkout's `src`; give another checkout's
for a table of before and after. Start-up is the CPU time of a new process, the least of several,
less that of an interpreter that imports nothing.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import resource
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

Function = ast.FunctionDef | ast.AsyncFunctionDef
WINDOW = 6
"""Lines of a run that counts as repeated where it stands twice."""


def sizes(trees: dict[str, ast.Module], lines: dict[str, int]) -> dict[str, object]:
    """Files and functions by their number of lines."""
    functions = [
        node.end_lineno - node.lineno + 1
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, Function) and node.end_lineno is not None
    ]
    return {
        "files": len(lines),
        "lines": sum(lines.values()),
        "lines per file (median, p90, max)": spread(list(lines.values())),
        "functions": len(functions),
        "lines per function (median, p90, max)": spread(functions),
    }


def spread(values: Sequence[int]) -> list[int]:
    """Median, 90th percentile and largest."""
    return [round(float(np.quantile(values, q))) for q in (0.5, 0.9, 1.0)]


def private_functions(trees: dict[str, ast.Module], sources: dict[str, str]) -> dict[str, object]:
    """How many private functions of modules are named just once outside their definition."""
    uses = [
        len(re.findall(rf"\b{node.name}\b", sources[name])) - 1
        for name, tree in trees.items()
        for node in tree.body
        if isinstance(node, Function) and node.name.startswith("_") and node.name[:2] != "__"
    ]
    share = float(np.mean(np.array(uses) <= 1)) if uses else 0.0
    return {"private functions": len(uses), "called once (share)": round(share, 3)}


def imports(trees: dict[str, ast.Module]) -> dict[str, object]:
    """The modules that import the most others, and that the most others import."""
    out: dict[str, set[str]] = defaultdict(set)
    into: dict[str, set[str]] = defaultdict(set)
    for name, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vioapr"):
                assert node.module is not None
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    target = inner if inner in trees else node.module
                    if target != name:
                        out[name].add(target)
                        into[target].add(name)

    def largest(edges: dict[str, set[str]]) -> dict[str, int]:
        ranked = sorted(edges.items(), key=lambda item: (-len(item[1]), item[0]))
        return {name.removeprefix("vioapr."): len(targets) for name, targets in ranked[:5]}

    return {"largest fan-out": largest(out), "largest fan-in": largest(into)}


def repeated_runs(sources: dict[str, str]) -> dict[str, object]:
    """Runs of lines that stand in two places, without imports, comments and blank lines."""
    seen: dict[tuple[str, ...], set[tuple[str, int]]] = defaultdict(set)
    for name, text in sources.items():
        kept = [line.strip() for line in text.splitlines()]
        kept = [x for x in kept if len(x) > 3 and not x.startswith(("#", "from ", "import "))]
        for start in range(len(kept) - WINDOW + 1):
            seen[tuple(kept[start : start + WINDOW])].add((name, start))
    places = {place for where in seen.values() if len(where) > 1 for place in where}
    runs = sum((name, start - 1) not in places for name, start in places)
    return {f"repeated runs of {WINDOW} lines": runs}


def start_up(source: Path, repeats: int = 5) -> dict[str, object]:
    """CPU seconds of `import vioapr` and `vioapr --help`, beyond an empty interpreter."""
    environment = {**os.environ, "PYTHONPATH": str(source)}

    def cpu_s(code: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-c", code]
        subprocess.run(command, check=False, capture_output=True, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    code = {
        "empty": "",
        "import vioapr": "import vioapr",
        "vioapr --help": "from vioapr.cli import main; main(['--help'])",
    }
    least = {name: min(cpu_s(text) for _ in range(repeats)) for name, text in code.items()}
    return {
        f"{name}: CPU s": round(seconds - least["empty"], 3)
        for name, seconds in least.items()
        if name != "empty"
    }


def measure(source: Path) -> dict[str, object]:
    """All figures of one checkout."""
    paths = sorted((source / "vioapr").rglob("*.py"))
    names = {
        path: ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__")
        for path in paths
    }
    sources = {names[path]: path.read_text(encoding="utf-8") for path in paths}
    trees = {name: ast.parse(text) for name, text in sources.items()}
    lines = {name: text.count("\n") for name, text in sources.items()}
    return {
        **sizes(trees, lines),
        **private_functions(trees, sources),
        **imports(trees),
        **repeated_runs(sources),
        **start_up(source),
    }


def main() -> None:
    """Print the figures, a line each."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("source", type=Path, nargs="?", default=Path(__file__).parents[1] / "src")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    figures = measure(options.source)
    for name, value in figures.items():
        print(f"{name}: {value}")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
