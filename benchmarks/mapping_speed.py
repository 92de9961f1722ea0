"""How long mapping takes, and how exact it is, against plain pycolmap on the same images.

    python benchmarks/mapping_speed.py [--data FOLDER] [--images 100 250 500] [--json FILE]
        [--update-docs]

Images of 7-Scenes redkitchen seq-01, whose RGB-D SLAM poses stand in for VIO. Plain pycolmap is
its default SIFT, sequential matching and incremental mapping, with the same known intrinsics.
Both run one after the other, on as many threads as there are cores. Processor seconds, over all
threads and child processes, say more than seconds where the machine does other work.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common import data_folder, describe_machine, publish, write_json
from mapping import REDKITCHEN, compare, make_redkitchen
from rich.table import Table

from vioapr.geometry.rigid import stack
from vioapr.mapping.colmap import load_pycolmap, registered_images, world_from_cam
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.scene.scene import Scene
from vioapr.trajectory import Trajectory

FRAMES = 1000
"""Of the sequence; every second one has an image."""

RECORDING = "seq-01"


class Result(NamedTuple):
    """One mapping.

    Attributes:
        seconds: By the clock.
        cpu_seconds: Of all processor cores.
        registered: Number of images.
        rmse_mm: After the best alignment with scale.
    """

    seconds: float
    cpu_seconds: float
    registered: int
    rmse_mm: float


class Stopwatch:
    """Seconds, and processor seconds of this process and its children that have ended."""

    def __init__(self) -> None:
        self.start_s, self.start_cpu_s = time.perf_counter(), self._cpu_s()

    def read(self) -> tuple[float, float]:
        """Both, since the start."""
        return time.perf_counter() - self.start_s, self._cpu_s() - self.start_cpu_s

    @staticmethod
    def _cpu_s() -> float:
        usages = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def run_vioapr(scene: Scene, truth: Trajectory) -> tuple[Result, dict[str, float]]:
    """Map a scene; the seconds of its steps too."""
    watch = Stopwatch()
    summary = map_scene(scene, MappingParams(max_rate_hz=0))
    spent = watch.read()
    found = Scene.open(scene.folder).gt(RECORDING)
    assert found is not None
    rmse_m = compare([truth], [found])["with_scale_rmse_m"]
    return Result(*spent, summary.model.images, 1000 * rmse_m), summary.seconds


def run_plain(scene: Scene, truth: Trajectory, folder: Path) -> Result:
    """Map the images of a scene with pycolmap's defaults."""
    pycolmap = load_pycolmap()
    recording = scene.recording(RECORDING)
    images, database = recording.folder / "images", folder / "database.db"
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = ",".join(
        str(float(value)) for value in (REDKITCHEN.fx, REDKITCHEN.fy, REDKITCHEN.cx, REDKITCHEN.cy)
    )
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    watch = Stopwatch()
    pycolmap.extract_features(
        database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )
    pycolmap.match_sequential(database)
    models = pycolmap.incremental_mapping(database, images, folder, options)
    spent = watch.read()
    model = max(models.values(), key=lambda each: each.num_reg_images())
    known = registered_images(model)
    frames = recording.frames
    rows = [row for row, name in enumerate(frames.image) if name in known]
    poses = stack([world_from_cam(known[frames.image[row]]) for row in rows])
    found = Trajectory.from_arrays(frames.timestamp_s[rows], *poses)
    return Result(*spent, len(rows), 1000 * compare([truth], [found])["with_scale_rmse_m"])


def run(data: Path, count: int) -> dict[str, Any]:
    """Map a number of images both ways."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene, truth = make_redkitchen(data, folder / "scene", every=FRAMES // count)
        ours, steps = run_vioapr(scene, truth)
        (folder / "plain").mkdir()
        plain = run_plain(scene, truth, folder / "plain")
    return {
        "images": count, "vioapr": ours._asdict(), "pycolmap": plain._asdict(),
        "step_seconds": steps,
    }  # fmt: skip


def show(results: list[dict[str, Any]], *, update_docs: bool) -> None:
    """A row a number of images and mapper."""
    table = Table()
    titles = ("images", "", "s", "processor s", "of plain", "registered", "RMSE mm")
    for title in titles:
        table.add_column(title, justify="right")
    for each in results:
        for name in ("pycolmap", "vioapr"):
            result = Result(**each[name])
            share = result.cpu_seconds / each["pycolmap"]["cpu_seconds"]
            table.add_row(
                str(each["images"]), "vioapr map" if name == "vioapr" else "plain pycolmap",
                f"{result.seconds:.0f}", f"{result.cpu_seconds:.0f}", f"{share:.2f}",
                str(result.registered), f"{result.rmse_mm:.1f}",
            )  # fmt: skip
    publish(table, "mapping.md", "speed", update_docs=update_docs)
    if len(results) > 1:
        for name in ("pycolmap", "vioapr"):
            counts = [each["images"] for each in results]
            spent = [each[name]["cpu_seconds"] for each in results]
            power = np.polyfit(np.log(counts), np.log(spent), 1)[0]
            print(f"{name}: processor seconds grow with images to the power {power:.2f}")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--images", type=int, nargs="+", default=[100, 250, 500])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = (options.data or data_folder()) / "redkitchen_seq01_images"
    load_1min = os.getloadavg()[0]
    results = [run(data, count) for count in options.images]
    show(results, update_docs=options.update_docs)
    if options.json:
        machine = describe_machine(["numpy", "pycolmap", "opencv-python-headless"])
        settings = {"machine": machine, "load_before": load_1min}
        write_json(options.json, {**settings, "results": results})


if __name__ == "__main__":
    main()
