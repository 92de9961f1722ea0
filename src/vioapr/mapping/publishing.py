"""Writing the map, ground truth and the summary, replacing earlier ones only when all is there."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr._version import __version__
from vioapr.errors import UnwritableError
from vioapr.files.atomic import PARTIAL_SUFFIX, partial_beside, replace_folder
from vioapr.files.text import write_text
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_map
from vioapr.mapping.alignment import poses_of_model
from vioapr.mapping.colmap import read_model
from vioapr.mapping.inputs import MapImages
from vioapr.mapping.joining import MAX_TILT_DEG
from vioapr.mapping.kept import (
    MAP_GT_FOLDER,
    SUMMARY_FILE,
    back_up_gt,
    carry_files,
    foreign_gt_ids,
)
from vioapr.mapping.outliers import find_breaks, find_misplaced, with_bad_worlds
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pruning import tilt_deg
from vioapr.mapping.reconstruct import Models
from vioapr.mapping.registration import RegisteredImage
from vioapr.mapping.vio_interpolation import interpolate_by_vio
from vioapr.scene.gt_origin import remove_gt_file, write_gt_file
from vioapr.scene.scene import GT_FOLDER, Scene
from vioapr.schemas.base import encode
from vioapr.schemas.map_summary import (
    CameraSummary,
    Georeference,
    MapSummary,
    MatchSummary,
    ModelSummary,
    RecordingSummary,
    WorldSummary,
)
from vioapr.schemas.scene import World
from vioapr.trajectory import Trajectory
from vioapr.work.steps import Steps


class Results(NamedTuple):
    """The results of the steps.

    Attributes:
        featureless: Names of images in which no features were found, and why.
        matches: The matches of the training images.
        models: What structure from motion made.
        world: The world of the largest model.
        tests: The registered test images.
        world_folder: The first model, in the world.
    """

    featureless: dict[str, str]
    matches: MatchSummary
    models: Models
    world: WorldSummary
    tests: list[RegisteredImage]
    world_folder: Path


def publish(
    scene: Scene,
    images: MapImages,
    params: MappingParams,
    steps: Steps,
    results: Results,
    *,
    replace_gt: bool = False,
) -> MapSummary:
    """Put `map/`, `gt/` and the world of `scene.toml` in place.

    Where `gt/` has ground truth that mapping did not write, it stays, with its world, and the
    map's goes to `map/gt/`.

    Args:
        scene: The scene.
        images: All images.
        params: How it was mapped.
        steps: The steps taken.
        results: Theirs.
        replace_gt: Replace ground truth of others too; a backup is kept.

    Returns:
        The summary, which is also written.

    Raises:
        UnwritableError: Something cannot be written; what was there stays.
    """
    model = read_model(results.world_folder)
    # All registered images, in order: those of the map, and the test images.
    rows, poses = poses_of_model(model, images)
    rows = np.concatenate([rows, np.array([test.row for test in results.tests], dtype=np.intp)])
    order = np.argsort(rows, kind="stable")
    tests = [tree_map(lambda part: part[None], test.world_from_cam) for test in results.tests]
    poses = tree_map(lambda *parts: np.concatenate(parts)[order], poses, *tests)
    rows = rows[order]

    truths: dict[str, Trajectory | None] = {}
    recordings: dict[str, RecordingSummary] = {}
    for id_ in images.ids:
        is_own = images.recording[rows] == images.ids.index(id_)
        own, own_poses = rows[is_own], poses.at(is_own)
        breaks, is_misplaced = find_contradictions(images, own, own_poses)
        truth = ground_truth(scene, images, id_, own[~is_misplaced], own_poses.at(~is_misplaced))
        truths[id_] = truth
        recordings[id_] = summarize_recording(
            scene, images, id_, own, breaks, is_misplaced, results, truth
        )
    foreign = foreign_gt_ids(scene)
    backup = back_up_gt(scene, foreign).name if foreign and replace_gt else ""
    is_apart = bool(foreign) and not replace_gt
    summary = MapSummary(
        vioapr=__version__,
        params=dataclasses.asdict(params),
        recordings=recordings,
        model=summarize_model(model, results.models),
        matches=results.matches,
        world=results.world,
        seconds=steps.seconds,
        reused_steps=steps.reused,
        gt_folder=MAP_GT_FOLDER if is_apart else GT_FOLDER,
        kept_gt=foreign if is_apart else [],
        gt_backup=backup,
    )
    publish_map(scene, results.world_folder, summary, truths if is_apart else {})
    if not is_apart:
        publish_truths(scene, truths, results.world)
    return summary


def publish_map(
    scene: Scene,
    world_folder: Path,
    summary: MapSummary,
    truths: Mapping[str, Trajectory | None],
) -> None:
    """Put `map/` in place; files in it that mapping did not write stay.

    Args:
        scene: The scene.
        world_folder: The model.
        summary: To be written beside it.
        truths: Ground truth that goes beside it, by recording.

    Raises:
        UnwritableError: Something cannot be written; what was there stays.
    """
    for left in scene.folder.glob(f".{scene.map_folder.name}.*{PARTIAL_SUFFIX}"):
        shutil.rmtree(left, ignore_errors=True)  # by a run that was killed here
    partial = partial_beside(scene.map_folder)
    try:
        shutil.copytree(world_folder, partial)
        write_text(partial / SUMMARY_FILE, encode(summary, indent=1))
        for id_, truth in truths.items():
            if truth is not None:
                write_gt_file(partial / GT_FOLDER / f"{id_}.tum", truth, "mapping", "")
        carry_files(scene.map_folder, partial)
        replace_folder(scene.map_folder, partial)
    except shutil.Error:  # of several files, each with its reason
        raise UnwritableError(scene.map_folder, "cannot be written: the disk may be full") from None
    except OSError as error:
        raise UnwritableError.of(scene.map_folder, error) from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def publish_truths(
    scene: Scene, truths: Mapping[str, Trajectory | None], world: WorldSummary
) -> None:
    """Put `gt/` and the world of `scene.toml` in place.

    Args:
        scene: The scene.
        truths: Ground truth, by recording; None removes that of an earlier map, in another world.
        world: That it is in.

    Raises:
        UnwritableError: Something cannot be written.
    """
    for id_, truth in truths.items():
        if truth is None:
            remove_gt_file(scene.gt_path(id_))
        else:
            scene.write_gt(id_, truth, "mapping")
    geo = world.georeference
    origin = geo.origin if isinstance(geo, Georeference) else None
    # Opened again: recordings may have been imported, and splits edited, while it was mapped.
    dataclasses.replace(
        Scene.open(scene.folder), world=World(world.is_metric, world.is_gravity_aligned, origin)
    ).save()


def find_contradictions(
    images: MapImages, rows: NDArray[np.intp], poses: Rigid3
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where the map and VIO disagree, in one recording.

    Args:
        images: All images.
        rows: The recording's registered images, n of them in order of time.
        poses: Theirs, world_from_cam.

    Returns:
        Between which images they move differently, shape (n - 1,), and which images are
        misplaced, shape (n,).
    """
    worlds = images.tracking_world[rows]
    breaks = find_breaks(poses, images.vio_from_cam.at(rows), worlds, images.timestamp_s[rows])
    is_misplaced = np.zeros(len(rows), dtype=bool)
    is_misplaced[find_misplaced(breaks)] = True
    # Images without VIO have NaN here, which is not larger.
    is_misplaced |= (tilt_deg(images, rows, poses) > MAX_TILT_DEG) & images.is_level[rows]
    return breaks, with_bad_worlds(is_misplaced, worlds)


def ground_truth(
    scene: Scene, images: MapImages, id_: str, rows: NDArray[np.intp], poses: Rigid3
) -> Trajectory | None:
    """The trajectory of one recording: its well placed images, and the frames between them.

    Args:
        scene: The scene.
        images: All images.
        id_: The recording.
        rows: Its registered images that are not misplaced.
        poses: Theirs, world_from_cam.

    Returns:
        In the world; None if there is no such image.
    """
    if not len(rows):
        return None
    frames = scene.recording(id_).frames
    mapped = images.frame_row[rows]
    between, interpolated = interpolate_by_vio(frames, mapped, poses)
    all_rows = np.concatenate([mapped, between])
    order = np.argsort(all_rows, kind="stable")
    both = tree_map(lambda *parts: np.concatenate(parts)[order], poses, interpolated)
    return Trajectory(frames.timestamp_s[all_rows[order]], both.translation_m, both.quat_xyzw)


def summarize_recording(
    scene: Scene,
    images: MapImages,
    id_: str,
    rows: NDArray[np.intp],
    breaks: NDArray[np.bool_],
    is_misplaced: NDArray[np.bool_],
    results: Results,
    truth: Trajectory | None,
) -> RecordingSummary:
    """Say of one recording what is registered, what is not, and where VIO disagrees.

    Args:
        scene: The scene.
        images: All images.
        id_: The recording.
        rows: Its registered images, n of them.
        breaks: Between which of them map and VIO move differently, shape (n - 1,).
        is_misplaced: Shape (n,).
        results: Of the steps.
        truth: Its ground truth, if there is any.
    """
    wanted = images.rows_of(id_)
    unusable = {**images.unusable, **results.featureless}
    missing = [images.names[k] for k in np.setdiff1d(wanted, rows)]
    tests = [test for test in results.tests if test.row in rows]
    registered = len(rows) - int(is_misplaced.sum())
    return RecordingSummary(
        split="train" if id_ in scene.splits["train"] else "test",
        images=len(wanted) + sum(name.startswith(f"{id_}/") for name in images.unusable),
        registered=len(rows),
        unregistered=[name for name in missing if name not in unusable],
        unusable={name: why for name, why in unusable.items() if name.startswith(f"{id_}/")},
        misplaced=[images.names[k] for k in rows[is_misplaced]],
        parts_from_vio_at_s=images.timestamp_s[rows][1:][breaks].tolist(),
        median_inliers=float(np.median([t.inliers for t in tests])) if tests else None,
        median_error_px=float(np.median([t.error_px for t in tests])) if tests else None,
        tracking_worlds=np.unique(images.tracking_world[wanted]).tolist(),
        carried_by_vio=0 if truth is None else len(truth) - registered,
    )


def summarize_model(model: Any, models: Models) -> ModelSummary:
    """Say how large and how exact a model is.

    Args:
        model: COLMAP's reconstruction.
        models: What structure from motion made, its own first.
    """
    return ModelSummary(
        images=int(model.num_reg_images()),
        points=int(model.num_points3D()),
        mean_reprojection_error_px=float(model.compute_mean_reprojection_error()),
        mean_track_length=float(model.compute_mean_track_length()),
        observations_per_image=float(model.compute_mean_observations_per_reg_image()),
        other_models=[len(names) for names in models.names[1:]],
        mapper=models.mapper,
        vio_fault=models.vio_fault,
        cameras=[
            CameraSummary(model=camera.model.name, params=list(camera.params))
            for camera in model.cameras.values()
        ],
    )
