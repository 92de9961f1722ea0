"""Regressors trained from nothing: raw, fused, and on how many cores in which time.

    python benchmarks/regressors.py courtyard FOLDER [--models mobile,posenet] [--json FILE]
    python benchmarks/regressors.py redkitchen FOLDER [--data FOLDER] [--json FILE]
    python benchmarks/regressors.py two-scenes FOLDER [--data FOLDER] [--json FILE]

courtyard: simulated training walks, two test walks, and four other walks of another seed
by which nothing here was chosen. redkitchen: frames before 800 of 7-Scenes redkitchen seq-01 to
learn from, the others to test, RGB-D SLAM as VIO.
two-scenes: one MS-Transformer for a courtyard and the kitchen; does it tell them apart?

FOLDER keeps scenes and checkpoints; what is there already is not made again. --update-docs writes
the tables to docs/results/accuracy.md. "with_tilt_by_vio" is the raw prediction with roll and pitch
replaced by the tracker's.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from accuracy import markdown
from common import describe_machine, replace_section, write_json
from mapping import redkitchen_rows, write_redkitchen

from vioapr.cli.console import progress
from vioapr.cli.evaluate import print_tables
from vioapr.cli.main import main as vioapr
from vioapr.evaluation.cases import Case, load_cases
from vioapr.evaluation.evaluate import count_ticks
from vioapr.evaluation.tables import tabulate, to_records
from vioapr.fusion.methods import default_params
from vioapr.geometry import quaternion
from vioapr.scene.scene import Scene
from vioapr.scene.walks import find_walks
from vioapr.schemas.base import to_plain
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory

DOCS = Path(__file__).parents[1] / "docs" / "results" / "regressors.md"

SIZE = "--width-px 160 --height-px 120"
PICTURES = f"--rate-hz 5 {SIZE}"
SIMULATE = f"--train 384 --test 2 {PICTURES}"
"""Of `vioapr simulate courtyard`: the scene of these figures and of the demo."""

OTHER_WALKS = f"--train 1 --test 4 {PICTURES}"
"""With another seed: the same place, other walks."""

COMMON = (
    "--resize 64 --crop 64 --schedule cosine --weight-decay 0 --rotation 6d "
    "--dropout 0 --rotation-weight -2"
)
MANY = f"--batch-size 64 --jitter 0.1 --hue 0.02 --position-weight -3 {COMMON}"
FEW = f"--jitter 0.3 --hue 0.05 --position-weight -2 {COMMON}"
"""Of scenes with many weathers, and of others."""

TRAIN = {
    "mobile": f"--epochs 2 --lr 4e-3 {MANY}",
    "posenet": f"--epochs 1 --lr 1e-3 --precision bf16 {MANY}",
}
"""Options of `vioapr train` by model: what fits into 20 minutes on two cores."""

REDKITCHEN_TRAIN = f"--epochs 300 --lr 1e-3 --batch-size 64 {FEW}"

TWO_PLACES = f"--train 12 --test 2 --rate-hz 2.5 {SIZE}"
TWO_PLACES_TRAIN = f"--epochs 4 --batch-size 32 --lr 5e-4 {FEW}"

METHODS_SHOWN = ("apr", "vio", "vio-apr", "chain")


def run(*arguments: object) -> float:
    """One command of vioapr, shown; returns its seconds."""
    words = [str(argument) for argument in arguments]
    print("vioapr", *words, flush=True)
    start = time.perf_counter()
    if code := vioapr(words):
        sys.exit(code)
    return time.perf_counter() - start


def simulate(folder: Path, seed: int, options: str) -> Scene:
    """A courtyard, unless it is there."""
    if not (folder / "scene.toml").exists():  # it appears when the scene is whole
        run("simulate", "courtyard", "--out", folder, "--seed", seed, *options.split())
    return Scene.open(folder)


def train(scenes: list[Scene], model: str, options: str, out: Path) -> dict[str, Any]:
    """A regressor, unless it is there; its epochs and seconds."""
    facts = out / "facts.json"
    if not facts.exists():
        folders = [scene.folder for scene in scenes]
        seconds = run("train", *folders, "--model", model, "--out", out, *options.split())
        content = json.loads((out / "state.json").read_text())
        write_json(facts, {"options": options, "seconds": seconds, "last": content["epochs"][-1]})
    return json.loads(facts.read_text())


def judge(scene: Scene, run_folder: Path, out: Path) -> dict[str, Any]:
    """Predict the test recordings, fuse, compare."""
    run("predict", scene.folder, "--model", run_folder, "--out", out, "--overwrite")
    model = json.loads((run_folder / "regressor.json").read_text())["spec"]["model"]
    cases = [case for case in load_cases(find_walks([out])) if case.apr == model]
    params = default_params(METHODS_SHOWN)
    with progress("fusing", count_ticks(cases, params)) as tick:
        groups = tabulate(cases, params, tick=tick).groups
    print_tables(groups)
    (raw,) = (row.fused for row in groups[0].rows if row.method == "apr")
    extent_m = _extent_m(scene)
    facts = {
        "extent_m": extent_m,
        "median_m_of_extent": raw.median_m / extent_m,
        "raw_median_deg": raw.median_deg,
    }
    if scene.world.is_gravity_aligned:
        tilted = [_with_tilt_of_vio(case) for case in cases]
        facts["raw_median_deg_with_tilt_by_vio"] = float(np.mean(tilted))
    print(facts)
    return {**facts, "groups": groups}


def _extent_m(scene: Scene) -> float:
    """The longer side, on the ground, of the box around all training cameras."""
    position_m = np.concatenate([_gt(scene, id_).position_m for id_ in scene.splits["train"]])
    return float(np.ptp(position_m, axis=0)[:2].max())


def _gt(scene: Scene, id_: str) -> Trajectory:
    gt = scene.gt(id_)
    assert gt is not None
    return gt


def _with_tilt_of_vio(case: Case) -> float:
    """Median error, deg, of the raw rotations after the least turn that puts up where VIO has it.

    Only where up is z in the map and y in the tracker's world.
    """
    inputs, up_in_map, up_in_vio = case.frames.inputs, np.eye(3)[2], np.eye(3)[1]
    rows = case.has_gt & inputs.has_apr & inputs.tracking_ok
    raw = inputs.apr_world_from_cam.quat_xyzw[rows]
    cam_from_vio = quaternion.inverse(inputs.vio_from_cam.quat_xyzw[rows])
    said = quaternion.rotate(raw, quaternion.rotate(cam_from_vio, up_in_vio))
    axis = np.cross(said, up_in_map)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(length, (said @ up_in_map)[:, None])
    turned = quaternion.multiply(
        quaternion.from_rotvec(axis / np.maximum(length, 1e-12) * angle), raw
    )
    true = case.gt_world_from_cam.quat_xyzw[rows]
    return float(np.median(quaternion.angle_between_deg(turned, true)))


def courtyard(folder: Path, models: list[str]) -> dict[str, Any]:
    """Every model on the simulated courtyard."""
    scene = simulate(folder / "courtyard", 0, SIMULATE)
    others = simulate(folder / "other-walks", 2, OTHER_WALKS)
    results = {}
    for model in models:
        trained = train([scene], model, TRAIN[model], folder / model)
        judged = judge(scene, folder / model, folder / "Simulated courtyard")
        results[model] = {"trained": trained, **judged}
        fresh = judge(others, folder / model, folder / "Simulated courtyard, other walks")
        results[f"{model}, other walks"] = fresh
    return results


def make_redkitchen(data: Path, folder: Path) -> Scene:
    """A scene of two recordings, frames before 800 and the others."""
    world = World(is_gravity_aligned=False)
    scene = Scene.create(folder, "redkitchen", is_outdoor=False, world=world)
    rows = redkitchen_rows(data)
    for id_, split, chosen in (
        ("before-800", "train", [row for row in rows if int(row["frame"]) < 800]),
        ("from-800", "test", [row for row in rows if int(row["frame"]) >= 800]),
    ):
        scene.write_gt(id_, write_redkitchen(data, chosen, scene.recording_folder(id_)))
        scene = scene.with_recording(id_, split)
    scene.save()
    return scene


def kitchen(folder: Path, data: Path) -> Scene:
    """That scene, unless it is there."""
    place = folder / "redkitchen"
    is_there = (place / "gt" / "from-800.tum").exists()
    return Scene.open(place) if is_there else make_redkitchen(data, place)


def redkitchen(folder: Path, data: Path) -> dict[str, Any]:
    """One sequence's start to learn from, its end to test."""
    scene, out = kitchen(folder, data), folder / "redkitchen-mobile"
    trained = train([scene], "mobile", REDKITCHEN_TRAIN, out)
    return {"mobile": {"trained": trained, **judge(scene, out, folder / "redkitchen from 800")}}


def two_scenes(folder: Path, data: Path) -> dict[str, Any]:
    """A courtyard and a kitchen; the share of test images that are taken for their own scene."""
    from vioapr.regression.checkpoint import load
    from vioapr.regression.prediction import predict_recording

    scenes = [simulate(folder / "small-courtyard", 1, TWO_PLACES), kitchen(folder, data)]
    model = "ms-transformer"
    trained = train(scenes, model, TWO_PLACES_TRAIN, folder / model)
    regressor = load(folder / model)
    results = {}
    for number, scene in enumerate(scenes):
        seen = [predict_recording(regressor, scene, id_)[1].scene for id_ in scene.splits["test"]]
        results[scene.name] = {
            "trained": trained,
            "taken_for_its_own_scene": float(np.mean(np.concatenate(seen) == number)),
            **judge(scene, folder / model, folder / f"{scene.name}, one of two"),
        }
    return results


def main() -> None:
    """Run one benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("benchmark", choices=("courtyard", "redkitchen", "two-scenes"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--models", default="mobile,posenet")
    parser.add_argument("--data", type=Path, default=os.environ.get("VIOAPR_DATA"))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    if options.benchmark != "courtyard" and options.data is None:
        parser.error("--data, or the environment variable VIOAPR_DATA, must name the data")
    if options.benchmark == "courtyard":
        results = courtyard(options.folder, options.models.split(","))
    else:
        data = Path(options.data) / "redkitchen_seq01_images"
        results = {"redkitchen": redkitchen, "two-scenes": two_scenes}[options.benchmark](
            options.folder, data
        )
    if options.json:
        machine = describe_machine(["torch", "numpy", "moderngl"])
        shown = {
            name: {**r, "groups": to_plain(to_records(r["groups"]))} for name, r in results.items()
        }
        write_json(options.json, {"machine": machine, **shown})
    if options.update_docs:
        groups = [group for result in results.values() for group in result["groups"]]
        replace_section(DOCS, options.benchmark, markdown(groups))


if __name__ == "__main__":
    main()
