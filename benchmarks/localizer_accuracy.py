"""What smaller numbers cost: trained localizers in every precision on the same walks.

    python benchmarks/localizer_accuracy.py SCENE MODEL... [--json FILE] [--update-docs]

SCENE and MODEL: a scene and folders of runs, such as benchmarks/regressors.py leaves. Every file
localizes the pictures of all test recordings; figures are means over them of each one's median
and 95th percentile on all frames, for the file's raw predictions and for its answers, and ratios
to the fp32 file's on the same frames.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from common import describe_machine, replace_section, write_json
from rich.progress import track

from vioapr.cli.main import main as vioapr
from vioapr.evaluation.metrics import pose_errors, summarize
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.runtime.walk import frames_of_recording, localize
from vioapr.scene.scene import Scene

DOCS = Path(__file__).parents[1] / "docs" / "results" / "localizer.md"
PRECISIONS = ("fp32", "fp16w", "int8w", "int8-qdq")
METHODS = ("chain", "vio-apr")
FIGURES = ("median_m", "median_deg", "p95_m", "p95_deg")


def export(model: Path, method: str, precision: str, scene: Path, out: Path) -> float:
    """One file; its size in MB."""
    words = ["export", model, "--method", method, "--precision", precision, "--out", out]
    words.append("--overwrite")
    if precision == "int8-qdq":
        words += ["--quantize-by", scene]
    if code := vioapr([str(word) for word in words]):
        sys.exit(code)
    return out.stat().st_size / 1e6


def judge(file: Path, scene: Scene) -> dict[str, Any]:
    """Figures of the raw predictions and of the answers, each (median m, deg, p95 m, deg)."""
    rows = []
    for id_ in track(scene.splits["test"], description=file.name, transient=True):
        frames = frames_of_recording(scene.recording_folder(id_))
        walk = localize(OnnxLocalizer(file), frames)  # a walk begins with an empty state
        assert walk.frames.gt is not None
        truth = walk.gt_world_from_cam(walk.frames.gt)
        raw = walk.paired.inputs.apr_world_from_cam
        rows.append([
            [*(getattr(summary, name) for name in FIGURES), summary.share]
            for summary in (
                summarize(pose_errors(truth, poses)) for poses in (raw, walk.fused.world_from_cam)
            )
        ])  # fmt: skip
    raw, answers = np.mean(np.array(rows, dtype=float), axis=0)
    return {"raw": raw[:4].tolist(), "answers": answers[:4].tolist(), "share": answers[4]}


def measure(scene: Scene, model: Path, method: str, folder: Path) -> dict[str, Any]:
    """All precisions of one localizer."""
    results = {}
    for precision in PRECISIONS:
        file = folder / f"{model.name}-{method}-{precision}.onnx"
        size_mb = export(model, method, precision, scene.folder, file)
        results[precision] = {"size_mb": size_mb, **judge(file, scene)}
        for part in ("raw", "answers"):
            of_fp32 = np.array(results[precision][part]) / results["fp32"][part]
            results[precision][f"{part}_over_fp32"] = of_fp32.tolist()
        print(model.name, method, precision, results[precision], flush=True)
    return results


def markdown(results: dict[str, Any]) -> str:
    """One row a file."""
    lines = [
        "| regressor, method | precision | MB | raw, median m / deg, p95 m / deg | "
        "answers (share) | raw over fp32 | answers over fp32 |",
        "|---|---|---|---|---|---|---|",
    ]
    for label, files in results.items():
        for precision, found in files.items():
            raw, answers = (
                "{:.2f} / {:.2f}, {:.2f} / {:.2f}".format(*found[part])
                for part in ("raw", "answers")
            )
            ratios = [
                " / ".join(f"{value:.2f}" for value in found[f"{part}_over_fp32"])
                for part in ("raw", "answers")
            ]
            share = f"({100 * found['share']:.0f} %)"
            cells = [label, precision, f"{found['size_mb']:.1f}", raw, f"{answers} {share}"]
            lines.append("| " + " | ".join([*cells, *ratios]) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Every model with every method."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("scene", type=Path)
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    scene = Scene.open(options.scene)
    with tempfile.TemporaryDirectory() as folder:
        results = {
            f"{model.name}, {method}": measure(scene, model, method, Path(folder))
            for model in options.models
            for method in METHODS
        }
    if options.json:
        machine = describe_machine(["onnxruntime", "onnx", "torch"])
        write_json(options.json, {"machine": machine, "files": results})
    if options.update_docs:
        replace_section(DOCS, "precision", markdown(results))


if __name__ == "__main__":
    main()
