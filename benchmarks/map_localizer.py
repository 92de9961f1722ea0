"""How exact poses by a scene's map are (`vioapr predict --model map`), and when it has none.

    python benchmarks/map_localizer.py FOLDER [--data FOLDER] [--json FILE] [--update-docs]

redkitchen: 7-Scenes redkitchen seq-01 (341x256 pixels), two splits. late: frames before 800 for
the map, the others to localize. mixed: every fifth second to localize. The map is triangulated
from the data set's SfM poses of three images a second: every fifth of the training frames.

capture: a real ARKit capture of a desk with 3D Scanner App. Every third picture is left out of
the map, which `vioapr map` makes of the others, and localized; judged by a map of all pictures,
after one rigid alignment by the pictures that both maps hold.

Also: redkitchen's pictures blurred and darkened, and pictures of the one place in the other's map.
Settings are the defaults. Milliseconds are of the processor, on one thread. FOLDER keeps the
scenes; what is there is not made again.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from common import data_folder, describe_machine, publish, write_json
from mapping import redkitchen_rows, write_redkitchen
from numpy.typing import NDArray
from PIL import Image, ImageFilter
from rich.table import Table

from vioapr.cli.console import progress
from vioapr.cli.main import main as vioapr
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.umeyama import align_umeyama
from vioapr.mapping.localization.localizer import Localized, PointMapLocalizer
from vioapr.mapping.localization.point_map import PointMap
from vioapr.mapping.localization.prediction import cameras_of_frames
from vioapr.mapping.localization.scene_map import POINT_MAP_FILE, open_point_map
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.scene.frames import Tracking
from vioapr.scene.recording import Recording
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.point_map import CameraModel
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory, poses_of_frames

PACKAGES = ("numpy", "scipy", "pycolmap", "opencv-python-headless")

DISTORT: dict[str, Callable[[Image.Image], Image.Image]] = {
    "blurred (Gaussian, 2 px)": lambda image: image.filter(ImageFilter.GaussianBlur(2)),
    "dark (a tenth of the light)": lambda image: image.point(lambda value: value // 10),
}


class Picture(NamedTuple):
    """A picture to localize.

    Attributes:
        path: Its file.
        camera: That took it.
        truth: Its pose, world_from_cam; None if it is of elsewhere.
    """

    path: Path
    camera: CameraModel
    truth: Rigid3 | None


def pictures_of(place: PointMap, recording: Recording, truth: Trajectory | None) -> list[Picture]:
    """The images of a recording whose truth is known; all if there is no truth."""
    frames, found = recording.frames, []
    poses = None if truth is None else poses_of_frames(truth, frames.timestamp_s)
    for row, camera in cameras_of_frames(place, recording).items():
        pose = None if poses is None else poses.at(row)
        if pose is None or pose.is_known:
            found.append(Picture(recording.image_path(row), camera, pose))
    return found


def distorted(pictures: list[Picture], kind: str, folder: Path) -> list[Picture]:
    """The same pictures, taken badly."""
    changed = []
    for picture in pictures:
        path = folder / f"{picture.path.stem}.png"
        with Image.open(picture.path) as image:
            DISTORT[kind](image.convert("RGB")).save(path)
        changed.append(picture._replace(path=path))
    return changed


def judge(place: PointMap, pictures: list[Picture], title: str) -> dict[str, float]:
    """Localize pictures one by one, and measure."""
    localizer = PointMapLocalizer(place)
    answers: list[tuple[Localized, Rigid3 | None]] = []
    start_s = time.process_time()
    with progress(title, len(pictures)) as tick:
        for picture in pictures:
            answer = localizer.localize(picture.path, picture.camera)
            if answer is not None:
                answers.append((answer, picture.truth))
            tick()
    facts = {
        "pictures": len(pictures),
        "localized": len(answers),
        "ms": 1000 * (time.process_time() - start_s) / len(pictures),
    }
    if any(truth is not None for _, truth in answers):
        facts |= errors_of(answers, len(pictures))
    print(title, {name: round(value, 4) for name, value in facts.items()}, flush=True)
    return facts


def errors_of(answers: list[tuple[Localized, Rigid3 | None]], pictures: int) -> dict[str, float]:
    """Errors of answers, and whether they are as stated."""
    found = rigid.stack([answer.world_from_cam for answer, _ in answers])
    true = rigid.stack([truth for _, truth in answers if truth is not None])
    sigma_m, sigma_deg = np.array([answer.sigmas for answer, _ in answers]).T
    off_m, off_deg = rigid.distance_m(found, true), rigid.angle_deg(found, true)
    turned = quaternion.multiply(quaternion.inverse(true.quat_xyzw), found.quat_xyzw)
    by_axis = {
        "m": (found.translation_m - true.translation_m) / sigma_m[:, None],
        "deg": np.degrees(quaternion.to_rotvec(turned)) / sigma_deg[:, None],
    }
    facts = {
        "median_m": float(np.median(off_m)),
        "median_deg": float(np.median(off_deg)),
        "p95_m": float(np.quantile(off_m, 0.95)),
        "p95_deg": float(np.quantile(off_deg, 0.95)),
        "max_m": float(off_m.max()),
        "max_deg": float(off_deg.max()),
        "within_5cm_5deg": float(((off_m <= 0.05) & (off_deg <= 5)).sum() / pictures),
        "within_25cm_2deg": float(((off_m <= 0.25) & (off_deg <= 2)).sum() / pictures),
        "median_sigma_m": float(np.median(sigma_m)),
        "median_sigma_deg": float(np.median(sigma_deg)),
    }
    for unit, ratio in by_axis.items():
        for k in (1, 2, 3):
            facts[f"{unit}_within_{k}_sigma"] = float((np.abs(ratio) <= k).mean())
    return facts


def is_to_test(row: dict[str, str], split: str) -> bool:
    """Whether a frame of redkitchen is to be localized."""
    return int(row["frame"]) >= 800 if split == "late" else int(float(row["t"])) % 5 == 4


def kitchen(folder: Path, data: Path, split: str) -> Scene:
    """A scene of one split, with the data set's SfM poses; made if it is not there."""
    place = folder / f"redkitchen-{split}"
    if (place / "gt" / "test.tum").exists():
        return Scene.open(place)
    world = World(is_gravity_aligned=False)
    scene = Scene.create(place, "redkitchen", is_outdoor=False, world=world)
    rows = redkitchen_rows(data)
    for id_ in ("train", "test"):
        chosen = [row for row in rows if is_to_test(row, split) == (id_ == "test")]
        scene.write_gt(id_, write_redkitchen(data, chosen, scene.recording_folder(id_)))
        scene = scene.with_recording(id_, id_)
    scene.save()
    return scene


def redkitchen(folder: Path, data: Path) -> tuple[dict[str, dict[str, float]], PointMap]:
    """Both splits, and bad pictures of the first; also its map."""
    results, places = {}, {}
    for split in ("late", "mixed"):
        scene = kitchen(folder, data, split)
        places[split] = open_point_map(scene, progress=progress)
        pictures = pictures_of(places[split], scene.recording("test"), scene.gt("test"))
        name = f"redkitchen, {split}"
        results[name] = judge(places[split], pictures, name) | size_of(scene, places[split])
        if split == "late":
            for kind in DISTORT:
                with tempfile.TemporaryDirectory() as scratch:
                    bad = distorted(pictures, kind, Path(scratch))
                    results[f"{name}, {kind}"] = judge(places[split], bad, kind)
    return results, places["late"]


def size_of(scene: Scene, place: PointMap) -> dict[str, float]:
    """Of a point map."""
    return {
        "map_images": len(place.header.names),
        "map_points": len(place.points_m),
        "map_mb": (scene.folder / POINT_MAP_FILE).stat().st_size / 1e6,
    }


def capture_scene(folder: Path, data: Path, *, leaves_out: bool) -> Scene:
    """The capture, mapped, with or without every third picture; made if it is not there."""
    place = folder / ("capture-two-thirds" if leaves_out else "capture-all")
    imported = folder / "capture"
    if not imported.exists():
        words = ("import", "3dscannerapp", data, "--out", imported, "--place", "indoor")
        code = vioapr([str(word) for word in words])
        assert code == 0
    whole = Scene.open(imported)
    recording = whole.recording(whole.recording_ids[0])
    if not place.exists():
        frames = recording.frames
        rows = np.flatnonzero(frames.has_image)
        is_out = np.arange(len(rows)) % 3 == 2 if leaves_out else np.zeros(len(rows), dtype=bool)
        scene = Scene.create(place, "desk", is_outdoor=False)
        for id_, chosen in (("map", rows[~is_out]), ("left-out", rows[is_out])):
            if len(chosen):
                copy_rows(recording, chosen, scene.recording_folder(id_))
                scene = scene.with_recording(id_, "train" if id_ == "map" else "test")
        scene.save()
    scene = Scene.open(place)
    if not scene.map_folder.exists():
        map_scene(scene, MappingParams(), progress)
    return Scene.open(place)


def copy_rows(recording: Recording, rows: NDArray[np.intp], folder: Path) -> None:
    """A recording of some frames of another."""
    frames = recording.frames
    with RecordingWriter(folder, recording.info) as writer:
        for row in rows.tolist():
            path = recording.image_path(row)
            tracking = Tracking(int(frames.tracking[row]))
            writer.add_frame(
                frames.timestamp_s[row], path.name, path, tracking,
                frames.vio_from_cam.at(row), frames.intrinsics.at(row),
            )  # fmt: skip


def capture(folder: Path, data: Path) -> tuple[dict[str, dict[str, float]], PointMap]:
    """The pictures left out of a map, judged by a map of all; also the map."""
    scene = capture_scene(folder, data, leaves_out=True)
    whole = capture_scene(folder, data, leaves_out=False).gt("map")
    own = scene.gt("map")
    assert whole is not None
    assert own is not None
    reference = poses_of_frames(whole, own.timestamp_s)
    fit = align_umeyama(reference.translation_m, own.position_m, with_scale=False)
    turned = fit.apply_to(whole.target_from_source)
    truth = Trajectory.from_arrays(whole.timestamp_s, turned.translation_m, turned.quat_xyzw)
    place = open_point_map(scene, progress=progress)
    pictures = pictures_of(place, scene.recording("left-out"), truth)
    name = "ARKit capture of a desk"
    # What no localizer in this map can undo: where the two maps have the same pictures.
    aligned = poses_of_frames(truth, own.timestamp_s)
    itself = {
        "map_itself_m": float(np.median(rigid.distance_m(aligned, own.target_from_source))),
        "map_itself_deg": float(np.median(rigid.angle_deg(aligned, own.target_from_source))),
    }
    return {name: judge(place, pictures, name) | size_of(scene, place) | itself}, place


def elsewhere(folder: Path, kitchens: PointMap, desk: PointMap) -> dict[str, dict[str, float]]:
    """Pictures of the one place in the other's map."""
    whole, late = Scene.open(folder / "capture-all"), Scene.open(folder / "redkitchen-late")
    return {
        name: judge(place, pictures_of(place, recording, None), name)
        for name, place, recording in (
            ("the desk's pictures in redkitchen", kitchens, whole.recording("map")),
            ("redkitchen's pictures on the desk", desk, late.recording("test")),
        )
    }


def tables_of(results: dict[str, dict[str, float]]) -> dict[str, Table]:
    """Accuracy, and whether sigmas are honest."""
    accuracy = Table(title="Poses in a map; shares are of all pictures")
    for column in (
        "", "pictures", "localized", "median mm / deg", "p95 mm / deg", "max mm / deg",
        "5 cm / 5 deg", "25 cm / 2 deg", "CPU ms", "map images", "map MB",
    ):  # fmt: skip
        accuracy.add_column(column)
    sigmas = Table(title="Stated standard deviations, an axis")
    for column in (
        "", "median mm / deg", "within 1, 2, 3 sigma: m", "within 1, 2, 3 sigma: deg",
    ):  # fmt: skip
        sigmas.add_column(column)
    sigmas.add_row("if they were normal", "", "68.3, 95.4, 99.7 %", "68.3, 95.4, 99.7 %")
    for name, facts in results.items():
        start = [name, f"{facts['pictures']:.0f}", f"{facts['localized']:.0f}"]
        size = [""] * 2
        if "map_mb" in facts:
            size = [f"{facts['map_images']:.0f}", f"{facts['map_mb']:.1f}"]
        if "median_m" not in facts:
            accuracy.add_row(*start, *[""] * 5, f"{facts['ms']:.0f}", *size)
            continue
        pairs = [
            f"{1000 * facts[f'{kind}_m']:.1f} / {facts[f'{kind}_deg']:.2f}"
            for kind in ("median", "p95", "max", "median_sigma")
        ]
        shares = [f"{100 * facts[f'within_{kind}']:.1f} %" for kind in ("5cm_5deg", "25cm_2deg")]
        accuracy.add_row(*start, *pairs[:3], *shares, f"{facts['ms']:.0f}", *size)
        honest = [
            ", ".join(f"{100 * facts[f'{unit}_within_{k}_sigma']:.1f}" for k in (1, 2, 3)) + " %"
            for unit in ("m", "deg")
        ]
        sigmas.add_row(name, pairs[3], *honest)
    return {"accuracy": accuracy, "sigmas": sigmas}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = options.data or data_folder()
    options.folder.mkdir(parents=True, exist_ok=True)
    results, kitchens = redkitchen(options.folder, data / "redkitchen_seq01_images")
    desk_results, desk = capture(options.folder, data / "scanner_app_3d")
    results |= desk_results | elsewhere(options.folder, kitchens, desk)
    for section, table in tables_of(results).items():
        publish(table, "map-localizer.md", section, update_docs=options.update_docs)
    if options.json:
        write_json(options.json, {"machine": describe_machine(PACKAGES), "results": results})


if __name__ == "__main__":
    main()
