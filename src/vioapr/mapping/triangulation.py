"""A model from VIO: points are triangulated from its poses, then all are adjusted together.

An incremental mapper spends most of its time on finding poses one by one, adjusting after each.
VIO knows them to decimetres. So all images start at VIO's poses, corrected by loops and joined
into one world; every later step may correct them. Images without a start are placed by the
points that they see.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vioapr.errors import UnwritableError
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.colmap import (
    load_pycolmap,
    open_database,
    registered_images,
    to_rigid3d,
    translated_errors,
)
from vioapr.mapping.params import MappingParams
from vioapr.mapping.verification import MIN_INLIERS
from vioapr.work.progress import Tick

MIN_OBSERVATIONS = 30
"""An image that sees fewer points of the model is taken out and placed again; COLMAP's limit."""

FIRST_ITERATIONS, LATER_ITERATIONS = 25, 50
FIRST_TOLERANCE, LATER_TOLERANCE = 1e-4, 1e-6
"""Of an adjustment; the first one only has to come near: points are found better after it."""

MAX_ROUNDS = 3
SETTLED_SHARE = 0.002
"""Rounds of adjusting and completing end where fewer observations than this share change."""


def triangulate_model(
    database: Path,
    names: Sequence[str],
    world_from_cam: Rigid3,
    folder: Path,
    params: MappingParams,
    *,
    refines_intrinsics: bool,
    tick: Tick,
) -> list[str]:
    """Make a model of images whose poses are roughly known, and write it.

    Args:
        database: With features and verified matches; other images in it play no part.
        names: The images.
        world_from_cam: Where they are, in one world, shape (len(names),); NaN where unknown.
        folder: Where the model is written; what is there is replaced.
        params: Threads, seed.
        refines_intrinsics: Whether focal lengths and distortion are adjusted.
        tick: Called once an image.

    Returns:
        Names of the registered images, sorted; none if no two images have common points.

    Raises:
        MappingError: The database cannot be read or the model cannot be written.
        UnwritableError: The folder cannot be made.
    """
    with translated_errors(database):
        growing = _GrowingModel(database, names, world_from_cam, params, refines_intrinsics)
        growing.triangulate(tick)
        growing.adjust_roughly()
        growing.drop_weak_images()
        growing.place_others(tick)
        growing.adjust_until_settled()
        growing.drop_weak_images()
    shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise UnwritableError.of(folder, error) from None
    with translated_errors(folder):
        growing.model.write(folder)
    return sorted(registered_images(growing.model))


class _GrowingModel:
    """COLMAP's incremental mapper, set going from known poses."""

    def __init__(
        self,
        path: Path,
        names: Sequence[str],
        world_from_cam: Rigid3,
        params: MappingParams,
        refines_intrinsics: bool,
    ) -> None:
        pycolmap = load_pycolmap()
        self.refines_intrinsics, self.threads = refines_intrinsics, params.threads
        self.options = pycolmap.IncrementalMapperOptions()
        self.options.num_threads = params.threads
        self.options.random_seed = params.seed
        self.options.abs_pose_refine_focal_length = refines_intrinsics
        self.options.abs_pose_refine_extra_params = refines_intrinsics
        self.triangulation = pycolmap.IncrementalTriangulatorOptions()
        self.triangulation.random_seed = params.seed
        chosen = pycolmap.DatabaseCacheOptions()
        chosen.min_num_matches, chosen.image_names = MIN_INLIERS, set(names)
        with open_database(path) as database:
            cache = pycolmap.DatabaseCache.create(database, chosen)
        self.model = pycolmap.Reconstruction()
        self.model.load(cache)
        number = {name: k for k, name in enumerate(names)}
        is_known = world_from_cam.is_known
        for image in self.model.images.values():
            k = number[image.name]
            if is_known[k]:
                self._set_pose(image, world_from_cam.at(k).inverse())
        self.mapper = pycolmap.IncrementalMapper(cache)
        self.mapper.begin_reconstruction(self.model)

    def _set_pose(self, image: Any, cam_from_world: Rigid3) -> None:
        pose = to_rigid3d(cam_from_world)
        self.model.frame(image.frame_id).set_cam_from_world(image.camera_id, pose)
        self.model.register_frame(image.frame_id)

    def triangulate(self, tick: Tick) -> None:
        """Find points from the poses of now."""
        for id_ in sorted(self.model.reg_image_ids()):
            self.mapper.triangulate_image(self.triangulation, id_)
            tick()

    def adjust_roughly(self) -> None:
        """Adjust what was triangulated from poses that are wrong by centimetres."""
        if self.refines_intrinsics:
            # A guessed focal length is wrong by more than the poses: it comes first, alone.
            self._adjust(is_first=True, keeps_poses=True)
            self._complete()
        self._adjust(is_first=True)
        self._complete()

    def adjust_until_settled(self) -> None:
        """Adjust and complete in turns until hardly an observation changes."""
        for _ in range(MAX_ROUNDS):
            self._adjust()
            before = self.model.compute_num_observations()
            changed = self._complete()
            if changed <= SETTLED_SHARE * max(before, 1):
                break

    def drop_weak_images(self) -> None:
        """Take out images that see too few points."""
        self.mapper.filter_frames(self.options)
        for image in list(registered_images(self.model).values()):
            if image.num_points3D < MIN_OBSERVATIONS:
                self.mapper.observation_manager.deregister_frame(image.frame_id)

    def place_others(self, tick: Tick) -> None:
        """Place images without a pose by the points that they see, best first."""
        is_growing = True
        while is_growing:
            is_growing = False
            for id_ in self.mapper.find_next_images(self.options, False):
                if self.mapper.register_next_image(self.options, id_):
                    self.mapper.triangulate_image(self.triangulation, id_)
                    tick()
                    is_growing = True
            if is_growing:
                self._complete()
                self._adjust(is_first=True)

    def _complete(self) -> int:
        """Continue, merge and filter points; returns how many observations changed."""
        changed = self.mapper.complete_and_merge_tracks(self.triangulation)
        changed += self.mapper.retriangulate(self.triangulation)
        return changed + self.mapper.filter_points(self.options)

    def _adjust(self, *, is_first: bool = False, keeps_poses: bool = False) -> None:
        if not self.model.num_points3D():
            return
        pycolmap = load_pycolmap()
        options = pycolmap.BundleAdjustmentOptions()
        options.print_summary = False
        options.refine_focal_length = options.refine_extra_params = self.refines_intrinsics
        options.refine_rig_from_world = not keeps_poses
        solver = options.ceres.solver_options
        solver.num_threads = self.threads
        solver.max_num_iterations = FIRST_ITERATIONS if is_first else LATER_ITERATIONS
        solver.function_tolerance = FIRST_TOLERANCE if is_first else LATER_TOLERANCE
        if is_first:  # many points are still wrong
            options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
        self.mapper.adjust_global_bundle(self.options, options)
