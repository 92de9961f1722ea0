"""`vioapr map`: all steps from a scene's recordings to its map and ground truth."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MappingError
from vioapr.mapping import pairs
from vioapr.mapping.alignment import place_model, poses_of_model
from vioapr.mapping.colmap import load_pycolmap, open_database, translated_errors
from vioapr.mapping.features import extract_features, image_ids, read_descriptors
from vioapr.mapping.inputs import collect_images
from vioapr.mapping.matching import MIN_INLIERS, count_inliers, find_islands, match_pairs
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pruning import locate, prune_pairs
from vioapr.mapping.publishing import publish
from vioapr.mapping.reconstruct import reconstruct
from vioapr.mapping.registration import Registered, pairs_by_vio, register_images
from vioapr.mapping.retrieval import describe_images
from vioapr.mapping.two_view import read_geometries
from vioapr.scene.scene import RECORDINGS_FOLDER, Scene
from vioapr.work.child import run_in_child
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress, silent
from vioapr.work.steps import Steps

WORK_FOLDER = ".mapping"
LIKENESS_FILE, PAIRS_FILE, ALL_PAIRS_FILE = "likeness.npy", "pairs.npy", "all_pairs.npy"


def map_scene(
    scene: Scene, params: MappingParams | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Map a scene and find ground truth for all its recordings.

    Writes `map/` (a COLMAP model of the training images in the world frame, and `map.json`) and
    `gt/<id>.tum`, and puts the world into `scene.toml`. What is there already stays until all
    of the new is known. Steps that an earlier run finished are not repeated.

    Args:
        scene: With training recordings, and perhaps test recordings.
        params: How to map.
        progress: Shows progress: given a title and a number of ticks, a context manager that
            yields a function to call at every tick.

    Returns:
        The summary, as in `map.json`.

    Raises:
        MappingError: The recordings cannot be mapped.
        LockedError: Another process is mapping the scene.
        VioAprError: A recording is broken, a package is missing, or a file cannot be written.
    """
    load_pycolmap()
    with locked_folder(scene.folder / WORK_FOLDER):
        return _Mapping(scene, params or MappingParams(), progress).run()


class _Mapping:
    """One run: what its steps share."""

    def __init__(self, scene: Scene, params: MappingParams, progress: Progress) -> None:
        self.scene, self.params, self.progress = scene, params, progress
        self.images = collect_images(scene, params.max_rate_hz)
        self.train = tuple(scene.splits["train"])
        self.test = tuple(scene.splits.get("test", ()))
        self.steps = Steps(scene.folder / WORK_FOLDER)
        self.database = self.steps.folder / "database.db"
        self.sparse, self.world = self.steps.folder / "sparse", self.steps.folder / "world"
        self.image_folder = scene.folder / RECORDINGS_FOLDER

    def run(self) -> dict[str, Any]:
        """All steps."""
        p, images = self.params, self.images
        broken = self.steps.run(
            "features",
            [images.fingerprint, self.train, self.test, p.max_image_size, p.max_features],
            self._extract,
            dict[str, str],
        )
        counts = self.steps.run(
            "matches",
            [p.sequential, p.loops, p.seed],
            lambda resumed: self._match(broken, resumed),
            dict[str, Any],
        )
        counts["pairs"] += self.steps.run(
            "near", [p.spatial], lambda _: self._match_near(broken), int
        )
        counts |= self.steps.run("pruning", [], lambda _: self._prune(), dict[str, Any])
        self._check_islands(counts["islands"])
        models = self.steps.run(
            "model",
            [p.mapper, p.refine_intrinsics],
            lambda _: self._reconstruct(broken),
            list[list[str]],
        )
        self._check_models(models)
        world = self.steps.run("world", [p.allow_partial], self._place, dict[str, Any])
        found = self.steps.run(
            "test", [p.min_inliers], lambda _: self._register(broken), list[dict[str, Any]]
        )
        facts = {"broken": broken, "matches": counts, "models": models, "world": world}
        return publish(self.scene, images, self.params, self.steps, facts, found, self.world)

    def _usable(self, ids: Sequence[str], broken: dict[str, str]) -> NDArray[np.intp]:
        rows = self.images.rows_of_all(ids)
        return np.array([r for r in rows if self.images.names[r] not in broken], dtype=np.intp)

    def _extract(self, is_resumed: bool) -> dict[str, str]:
        if not is_resumed:
            for file in self.steps.folder.glob("database.db*"):
                file.unlink()
        with self.progress("finding features", len(self.images)) as tick:
            return run_in_child(
                extract_features, self.database, self.image_folder, self.images, self.params,
                tick=tick,
            )  # fmt: skip

    def _match(self, broken: dict[str, str], is_resumed: bool) -> dict[str, Any]:
        if not is_resumed:  # the mapper would use the pairs of another choice as well
            with open_database(self.database) as database:
                database.clear_two_view_geometries()
                database.clear_matches()
        rows = self._usable(self.train, broken)
        if len(rows) < 3:
            raise MappingError(f"expected at least 3 training images, got {len(rows)}")
        vectors = self._describe(np.arange(len(self.images)), broken)
        np.save(self.steps.folder / LIKENESS_FILE, vectors)
        chosen = pairs.first_pairs(self.images, rows, vectors[rows] @ vectors[rows].T, self.params)
        np.save(self.steps.folder / PAIRS_FILE, chosen)
        with self.progress("matching images", len(chosen)) as tick:
            run_in_child(match_pairs, self.database, self.images, chosen, self.params, tick=tick)
        return {"pairs": len(chosen)}

    def _match_near(self, broken: dict[str, str]) -> int:
        """Match what is near, now that all tracking worlds are seen to be in one place."""
        images, first = self.images, np.load(self.steps.folder / PAIRS_FILE)
        with self.progress("joining recordings", len(first)) as tick:
            found = read_geometries(self.database, images, first, tick)
            located = locate(images, found, self.params.seed)
        near = pairs.near_pairs(images, self._usable(self.train, broken), *located, self.params)
        everything = pairs.unique_pairs(np.concatenate([first, near]))
        np.save(self.steps.folder / ALL_PAIRS_FILE, everything)
        with self.progress("matching near images", len(near)) as tick:
            run_in_child(match_pairs, self.database, images, near, self.params, tick=tick)
        return len(everything) - len(first)

    def _prune(self) -> dict[str, Any]:
        """Take out what VIO contradicts; then see which recordings are connected."""
        chosen = np.load(self.steps.folder / ALL_PAIRS_FILE)
        with self.progress("checking matches by VIO", len(chosen)) as tick:
            pruned = run_in_child(
                prune_pairs, self.database, self.images, chosen, chosen[:0], self.params.seed,
                tick=tick,
            )  # fmt: skip
        inliers = count_inliers(self.database, self.images, chosen)
        islands = find_islands(self.images, chosen, inliers, self.train)
        good = int((inliers >= MIN_INLIERS).sum())
        return {"good_pairs": good, "pruned_pairs": pruned, "islands": islands}

    def _describe(self, rows: NDArray[np.intp], broken: dict[str, str]) -> NDArray[np.float32]:
        """A vector of looks for every image; zeros for broken ones."""
        usable = [int(r) for r in rows if self.images.names[r] not in broken]
        names = [self.images.names[r] for r in usable]
        with (
            self.progress("comparing looks", len(names)) as tick,
            open_database(self.database) as database,
        ):
            ids = image_ids(database)
            vectors = describe_images(
                lambda name: read_descriptors(database, ids[name]),
                names,
                seed=self.params.seed,
                tick=tick,
            )
        everything = np.zeros((len(rows), vectors.shape[1]), dtype=np.float32)
        everything[usable] = vectors
        return everything

    def _check_islands(self, islands: list[list[str]]) -> None:
        if len(islands) > 1 and not self.params.allow_partial:
            raise MappingError(
                "recordings share no view: "
                + " | ".join(", ".join(island) for island in islands)
                + ". Record a walk that sees both places, take one side out of splits.train in "
                "scene.toml, or map the largest alone with --allow-partial"
            )

    def _reconstruct(self, broken: dict[str, str]) -> list[list[str]]:
        names = [self.images.names[row] for row in self._usable(self.train, broken)]
        known = all(
            self.images.cameras[k].fx is not None
            for k in np.unique(self.images.camera[self.images.rows_of_all(self.train)])
        )
        choice = self.params.refine_intrinsics
        refines = choice == "yes" or (choice == "auto" and not known)
        with self.progress(f"mapping ({self.params.mapper})", len(names)) as tick:
            return run_in_child(
                reconstruct, self.database, self.image_folder, names, self.sparse, self.params,
                refines_intrinsics=refines, tick=tick,
            )  # fmt: skip

    def _check_models(self, models: list[list[str]]) -> None:
        """Every training recording must be in the map."""
        mapped = set(models[0])
        lost = [id_ for id_ in self.train if not mapped & {*self._names(id_)}]
        if lost and not self.params.allow_partial:
            inside = [id_ for id_ in self.train if id_ not in lost]
            raise MappingError(
                f"no image of {', '.join(lost)} could be placed in the map of {', '.join(inside)}: "
                "they share too few views. Record a walk that sees both places, take them out of "
                "splits.train in scene.toml, or go on without them with --allow-partial"
            )

    def _names(self, id_: str) -> list[str]:
        return [self.images.names[row] for row in self.images.rows_of(id_)]

    def _place(self, _: bool) -> dict[str, Any]:
        with translated_errors(self.sparse):
            model = load_pycolmap().Reconstruction(self.sparse)
        gnss = {id_: self.scene.recording(id_).gnss for id_ in self.train}
        answer = place_model(model, self.images, gnss)
        with translated_errors(self.world):
            shutil.rmtree(self.world, ignore_errors=True)
            self.world.mkdir()
            model.write(self.world)
        return answer

    def _register(self, broken: dict[str, str]) -> list[dict[str, Any]]:
        """Poses of the test images: first by looks, then by where VIO says that they must be."""
        rows = self._usable(self.test, broken)
        if not len(rows):
            return []
        with translated_errors(self.world):
            model = load_pycolmap().Reconstruction(self.world)
        mapped, poses = poses_of_model(model, self.images)
        vectors = np.load(self.steps.folder / LIKENESS_FILE)
        count = max(2 * self.params.loops, 10)
        alike = pairs.query_pairs(rows, mapped, vectors[rows] @ vectors[mapped].T, count)
        found = self._register_by(alike, model, "test images")
        near = pairs_by_vio(self.images, rows, found, mapped, poses, count)
        if len(near):
            found += self._register_by(near, model, "test images by VIO")
        return [registered.to_json() for registered in found]

    def _register_by(self, chosen: pairs.Pairs, model: Any, what: str) -> list[Registered]:
        helping = np.load(self.steps.folder / ALL_PAIRS_FILE)
        with self.progress(f"matching {what}", len(chosen)) as tick:
            run_in_child(match_pairs, self.database, self.images, chosen, self.params, tick=tick)
            run_in_child(
                prune_pairs, self.database, self.images, chosen, helping, self.params.seed, tick=int
            )
        with self.progress(f"registering {what}", len(np.unique(chosen[:, 0]))) as tick:
            return register_images(self.database, model, self.images, chosen, self.params, tick)
