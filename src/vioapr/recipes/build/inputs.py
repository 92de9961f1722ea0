"""What a build depends on: the recordings of a scene, by their content."""

from __future__ import annotations

from vioapr.errors import ParameterError
from vioapr.evaluation.view_coverage import Views, views_of
from vioapr.files.digests import digest_of
from vioapr.files.paths import AnyPath
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import SPLITS, Scene
from vioapr.work.steps import fingerprint


def fingerprint_scene(folder: AnyPath) -> str:
    """Change with the recordings of a scene, their images, their splits and others' ground truth.

    Not with what mapping writes: that is a step's result.

    Raises:
        FileError: There is no scene, or its `scene.toml` is broken.
    """
    scene = Scene.open(folder)
    recordings: dict[str, object] = {}
    for id_ in ids_of(scene):
        own = scene.recording_folder(id_)
        tables = {
            path.name: digest_of(path) for path in sorted(own.iterdir()) if path.is_file()
        } if own.is_dir() else {}  # fmt: skip
        images = [
            [path.name, (found := path.stat()).st_size, found.st_mtime_ns]
            for path in sorted((own / IMAGES_FOLDER).glob("*"))
        ]
        gt = digest_of(scene.gt_path(id_)) if has_own_gt(scene, id_) else ""
        recordings[id_] = [tables, images, gt]
    splits = {split: list(scene.splits.get(split, ())) for split in SPLITS}
    return fingerprint(scene.name, splits, recordings)


def fingerprint_gt(scene: Scene) -> str:
    """Change with the ground truth of a scene's recordings, whoever made it."""
    paths = {id_: scene.gt_path(id_) for id_ in ids_of(scene)}
    return fingerprint({id_: digest_of(path) for id_, path in paths.items() if path.exists()})


def ids_of(scene: Scene) -> list[str]:
    """Ids of the recordings in a split, training first."""
    return [id_ for split in SPLITS for id_ in scene.splits.get(split, ())]


def has_own_gt(scene: Scene, id_: str) -> bool:
    """Whether a recording has ground truth that mapping did not make."""
    if not scene.gt_path(id_).exists():
        return False
    origin = scene.gt_origin(id_)
    return origin is None or origin.writer != "mapping"


def needs_map(scene: Scene) -> bool:
    """Whether the poses of some recording are to be found by mapping.

    Raises:
        ParameterError: Some recordings have ground truth of their own, others none.
    """
    ids = ids_of(scene)
    without = [id_ for id_ in ids if not has_own_gt(scene, id_)]
    if without and len(without) < len(ids):
        raise ParameterError(
            f"{scene.folder}: expected ground truth of all recordings or of none, found none of "
            f"{', '.join(without)}: give it, or let vioapr map --replace-gt make that of all"
        )
    return bool(without)


def views_of_split(scene: Scene, split: str) -> dict[str, Views]:
    """Where the images of a split were taken that have ground truth, by recording."""
    found: dict[str, Views] = {}
    for id_ in scene.splits.get(split, ()):
        gt = scene.gt(id_)
        if gt is not None:
            found[id_] = views_of(gt.target_from_source)
    return found
