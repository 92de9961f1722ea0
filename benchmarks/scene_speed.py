"""Import, check and info of a scene of 10,000 and 100,000 frames: seconds and peak memory.

A folder of small JPEG images and a TUM trajectory of as many poses are imported by
`vioapr import images`, as copies and as hard links, then verified by `vioapr scene check` and
summed up by `vioapr scene info`; beside them, `cp -r` of the same images. Every command is a
process of its own, so that its time includes the start of Python, and its peak memory is its
own.

    python benchmarks/scene_speed.py [--json FILE] [--folder DIR] [--quick]
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from common import describe_machine, publish, write_json
from PIL import Image
from rich.table import Table

from vioapr.formats import tum
from vioapr.simulation.walks import WalkParams, simulate_walk

REPEATS = 3
RATE_HZ = 30.0

# The peak that Linux keeps of a program's own memory; rusage counts its parent's before it, too.
PROGRAM = """
import sys
import time
from pathlib import Path
from vioapr.cli import main
code = main(sys.argv[1:])
status = Path("/proc/self/status").read_text().splitlines()
peak_kb = next(line.split()[1] for line in status if line.startswith("VmHWM"))
print(time.process_time(), peak_kb, file=sys.stderr)
sys.exit(code)
"""


def make_source(folder: Path, frames: int) -> None:
    """Images named by frame and `vio.tum`, in a folder."""
    walk = simulate_walk(WalkParams(duration_s=frames / RATE_HZ, rate_hz=RATE_HZ), seed=1)
    tum.write(folder / "vio.tum", walk.vio)
    rng = np.random.default_rng(0)
    contents = []
    for _ in range(16):
        buffer = io.BytesIO()
        pixels = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8).repeat(16, 0).repeat(16, 1)
        Image.fromarray(pixels).save(buffer, format="jpeg")
        contents.append(buffer.getvalue())
    images = folder / "images"
    images.mkdir()
    for row in range(frames):
        (images / f"frame-{row:06d}.jpg").write_bytes(contents[row % len(contents)])


def run(*arguments: object) -> tuple[float, float, float]:
    """Seconds, seconds of the processor and peak memory in MB of `vioapr ARGUMENTS`."""
    start = time.perf_counter()
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    seconds = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"vioapr {' '.join(map(str, arguments))} failed: {done.stderr}")
    cpu_seconds, peak_kb = map(float, done.stderr.split()[-2:])
    return seconds, cpu_seconds, peak_kb / 1024


def copy(folder: Path) -> tuple[float, float, float]:
    """What the system itself needs to copy as many files: the floor of an import that copies."""
    start = time.perf_counter()
    subprocess.run(["cp", "-r", folder / "images", folder / "copy"], check=True)
    seconds = time.perf_counter() - start
    shutil.rmtree(folder / "copy")
    return seconds, float("nan"), float("nan")


def measure(frames: int, folder: Path, repeats: int) -> dict[str, dict[str, float | None]]:
    """Median seconds and largest peak of every command."""
    make_source(folder, frames)
    measured: dict[str, list[tuple[float, float, float]]] = {}
    for _ in range(repeats):
        measured.setdefault("cp -r, of the images", []).append(copy(folder))
        for how in ("link", "copy"):
            scene = folder / "scene"
            shutil.rmtree(scene, ignore_errors=True)
            arguments = ["import", "images", folder / "images", "--poses", folder / "vio.tum"]
            arguments += ["--out", scene, "--place", "outdoor", "--images", how, "--id", "walk-1"]
            measured.setdefault(f"import, {how}", []).append(run(*arguments))
        make_test(scene)
        measured.setdefault("scene check", []).append(run("scene", "check", scene))
        measured.setdefault("scene info", []).append(run("scene", "info", scene))
    return {name: _sum_up(runs) for name, runs in measured.items()}


def _sum_up(runs: list[tuple[float, float, float]]) -> dict[str, float | None]:
    """Median times and the largest peak; None where they are not known."""
    seconds, cpu_seconds, peak_mb = np.array(runs).T
    known = np.isfinite(peak_mb).all()
    return {
        "seconds": float(np.median(seconds)),
        "cpu_seconds": float(np.median(cpu_seconds)) if known else None,
        "peak_mb": float(peak_mb.max()) if known else None,
    }


def make_test(scene: Path) -> None:
    """A second recording of the first frame alone, so that no split is empty."""
    text = (scene / "scene.toml").read_text()
    (scene / "scene.toml").write_text(text.replace("test = []", 'test = ["walk-2"]'))
    first, second = (scene / "recordings" / name for name in ("walk-1", "walk-2"))
    (second / "images").mkdir(parents=True)
    shutil.copy(first / "recording.json", second)
    lines = (first / "frames.csv").read_text().splitlines(keepends=True)[:2]
    (second / "frames.csv").write_text("".join(lines))
    shutil.copy(first / "images" / lines[1].split(",")[1], second / "images")


def main() -> None:
    """Measure at both sizes and print them side by side."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    parser.add_argument("--folder", type=Path, help="where to work; by default the temporary one")
    parser.add_argument("--quick", action="store_true", help="1,000 frames, to see that it runs")
    options = parser.parse_args()
    sizes, repeats = ((1000,), 1) if options.quick else ((10_000, 100_000), REPEATS)
    results = {}
    for frames in sizes:
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            results[frames] = measure(frames, Path(folder), repeats)
    table = Table(title=f"median of {repeats} runs, each a process, Python's start included")
    table.add_column("")
    for frames in sizes:
        table.add_column(f"{frames:,} frames: s", justify="right")
        table.add_column("of CPU", justify="right")
        table.add_column("peak MB", justify="right")
    for name in results[sizes[0]]:
        cells = [
            text
            for frames in sizes
            for text in (
                f"{results[frames][name]['seconds']:.2f}",
                _format(results[frames][name]["cpu_seconds"], 2),
                _format(results[frames][name]["peak_mb"], 0),
            )
        ]
        table.add_row(name, *cells)
    publish(table, "performance.md", "scenes", update_docs=options.update_docs)
    if options.json:
        machine = describe_machine(["numpy", "pillow"])
        load = os.getloadavg()
        write_json(
            options.json,
            {"machine": machine, "load": load, "frames": results, "repeats": repeats},
        )


def _format(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    main()
