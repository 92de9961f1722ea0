"""What models that are fitted, not trained, come to on real pictures.

    python benchmarks/fitted_models.py [--data FOLDER] [--json FILE] [--update-docs]

500 pictures of one pass through 7-Scenes redkitchen (341x256 pixels). "late": the last fifth, never
walked in that direction before; "mixed": every fifth second. Beside the models stand the mean pose
of the training pictures, and the pose of the nearest of them, which nobody can know: a picture
counts as nearest by distance and angle, 1 m as much as 30 deg. Pictures of elsewhere are those of
VIOAPR_DATA's scanner_app_3d.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import data_folder, describe_machine, publish, write_json
from mapping import REDKITCHEN, read_pose, redkitchen_rows
from rich.table import Table

from vioapr.geometry import quaternion, rigid
from vioapr.geometry.averaging import mean_quaternion
from vioapr.regression.cache import read_images
from vioapr.regression.data import PosedFrames
from vioapr.regression.points.fit import fit_points, plan_points
from vioapr.regression.prediction import Predicted, predict_images
from vioapr.regression.retrieval import Fitted, fit_retrieval
from vioapr.regression.run import ChosenFrames

PAGE, SECTION = "regressors.md", "fitted"
SURE_M = 0.05
"""Stated deviation of the position below which an answer counts as sure."""


def frames_of(data: Path, rows: list[dict[str, str]]) -> PosedFrames:
    """Pictures with their SfM poses."""
    pose = rigid.stack([read_pose(row, "gt") for row in rows])
    one = REDKITCHEN
    camera = np.array(
        [one.fx / one.width, one.fy / one.height, one.cx / one.width, one.cy / one.height]
    )
    return PosedFrames(
        "redkitchen",
        "seq-01",
        tuple(data / "images" / row["image"] for row in rows),
        np.array([float(row["t"]) for row in rows]),
        pose.translation_m,
        pose.quat_xyzw,
        np.tile(camera, (len(rows), 1)),
    )


def split(rows: list[dict[str, str]], kind: str) -> tuple[list, list]:
    """Training and test rows."""
    is_test = [
        int(row["frame"]) >= 800 if kind == "late" else int(float(row["t"])) % 5 == 4
        for row in rows
    ]
    return (
        [row for row, test in zip(rows, is_test, strict=True) if not test],
        [row for row, test in zip(rows, is_test, strict=True) if test],
    )


def judge(truth: PosedFrames, position_m: np.ndarray, quat_xyzw: np.ndarray) -> dict[str, float]:
    """Errors of poses."""
    error_m = np.linalg.norm(position_m - truth.position_m, axis=-1)
    error_deg = quaternion.angle_between_deg(quat_xyzw, truth.quat_xyzw)
    return {
        "median_m": float(np.median(error_m)),
        "median_deg": float(np.median(error_deg)),
        "within_5cm_5deg": float(np.mean((error_m < 0.05) & (error_deg < 5))),
        "within_25cm_2deg": float(np.mean((error_m < 0.25) & (error_deg < 2))),
    }


def baselines(train: PosedFrames, test: PosedFrames) -> dict[str, dict[str, float]]:
    """The mean pose, and the nearest training view."""
    count, weights = len(test), np.full(len(train), 1 / len(train))
    mean_quat = mean_quaternion(train.quat_xyzw, weights)
    gap_m = np.linalg.norm(test.position_m[:, None] - train.position_m, axis=-1)
    gap_deg = quaternion.angle_between_deg(test.quat_xyzw[:, None], train.quat_xyzw)
    nearest = (gap_m + gap_deg / 30).argmin(axis=1)
    return {
        "mean pose": judge(
            test, np.tile(train.position_m.mean(axis=0), (count, 1)), np.tile(mean_quat, (count, 1))
        ),
        "oracle: nearest view": judge(test, train.position_m[nearest], train.quat_xyzw[nearest]),
    }


def ask(fitted: Fitted, paths: tuple[Path, ...]) -> tuple[Predicted, float]:
    """Predictions, and CPU milliseconds an image."""
    size, began = fitted.spec.crop, time.process_time()
    found = predict_images(fitted.network, read_images(paths, size), size, batch_size=8)
    return found, 1e3 * (time.process_time() - began) / len(paths)


def compare(train: PosedFrames, test: PosedFrames, elsewhere: tuple[Path, ...]) -> dict[str, Any]:
    """Baselines and models on one split."""
    found: dict[str, Any] = dict(baselines(train, test))
    chosen = ChosenFrames([train], [])
    fits = {
        "retrieval": lambda: fit_retrieval("redkitchen", chosen),
        "points": lambda: fit_points("redkitchen", plan_points(chosen)),
    }
    for name, fit in fits.items():
        began = time.process_time()
        fitted = fit()
        seconds = time.process_time() - began
        answers, milliseconds = ask(fitted, test.paths)
        row = judge(test, answers.position_m, answers.quat_xyzw)
        error_m = np.linalg.norm(answers.position_m - test.position_m, axis=-1)
        error_deg = quaternion.angle_between_deg(answers.quat_xyzw, test.quat_xyzw)
        is_sure = answers.sigma_position_m < SURE_M
        is_wrong = (error_m > 0.25) | (error_deg > 5)
        row |= {"fit_cpu_s": seconds, "cpu_ms": milliseconds, "sure": float(is_sure.mean())}
        row["wrong_when_sure"] = float(is_wrong[is_sure].mean()) if is_sure.any() else 0.0
        # Of a normal distribution of three axes: the length within which these shares lie.
        for sigmas in (1, 2, 3):
            inside = error_m < sigmas * np.sqrt(3) * answers.sigma_position_m
            row[f"within_{sigmas}_sigma"] = float(inside.mean())
        row["sure_elsewhere"] = float(np.mean(ask(fitted, elsewhere)[0].sigma_position_m < SURE_M))
        tensors = fitted.network.state_dict().values()
        row["file_mb"] = sum(t.numel() * t.element_size() for t in tensors) / 1e6
        found[name] = row
    return found


def tabulate(results: dict[str, dict[str, Any]]) -> Table:
    """For people."""
    table = Table()
    for header in ("pictures", "answer", "median m", "median deg", "within 5 cm, 5 deg",
                   "within 25 cm, 2 deg", "sure (wrong)", "sure elsewhere",
                   "within 1, 2, 3 sigma", "fit, CPU s", "CPU ms", "MB"):  # fmt: skip
        table.add_column(header)
    for kind, rows in results.items():
        for name, row in rows.items():
            texts = [f"{row['median_m']:.3f}", f"{row['median_deg']:.2f}"]
            texts += [f"{row[key]:.0%}" for key in ("within_5cm_5deg", "within_25cm_2deg")]
            if "sure" in row:
                inside = ", ".join(f"{row[f'within_{k}_sigma']:.0%}" for k in (1, 2, 3))
                texts += [
                    f"{row['sure']:.0%} ({row['wrong_when_sure']:.0%})",
                    f"{row['sure_elsewhere']:.0%}", inside, f"{row['fit_cpu_s']:.0f}",
                    f"{row['cpu_ms']:.0f}", f"{row['file_mb']:.1f}",
                ]  # fmt: skip
            table.add_row(kind, name, *texts, *["-"] * (10 - len(texts)))
    return table


def main() -> None:
    """Compare, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    whole = chosen.data or data_folder()
    data = whole / "redkitchen_seq01_images"
    elsewhere = tuple(sorted((whole / "scanner_app_3d").rglob("*.jpg")))
    rows, results = redkitchen_rows(data), {}
    for kind in ("late", "mixed"):
        train, test = (frames_of(data, part) for part in split(rows, kind))
        results[kind] = compare(train, test, elsewhere)
    publish(tabulate(results), PAGE, SECTION, update_docs=chosen.update_docs)
    if chosen.json:
        write_json(chosen.json, {"machine": describe_machine(["torch"]), "results": results})


if __name__ == "__main__":
    main()
