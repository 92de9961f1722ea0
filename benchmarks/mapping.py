"""How exact maps are: against poses that others computed, or that a simulation knows.

    python benchmarks/mapping.py redkitchen [--data FOLDER] [--json FILE] [--mapper global]
    python benchmarks/mapping.py scene FOLDER --truth FOLDER [--json FILE]

redkitchen: every 10th frame of 7-Scenes redkitchen seq-01 (341x256 pixels), whose RGB-D SLAM
poses stand in for VIO, against that data set's SfM poses. The map is made in a temporary folder,
from nothing.

scene: a scene (copied, so that it stays as it is) against true poses `<recording>.tum`, such as
the ground truth of `vioapr simulate courtyard`.

Errors are stated twice: after the best rigid alignment (the map's own metres), and after one
with scale (the odometry's own error of scale taken out).
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import describe_machine, publish, write_json
from rich.table import Table

from vioapr.cli.console import progress
from vioapr.formats import tum
from vioapr.formats.base import ReadOptions
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import align_umeyama
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.map_summary import MapSummary
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory, associate

REDKITCHEN = Intrinsics(341, 256, 280.0, 280.0, 170.5, 128.0)
HALF_TURN_ABOUT_X = Rigid3(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def make_redkitchen(data: Path, folder: Path, every: int = 10) -> tuple[Scene, Trajectory]:
    """A scene of one recording, and its SfM poses.

    The SLAM world has the first camera's axes, y down: it is turned over, to look like VIO's.
    """
    scene = Scene.create(folder, "redkitchen", is_outdoor=False)
    rows = [row for row in redkitchen_rows(data) if int(row["frame"]) % every == 0]
    truth = write_redkitchen(data, rows, scene.recording_folder("seq-01"))
    scene = scene.with_recording("seq-01", "train")
    scene.save()
    return scene, truth


def redkitchen_rows(data: Path) -> list[dict[str, str]]:
    """Of poses.csv, one a frame."""
    with (data / "poses.csv").open() as file:
        return list(csv.DictReader(file))


def write_redkitchen(data: Path, rows: list[dict[str, str]], folder: Path) -> Trajectory:
    """A recording of some frames with SLAM as VIO; returns their SfM poses."""
    info = RecordingInfo(tracker="RGB-D SLAM", is_gravity_aligned=False)
    timestamp_s = [float(row["t"]) for row in rows]
    with RecordingWriter(folder, info) as writer:
        for time_s, row in zip(timestamp_s, rows, strict=True):
            image = data / "images" / row["image"]
            vio_from_cam = HALF_TURN_ABOUT_X @ read_pose(row, "dslam")
            writer.add_frame(time_s, image.name, image, Tracking.NORMAL, vio_from_cam, REDKITCHEN)
    return Trajectory.from_arrays(timestamp_s, *rigid.stack([read_pose(row, "gt") for row in rows]))


def read_pose(row: dict[str, str], kind: str) -> Rigid3:
    """Of a row of poses.csv: gt is world_from_cam, dslam and dso are vio_from_cam."""
    position = [float(row[f"{kind}_{axis}"]) for axis in "xyz"]
    quat = [float(row[f"{kind}_{part}"]) for part in ("qx", "qy", "qz", "qw")]
    return Rigid3(np.array(position), np.array(quat))


def compare(truths: list[Trajectory], maps: list[Trajectory]) -> dict[str, float]:
    """Errors of poses in one map, after one alignment of all recordings together."""
    pairs = [associate(truth, found) for truth, found in zip(truths, maps, strict=True)]
    true = [t.target_from_source.at(p.left_rows) for t, p in zip(truths, pairs, strict=True)]
    found = [m.target_from_source.at(p.right_rows) for m, p in zip(maps, pairs, strict=True)]
    true_all, found_all = (
        Rigid3(*map(np.concatenate, zip(*x, strict=True))) for x in (true, found)
    )
    errors: dict[str, float] = {"poses": len(true_all.translation_m)}
    for name, with_scale in (("rigid", False), ("with_scale", True)):
        fit = align_umeyama(found_all.translation_m, true_all.translation_m, with_scale=with_scale)
        placed = fit.apply_to(found_all)
        off_m = rigid.distance_m(placed, true_all)
        off_deg = rigid.angle_deg(placed, true_all)
        errors |= {
            f"{name}_rmse_m": float(np.sqrt(np.mean(off_m**2))),
            f"{name}_median_m": float(np.median(off_m)),
            f"{name}_p95_m": float(np.percentile(off_m, 95)),
            f"{name}_max_m": float(off_m.max()),
            f"{name}_median_deg": float(np.median(off_deg)),
            f"{name}_p95_deg": float(np.percentile(off_deg, 95)),
        }
        if with_scale:
            errors["true_metres_per_map_metre"] = float(fit.scale)
        else:
            errors["gravity_off_deg"] = _tilt_deg(fit.rigid)
    return errors


def _join(poses: list[Rigid3]) -> Rigid3:
    return Rigid3(*map(np.concatenate, zip(*poses, strict=True)))


def _tilt_deg(true_from_map: Rigid3) -> float:
    """Angle between the map's z and the true one, both meant to be up."""
    up = quaternion.rotate(true_from_map.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    return float(np.degrees(np.arctan2(np.hypot(up[0], up[1]), up[2])))


def run_redkitchen(data: Path, params: MappingParams) -> dict[str, Any]:
    """Map every 10th frame and compare with the SfM poses."""
    with tempfile.TemporaryDirectory() as folder:
        scene, truth = make_redkitchen(data, Path(folder) / "scene")
        start = time.perf_counter()
        summary = map_scene(scene, params, progress)
        seconds = time.perf_counter() - start
        found = Scene.open(scene.folder).gt("seq-01")
        assert found is not None
    odometry = _odometry_scale(data, truth)
    errors = compare([truth], [found])
    errors.pop("gravity_off_deg")  # neither SfM poses nor SLAM know gravity
    return {"seconds": seconds, **odometry, **_facts(summary), "all": errors}


def _odometry_scale(data: Path, truth: Trajectory) -> dict[str, float]:
    """SfM metres per SLAM metre, by the two files alone."""
    rows = [row for row in redkitchen_rows(data) if int(row["frame"]) % 10 == 0]
    slam = np.array([read_pose(row, "dslam").translation_m for row in rows])
    # The map is nearly free of error, so it is the side that is scaled: noise in the scaled
    # side would make the scale too small.
    scale = align_umeyama(truth.position_m, slam, with_scale=True).scale
    return {"odometry_true_metres_per_metre": 1 / float(scale)}


def run_scene(folder: Path, truth_folder: Path, params: MappingParams) -> dict[str, Any]:
    """Map a copy of a scene and compare with the truth."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "scene"
        ignored = shutil.ignore_patterns("map", "gt", ".mapping")
        shutil.copytree(folder, copy, ignore=ignored, copy_function=_link)
        scene = Scene.open(copy)
        start = time.perf_counter()
        summary = map_scene(scene, params, progress)
        seconds = time.perf_counter() - start
        truths, found = {}, {}
        for id_, facts in summary.recordings.items():
            gt = scene.gt(id_)
            if gt is not None and facts.registered:
                truths[id_] = tum.read(truth_folder / f"{id_}.tum", ReadOptions())
                found[id_] = gt
    results = {"seconds": seconds, **_facts(summary)}
    results["all"] = compare(list(truths.values()), list(found.values()))
    for split in ("train", "test"):
        ids = [id_ for id_ in truths if summary.recordings[id_].split == split]
        if ids:
            results[split] = compare([truths[i] for i in ids], [found[i] for i in ids])
    return results


def _link(source: str, target: str) -> None:
    """Images are linked: they are only read."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _facts(summary: MapSummary) -> dict[str, Any]:
    recordings = summary.recordings.values()
    return {
        "images": sum(facts.images for facts in recordings),
        "registered": sum(facts.registered for facts in recordings),
        "reprojection_px": summary.model.mean_reprojection_error_px,
        "gravity_spread_deg": summary.world.gravity_spread_deg,
        "scale_of_tracking_worlds": [s.relative for s in summary.world.scales],
        "step_seconds": summary.seconds,
    }


def show(results: dict[str, Any], section: str, *, update_docs: bool) -> None:
    """A table a kind of alignment."""
    table = Table(title=f"{results['registered']} of {results['images']} images registered in "
                        f"{results['seconds']:.1f} s")  # fmt: skip
    for column in ("", "poses", "RMSE mm", "median mm", "p95 mm", "median deg", "gravity deg"):
        table.add_column(column, justify="right")
    for part in ("all", "train", "test"):
        for kind in ("rigid", "with_scale"):
            if part in results:
                errors = results[part]
                values = [
                    1000 * errors[f"{kind}_{name}"] for name in ("rmse_m", "median_m", "p95_m")
                ]
                tilt = errors.get("gravity_off_deg", float("nan"))
                table.add_row(
                    f"{part}, {kind}", str(errors["poses"]), *(f"{v:.1f}" for v in values),
                    f"{errors[f'{kind}_median_deg']:.3f}", f"{tilt:.3f}",
                )  # fmt: skip
    publish(table, "mapping.md", section, update_docs=update_docs)
    print(f"true metres per map metre: {results['all']['true_metres_per_map_metre']:.4f}")
    print({name: round(value, 1) for name, value in results["step_seconds"].items()})


def main() -> None:
    """Run one benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    commands = parser.add_subparsers(dest="command", required=True)
    kitchen = commands.add_parser("redkitchen")
    kitchen.add_argument("--data", type=Path, default=os.environ.get("VIOAPR_DATA"))
    scene = commands.add_parser("scene")
    scene.add_argument("folder", type=Path)
    scene.add_argument("--truth", type=Path, required=True)
    for command in (kitchen, scene):
        command.add_argument("--json", type=Path)
        command.add_argument("--update-docs", action="store_true")
        command.add_argument("--max-rate-hz", type=float, default=3.0)
        command.add_argument("--mapper", choices=("incremental", "global"), default="incremental")
    options = parser.parse_args()
    params = MappingParams(mapper=options.mapper, max_rate_hz=options.max_rate_hz)
    if options.command == "redkitchen":
        if options.data is None:
            parser.error("--data, or the environment variable VIOAPR_DATA, must name the data")
        results = run_redkitchen(Path(options.data) / "redkitchen_seq01_images", params)
    else:
        results = run_scene(options.folder, options.truth, params)
    show(results, options.command, update_docs=options.update_docs)
    if options.json:
        machine = describe_machine(["numpy", "scipy", "pycolmap"])
        write_json(options.json, {"machine": machine, "mapper": options.mapper, **results})


if __name__ == "__main__":
    main()
