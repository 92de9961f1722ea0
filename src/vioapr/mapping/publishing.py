"""Writing the map, ground truth and the summary, replacing earlier ones only when all is there."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr._version import __version__
from vioapr.errors import FormatError
from vioapr.files.atomic import write_atomically
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.alignment import poses_of_model
from vioapr.mapping.colmap import load_pycolmap, translated_errors
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.joining import MAX_TILT_DEG
from vioapr.mapping.outliers import find_breaks, find_misplaced, with_bad_worlds
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pruning import tilt_deg
from vioapr.mapping.registration import Registered
from vioapr.mapping.vio_interpolation import carry_by_vio
from vioapr.scene.scene import GeodeticOrigin, Scene, World
from vioapr.trajectory import Trajectory
from vioapr.work.steps import Steps

SUMMARY_FILE = "map.json"


def publish(
    scene: Scene,
    images: MapImages,
    params: MappingParams,
    steps: Steps,
    facts: dict[str, Any],
    found: list[dict[str, Any]],
    world_folder: Path,
) -> dict[str, Any]:
    """Put `map/`, `gt/` and the world of `scene.toml` in place.

    Args:
        scene: The scene.
        images: All images.
        params: How it was mapped.
        steps: The steps taken.
        facts: What they found: "broken", "matches", "models" and "world".
        found: The registered test images.
        world_folder: The model in the world.

    Returns:
        The summary, which is also written.

    Raises:
        FormatError: Something cannot be written; what was there stays.
    """
    with translated_errors(world_folder):
        model = load_pycolmap().Reconstruction(world_folder)
    rows, poses = _all_poses(images, model, found)
    recordings = {
        id_: _describe(scene, images, id_, rows, poses, facts, found) for id_ in images.ids
    }
    summary = {
        "vioapr": __version__,
        "params": dataclasses.asdict(params),
        "recordings": recordings,
        "model": _describe_model(model, facts["models"]),
        "matches": facts["matches"],
        "world": _describe_world(images, facts["world"]),
        "seconds": steps.seconds,
        "reused_steps": steps.reused,
    }
    truths = {
        id_: _ground_truth(scene, images, id_, rows, poses, facts)
        for id_, facts in recordings.items()
    }
    for id_, truth in truths.items():
        mapped = recordings[id_]["registered"] - len(recordings[id_]["misplaced"])
        recordings[id_]["carried_by_vio"] = len(truth) - mapped if truth is not None else 0
    _replace_map(scene, world_folder, summary)
    for id_, truth in truths.items():
        if truth is None:
            scene.gt_path(id_).unlink(missing_ok=True)  # of an earlier map, in another world
        else:
            scene.write_gt(id_, truth)
    geo = facts["world"]["georeference"]
    origin = GeodeticOrigin(**geo["origin"]) if isinstance(geo, dict) else None
    flags = facts["world"]["is_metric"], facts["world"]["is_gravity_aligned"]
    dataclasses.replace(scene, world=World(*flags, origin)).save()
    return summary


def _all_poses(
    images: MapImages, model: Any, found: list[dict[str, Any]]
) -> tuple[NDArray[np.intp], Rigid3]:
    """Rows of all registered images, in order, and their world_from_cam."""
    rows, poses = poses_of_model(model, images)
    tests = [Registered.from_json(content) for content in found]
    rows = np.concatenate([rows, np.array([t.row for t in tests], dtype=np.intp)])
    order = np.argsort(rows, kind="stable")
    merged = [
        np.concatenate([own, *(getattr(t.world_from_cam, name)[None] for t in tests)])[order]
        for name, own in poses._asdict().items()
    ]
    return rows[order], Rigid3(*merged)


def _describe(
    scene: Scene,
    images: MapImages,
    id_: str,
    rows: NDArray[np.intp],
    poses: Rigid3,
    facts: dict[str, Any],
    found: list[dict[str, Any]],
) -> dict[str, Any]:
    """One recording: what is registered, what is not, and where VIO disagrees."""
    is_own = images.recording[rows] == images.ids.index(id_)
    own, times = rows[is_own], images.timestamp_s[rows[is_own]]
    breaks = find_breaks(
        poses.at(is_own), images.vio_from_cam.at(own), images.tracking_world[own], times
    )
    is_misplaced = np.zeros(len(own), dtype=bool)
    is_misplaced[find_misplaced(breaks)] = True
    # Images without VIO have NaN here, which is not larger.
    is_misplaced |= (tilt_deg(images, own, poses.at(is_own)) > MAX_TILT_DEG) & images.is_level[own]
    is_misplaced = with_bad_worlds(is_misplaced, images.tracking_world[own])
    broken = {**images.unusable, **facts["broken"]}
    missing = sorted(set(images.rows_of(id_).tolist()) - set(own.tolist()))
    tests = [content for content in found if content["row"] in own]
    error = [content["error_px"] for content in tests]
    return {
        "split": "train" if id_ in scene.splits["train"] else "test",
        "images": len(images.rows_of(id_)) + sum(n.startswith(f"{id_}/") for n in images.unusable),
        "registered": len(own),
        "unregistered": [images.names[k] for k in missing if images.names[k] not in broken],
        "unusable": {n: why for n, why in broken.items() if n.startswith(f"{id_}/")},
        "misplaced": [images.names[k] for k in own[is_misplaced]],
        "parts_from_vio_at_s": times[1:][breaks].tolist(),
        "median_inliers": float(np.median([c["inliers"] for c in tests])) if tests else None,
        "median_error_px": float(np.median(error)) if error else None,
        "tracking_worlds": np.unique(images.tracking_world[images.rows_of(id_)]).tolist(),
    }


def _describe_model(model: Any, models: list[list[str]]) -> dict[str, Any]:
    return {
        "images": int(model.num_reg_images()),
        "points": int(model.num_points3D()),
        "mean_reprojection_error_px": float(model.compute_mean_reprojection_error()),
        "mean_track_length": float(model.compute_mean_track_length()),
        "observations_per_image": float(model.compute_mean_observations_per_reg_image()),
        "other_models": [len(names) for names in models[1:]],
        "cameras": [
            {"model": camera.model.name, "params": list(camera.params)}
            for camera in model.cameras.values()
        ],
    }


def _describe_world(images: MapImages, world: dict[str, Any]) -> dict[str, Any]:
    """Scale and gravity, with the recording that each tracking world is of."""

    def id_of(number: int) -> str:
        return images.ids[images.recording[np.argmax(images.tracking_world == number)]]

    scales = [
        {
            **scale,
            "recording": id_of(scale["world"]),
            "relative": scale["metres_per_unit"] / world["metres_per_unit"],
        }
        for scale in world["scales"]
    ]
    offsets = [
        {"world": int(number), "recording": id_of(int(number)), "offset_deg": offset}
        for number, offset in world["gravity_offset_deg"].items()
    ]
    return {**world, "scales": scales, "gravity_offset_deg": offsets}


def _replace_map(scene: Scene, world_folder: Path, summary: dict[str, Any]) -> None:
    """The new map beside the old one first; then they change places."""
    partial = scene.folder / ".map.partial"
    old = scene.folder / ".map.old"
    try:
        for folder in (partial, old):
            shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(world_folder, partial)
        content = json.dumps(summary, indent=1) + "\n"
        write_atomically(partial / SUMMARY_FILE, content.encode())
        if scene.map_folder.exists():
            scene.map_folder.replace(old)
        partial.replace(scene.map_folder)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        reason = error.strerror or "the disk may be full"
        raise FormatError(scene.map_folder, f"cannot be written: {reason}") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _ground_truth(
    scene: Scene,
    images: MapImages,
    id_: str,
    rows: NDArray[np.intp],
    poses: Rigid3,
    facts: dict[str, Any],
) -> Trajectory | None:
    """Of one recording: its registered images but for misplaced ones, and frames between."""
    bad = set(facts["misplaced"])
    is_own = images.recording[rows] == images.ids.index(id_)
    is_own &= np.array([images.names[k] not in bad for k in rows], dtype=bool)
    if not is_own.any():
        return None
    frames = scene.recording(id_).frames
    mapped, own = images.frame_row[rows[is_own]], poses.at(is_own)
    between, carried = carry_by_vio(frames, mapped, own)
    order = np.argsort(np.concatenate([mapped, between]), kind="stable")
    positions, quats = (np.concatenate(p)[order] for p in zip(own, carried, strict=True))
    times = frames.timestamp_s[np.concatenate([mapped, between])[order]]
    return Trajectory(times, positions, quats)
