"""`vioapr map`: all steps from a scene's recordings to its map and ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.files.atomic import restore_folder
from vioapr.mapping import pairs
from vioapr.mapping.alignment import align_model, poses_of_model
from vioapr.mapping.colmap import load_pycolmap, open_database, read_model, write_model
from vioapr.mapping.features import extract_features, load_opencv
from vioapr.mapping.inputs import MapImages, collect_images
from vioapr.mapping.kept import check_map_folder
from vioapr.mapping.matching import count_inliers, match_pairs
from vioapr.mapping.overlap import describe_gaps, describe_overlaps, find_islands, find_overlaps
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pruning import locate, prune_pairs
from vioapr.mapping.publishing import Results, publish
from vioapr.mapping.reconstruct import Models, reconstruct
from vioapr.mapping.registration import RegisteredImage, pairs_by_vio, register_images
from vioapr.mapping.retrieval import describe_features
from vioapr.mapping.triangulation import triangulate_model
from vioapr.mapping.trust import find_fault
from vioapr.mapping.two_view import read_geometries
from vioapr.mapping.verification import MIN_INLIERS
from vioapr.scene.scene import RECORDINGS_FOLDER, Scene
from vioapr.schemas.map_summary import MapSummary, MatchSummary, WorldSummary
from vioapr.work.child import run_in_child
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress, silent
from vioapr.work.steps import Steps

WORK_FOLDER = ".mapping"
LIKENESS_FILE, PAIRS_FILE, ALL_PAIRS_FILE = "likeness.npy", "pairs.npy", "all_pairs.npy"


def map_scene(
    scene: Scene,
    params: MappingParams | None = None,
    progress: Progress = silent,
    *,
    replace_gt: bool = False,
) -> MapSummary:
    """Map a scene and find ground truth for all its recordings.

    Writes `map/` (a COLMAP model of the training images in the world frame, and `map.json`) and
    `gt/<id>.tum`, and puts the world into `scene.toml`. What is there already stays until all
    of the new is known. Steps that an earlier run finished are not repeated.

    Ground truth that mapping did not write is not replaced: then all of the map's goes to
    `map/gt/`, and the scene keeps its world. Other files in `map/` stay.

    Args:
        scene: With training recordings, and perhaps test recordings.
        params: How to map.
        progress: Opened for every part of the work that takes long.
        replace_gt: Replace ground truth of others too; it is copied to `gt.backup-<number>/` first.

    Returns:
        The summary, as in `map.json`.

    Raises:
        MappingError: The recordings cannot be mapped.
        AlreadyExistsError: `map/` holds a map that vioapr did not make.
        LockedError: Another process is mapping the scene.
        VioAprError: A recording is broken, a package is missing, or a file cannot be written.
    """
    load_pycolmap()
    load_opencv()
    p = params or MappingParams()
    with locked_folder(scene.folder / WORK_FOLDER):
        restore_folder(scene.map_folder)
        check_map_folder(scene)
        run = _Run(scene, collect_images(scene, p.max_rate_hz), p, progress)
        steps = Steps(run.folder)
        run.featureless = steps.run(
            "features",
            [run.images.fingerprint, run.train, run.test, p.max_image_size, p.max_features],
            run.extract_features,
            dict[str, str],
        )
        steps.run("matches", [p.sequential, p.loops, p.seed], run.match_first, int)
        steps.run("near", [p.spatial], run.match_near, int)
        matches = steps.run("pruning", [], run.prune_matches, MatchSummary)
        run.require_one_island(matches)
        models = steps.run("model", [p.mapper, p.refine_intrinsics], run.reconstruct, Models)
        run.require_all_recordings(models.names[0], matches)
        world = steps.run("world", [p.allow_partial], run.align, WorldSummary)
        tests = steps.run("test", [p.min_inliers], run.register_tests, list[RegisteredImage])
        results = Results(run.featureless, matches, models, world, tests, run.world)
        return publish(scene, run.images, p, steps, results, replace_gt=replace_gt)


@dataclass(eq=False)
class _Run:
    """One run: what its steps share, and the steps in their order.

    A step takes whether it was begun with the same inputs and interrupted (see `Steps.run`).
    Its small results are returned and kept in its marker, its large ones are files in `folder`.
    """

    scene: Scene
    images: MapImages
    params: MappingParams
    progress: Progress
    featureless: dict[str, str] = field(default_factory=dict)
    """Names of images in which no features were found, and why."""

    @property
    def train(self) -> tuple[str, ...]:
        """Ids of the training recordings."""
        return tuple(self.scene.splits["train"])

    @property
    def test(self) -> tuple[str, ...]:
        """Ids of the test recordings."""
        return tuple(self.scene.splits.get("test", ()))

    @property
    def folder(self) -> Path:
        """Where the steps leave their results."""
        return self.scene.folder / WORK_FOLDER

    @property
    def image_folder(self) -> Path:
        """What the images' names are relative to."""
        return self.scene.folder / RECORDINGS_FOLDER

    @property
    def database(self) -> Path:
        """COLMAP's database: features and matches."""
        return self.folder / "database.db"

    @property
    def sparse(self) -> Path:
        """The model as structure from motion left it."""
        return self.folder / "sparse"

    @property
    def world(self) -> Path:
        """The model in the world."""
        return self.folder / "world"

    def usable_rows(self, ids: Sequence[str]) -> NDArray[np.intp]:
        """Rows of the recordings' images that have features."""
        rows = self.images.rows_of_all(ids)
        return np.array(
            [row for row in rows if self.images.names[row] not in self.featureless], dtype=np.intp
        )

    def extract_features(self, is_resumed: bool) -> dict[str, str]:
        """Find features; returns names of images without any, and why."""
        if not is_resumed:
            for file in self.folder.glob("database.db*"):
                file.unlink()
        with self.progress("finding features", len(self.images)) as tick:
            return run_in_child(
                extract_features, self.database, self.image_folder, self.images, self.params,
                tick=tick,
            )  # fmt: skip

    def match_first(self, is_resumed: bool) -> int:
        """Match training images that follow each other, or look alike; returns their number."""
        if not is_resumed:  # the mapper would use the pairs of another choice as well
            with open_database(self.database) as database:
                database.clear_two_view_geometries()
                database.clear_matches()
        train = self.usable_rows(self.train)
        if len(train) < 3:
            raise MappingError(f"expected at least 3 training images, got {len(train)}")
        usable = self.usable_rows(self.images.ids)
        names = [self.images.names[row] for row in usable]
        with self.progress("comparing looks", len(names)) as tick:
            described = run_in_child(
                describe_features, self.database, names, self.params.seed, tick=tick
            )
        vectors = np.zeros((len(self.images), described.shape[1]), dtype=np.float32)
        vectors[usable] = described
        likeness = vectors[train] @ vectors[train].T
        chosen = pairs.first_pairs(self.images, train, likeness, self.params)
        np.save(self.folder / LIKENESS_FILE, vectors)
        np.save(self.folder / PAIRS_FILE, chosen)
        with self.progress("matching images", len(chosen)) as tick:
            run_in_child(
                match_pairs, self.database, self.images, chosen, [self.images.by_vio], self.params,
                tick=tick,
            )  # fmt: skip
        return len(chosen)

    def match_near(self, is_resumed: bool) -> int:
        """Match what is near, now that all tracking worlds are seen to be in one place."""
        first = np.load(self.folder / PAIRS_FILE)
        with self.progress("joining recordings", len(first)) as tick:
            found = read_geometries(self.database, self.images, first, tick)
            located = locate(self.images, found, self.params.seed)
        near = pairs.near_pairs(self.images, self.usable_rows(self.train), *located, self.params)
        everything = pairs.unique_pairs(np.concatenate([first, near]))
        np.save(self.folder / ALL_PAIRS_FILE, everything)
        with self.progress("matching near images", len(near)) as tick:
            run_in_child(
                match_pairs,
                self.database,
                self.images,
                near,
                [self.images.by_vio, located],
                self.params,
                tick=tick,
            )
        return len(everything) - len(first)

    def prune_matches(self, is_resumed: bool) -> MatchSummary:
        """Take out what VIO contradicts; then see which recordings are connected."""
        chosen = np.load(self.folder / ALL_PAIRS_FILE)
        with self.progress("checking matches by VIO", len(chosen)) as tick:
            pruned = run_in_child(
                prune_pairs, self.database, self.images, chosen, chosen[:0], self.params.seed,
                tick=tick,
            )  # fmt: skip
        inliers = count_inliers(self.database, self.images, chosen)
        return MatchSummary(
            pairs=len(chosen),
            good_pairs=int((inliers >= MIN_INLIERS).sum()),
            pruned_pairs=pruned,
            islands=find_islands(self.images, chosen, inliers, self.train),
            overlaps=find_overlaps(self.images, chosen, inliers, self.train),
        )

    def require_one_island(self, matches: MatchSummary) -> None:
        """Refuse recordings that share no view, unless a partial map is allowed."""
        if len(matches.islands) > 1 and not self.params.allow_partial:
            raise MappingError(describe_gaps(matches.islands, matches.overlaps))

    def reconstruct(self, is_resumed: bool) -> Models:
        """Make the model: from VIO if that can be trusted, otherwise by the mapper asked for."""
        fault = ""
        if self.params.mapper == "vio":
            names, fault = self.triangulate()
            if not fault:
                return Models(names=[names], mapper="vio")
        mapper = "global" if self.params.mapper == "global" else "incremental"
        names = [self.images.names[row] for row in self.usable_rows(self.train)]
        with self.progress(f"mapping ({mapper})", len(names)) as tick:
            found = run_in_child(
                reconstruct, self.database, self.image_folder, names, self.sparse, self.params,
                refines_intrinsics=self.refines_intrinsics, tick=tick,
            )  # fmt: skip
        return Models(names=found, mapper=mapper, vio_fault=fault)

    def triangulate(self) -> tuple[list[str], str]:
        """Make a model from VIO; returns its images, and what speaks against it."""
        rows = self.usable_rows(self.train)
        chosen = np.load(self.folder / ALL_PAIRS_FILE)
        with self.progress("joining recordings", len(chosen)) as tick:
            found = read_geometries(self.database, self.images, chosen, tick)
            poses, world = locate(self.images, found, self.params.seed)
        # The model starts with the world that most images are in; the others are placed in it.
        is_known = self.images.is_tracked[rows] & poses.is_known[rows]
        if not is_known.any():
            return [], "there is no VIO pose with tracking normal"
        largest = np.bincount(world[rows[is_known]]).argmax()
        start = poses.at(rows)
        start.translation_m[~is_known | (world[rows] != largest)] = np.nan
        with self.progress("mapping (vio)", len(rows)) as tick:
            names = run_in_child(
                triangulate_model, self.database, [self.images.names[row] for row in rows], start,
                self.sparse, self.params, refines_intrinsics=self.refines_intrinsics, tick=tick,
            )  # fmt: skip
        return names, find_fault(read_model(self.sparse), self.images, len(rows))

    @property
    def refines_intrinsics(self) -> bool:
        """Whether focal lengths are adjusted: as asked for, or where any is not known."""
        cameras = np.unique(self.images.camera[self.images.rows_of_all(self.train)])
        is_known = all(self.images.cameras[k].fx is not None for k in cameras)
        choice = self.params.refine_intrinsics
        return choice == "yes" or (choice == "auto" and not is_known)

    def require_all_recordings(self, mapped: list[str], matches: MatchSummary) -> None:
        """Refuse a map without some training recording, unless a partial map is allowed."""
        names = set(mapped)
        rows = [row for row, name in enumerate(self.images.names) if name in names]
        inside = {self.images.ids[k] for k in self.images.recording[rows]}
        lost = [id_ for id_ in self.train if id_ not in inside]
        if lost and not self.params.allow_partial:
            kept = [id_ for id_ in self.train if id_ in inside]
            shared = describe_overlaps(lost, matches.overlaps)
            raise MappingError(
                f"no image of {', '.join(lost)} could be placed in the map of {', '.join(kept)}: "
                f"they share too few views (compared pairs that see the same: {shared}). Record a "
                "walk that sees both places, looking the way these recordings do, take them out "
                "of splits.train in scene.toml, or go on without them with allow_partial"
            )

    def align(self, is_resumed: bool) -> WorldSummary:
        """Move the model into the world."""
        model = read_model(self.sparse)
        gnss = {id_: self.scene.recording(id_).gnss for id_ in self.train}
        summary = align_model(model, self.images, gnss)
        write_model(model, self.world)
        return summary

    def register_tests(self, is_resumed: bool) -> list[RegisteredImage]:
        """Find the poses of the test images: first by looks, then by where VIO says they are."""
        rows = self.usable_rows(self.test)
        if not len(rows):
            return []
        model = read_model(self.world)
        mapped, poses = poses_of_model(model, self.images)
        vectors = np.load(self.folder / LIKENESS_FILE)
        helping = np.load(self.folder / ALL_PAIRS_FILE)
        count = max(2 * self.params.loops, 10)

        def register(chosen: pairs.Pairs, title: str) -> list[RegisteredImage]:
            common = self.database, self.images, chosen
            with self.progress(f"matching {title}", len(chosen)) as tick:
                run_in_child(match_pairs, *common, [self.images.by_vio], self.params, tick=tick)
                run_in_child(prune_pairs, *common, helping, self.params.seed, tick=int)
            with self.progress(f"registering {title}", len(np.unique(chosen[:, 0]))) as tick:
                return register_images(self.database, model, self.images, chosen, self.params, tick)

        alike = pairs.query_pairs(rows, mapped, vectors[rows] @ vectors[mapped].T, count)
        found = register(alike, "test images")
        near = pairs_by_vio(self.images, rows, found, mapped, poses, count)
        return found + (register(near, "test images by VIO") if len(near) else [])
