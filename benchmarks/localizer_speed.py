"""What the whole localizer costs beside the bare regressor, in the same runtime and run.

    python benchmarks/localizer_speed.py [--quick] [--json PATH] [--docs docs/results/localizer.md]

Networks are `vioapr.regression`'s with random weights, which are as fast as trained ones. The
whole file and its parts take turns, so that a slow spell of the machine hits all; shares are
medians of the paired ratios. "Regressor" is the network alone; "image to pose" is preprocessing
and network, what an app without fusion runs. Memory is the peak of a process that does nothing
but load the file and localize ten frames.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
import tyro
from common import describe_machine, replace_section, write_json
from rich.console import Console
from rich.table import Table

from vioapr.cli.console import progress
from vioapr.export.exporter import Exporter
from vioapr.fusion.methods import METHODS
from vioapr.regression.networks import build
from vioapr.runtime.bench import Run, example_feed, part_runs, summarize_ms, time_in_turns
from vioapr.runtime.session import open_session
from vioapr.schemas.base import to_plain
from vioapr.schemas.regressor import RegressorSpec

MODELS = {"posenet": "ResNet-34", "mobile": "MobileNetV3-Large"}
PRECISIONS = ("fp16w", "int8w", "int8-qdq")
SIZE_PX = (480, 640)

_PEAK = """
import sys
from pathlib import Path
import numpy as np
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.geometry.rigid import Rigid3
localizer = OnnxLocalizer(Path(sys.argv[1]), threads=1)
for k in range(10):
    image = np.zeros((480, 640, 3), dtype=np.uint8)
    localizer.update(k, image, Rigid3.identity())
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) / 1e3)
"""


@dataclass(frozen=True)
class Config:
    """Size of the job."""

    json: Path | None = None
    """Where to write the results."""
    docs: Path | None = None
    """Document whose section `localizer_speed` to write."""
    quick: bool = False
    """A small job that only shows that everything runs."""
    repeats: int = 100
    """Frames of every measurement."""


def export_all(folder: Path, model: str, precisions: tuple[str, ...]) -> dict[str, Path]:
    """Files by `method precision`; other precisions than fp32 with chain only."""
    torch.manual_seed(0)
    spec = RegressorSpec(model, ("scene",))
    network = build(spec).eval()
    files = {}
    for method in ("vio-apr", "chain"):
        chosen = METHODS[method]
        exporter = Exporter(network, spec, chosen, chosen.params_type())
        for precision in ("fp32", *(precisions if method == "chain" else ())):
            images = calibration if precision == "int8-qdq" else None
            path = folder / f"{model}.{method}.{precision}.onnx"
            path.write_bytes(exporter.export(precision, images).content)
            files[f"{method} {precision}"] = path
    return files


def calibration() -> list[np.ndarray]:
    """Inputs with the statistics of images; which ones does not matter for speed."""
    rng = np.random.default_rng(0)
    return [rng.standard_normal((1, 3, 224, 224)).astype(np.float32) for _ in range(8)]


def measure(path: Path, threads: int, repeats: int) -> dict[str, Any]:
    """Times of the whole and its parts, in turns, and paired ratios."""
    session, contract = open_session(path, threads)
    feed = example_feed(contract, SIZE_PX)
    runs: dict[str, Run] = {"whole": lambda: session.run(None, feed)}
    runs |= part_runs(path, contract, feed, threads)
    seconds = {name: np.array(times) for name, times in time_in_turns(runs, repeats).items()}
    network = seconds["network"]
    image_to_pose = network + seconds["preprocess"]
    return {
        "ms": {name: to_plain(summarize_ms(list(values))) for name, values in seconds.items()},
        "whole_over_regressor": float(np.median(seconds["whole"] / network)),
        "whole_over_image_to_pose": float(np.median(seconds["whole"] / image_to_pose)),
        "fusion_over_regressor": float(np.median(seconds["fusion"] / network)),
    }


def describe_file(path: Path) -> dict[str, Any]:
    """Size, operators by part, and peak memory."""
    nodes = onnx.load(str(path)).graph.node
    done = subprocess.run(
        [sys.executable, "-c", _PEAK, str(path)], capture_output=True, text=True, check=True
    )
    return {
        "file_mb": path.stat().st_size / 1e6,
        "nodes": dict(Counter(node.name.split("/")[0] for node in nodes)),
        "peak_memory_mb": float(done.stdout),
    }


def main(config: Config) -> None:
    """Measure all networks, methods, precisions and thread counts."""
    repeats = 5 if config.quick else config.repeats
    models = ["mobile"] if config.quick else list(MODELS)
    precisions = () if config.quick else PRECISIONS
    count = len(models) * (2 + len(precisions))
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name, progress("measuring", count) as tick:
        for model in models:
            for key, path in export_all(Path(name), model, precisions).items():
                found = describe_file(path)
                for threads in (1, 2):
                    found[f"threads_{threads}"] = measure(path, threads, repeats)
                results[f"{MODELS[model]} {key}"] = found
                path.unlink()
                tick()
    Console(width=150).print(make_table(results))
    machine = describe_machine(["numpy", "torch", "onnxruntime"])
    if config.docs is not None:
        replace_section(config.docs, "localizer_speed", to_markdown(results, machine))
    if config.json is not None:
        content = {"machine": machine, "image_px": SIZE_PX, "results": results}
        write_json(config.json, content)


def make_table(results: dict[str, Any]) -> Table:
    """A row a file and thread count."""
    table = Table(title=f"images {SIZE_PX[1]}x{SIZE_PX[0]}, medians in ms")
    columns = ("file", "MB", "peak MB", "threads", "whole", "preprocess", "network", "fusion")
    for column in (*columns, "whole/network", "whole/image to pose"):
        table.add_column(column, justify="right")
    for name, found in results.items():
        for threads in (1, 2):
            timed = found[f"threads_{threads}"]
            table.add_row(
                name,
                f"{found['file_mb']:.1f}",
                f"{found['peak_memory_mb']:.0f}",
                str(threads),
                *(f"{timed['ms'][part]['p50']:.2f}" for part in timed["ms"]),
                f"{timed['whole_over_regressor']:.3f}",
                f"{timed['whole_over_image_to_pose']:.3f}",
            )
    return table


def to_markdown(results: dict[str, Any], machine: dict[str, str]) -> str:
    """The figures as a table, with the machine's name."""
    lines = [
        f"{machine['cpu']}, {machine['cores']} cores, onnxruntime {machine['onnxruntime']}; images "
        f"{SIZE_PX[1]}x{SIZE_PX[0]}; ms are medians, 1 / 2 threads; shares are medians of paired "
        "ratios.",
        "",
        "| | MB | peak memory MB | whole ms | preprocessing | network | fusion "
        "| whole / image to pose | whole / network |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, found in results.items():
        timed = [found[f"threads_{threads}"] for threads in (1, 2)]
        cells = [f"{found['file_mb']:.1f}", f"{found['peak_memory_mb']:.0f}"]
        for part in ("whole", "preprocess", "network", "fusion"):
            cells.append(" / ".join(f"{one['ms'][part]['p50']:.1f}" for one in timed))
        for ratio in ("whole_over_image_to_pose", "whole_over_regressor"):
            cells.append(" / ".join(f"{one[ratio]:.3f}" for one in timed))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    nodes = {name.split()[1]: found["nodes"] for name, found in results.items()}
    counts = ", ".join(f"{method} {count['fusion']}" for method, count in nodes.items())
    lines += ["", f"Operators of fusion: {counts}; of preprocessing: {count_of(nodes)}."]
    return "\n".join(lines) + "\n"


def count_of(nodes: dict[str, dict[str, int]]) -> int:
    """Operators of preprocessing, the same in all files."""
    return next(iter(nodes.values()))["preprocess"]


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
