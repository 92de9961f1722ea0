"""Predictions of a scene's recordings, written as `evaluate` takes them, whoever predicts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from vioapr.errors import AlreadyExistsError
from vioapr.formats.stated_sigmas import Sigmas
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import Scene
from vioapr.scene.walks import APR_PREFIX, write_walk, write_walk_of_recording
from vioapr.trajectory import Trajectory
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Tick, ignore
from vioapr.work.results import ResultFolder
from vioapr.work.steps import fingerprint


class Predictions(NamedTuple):
    """Of one recording's images.

    Attributes:
        poses: world_from_cam of the images that have a prediction.
        sigmas: What is stated of their errors.
    """

    poses: Trajectory
    sigmas: Sigmas


Predict = Callable[[str], Predictions | None]
"""From a recording's id, its predictions; None where no image has one."""


class WrittenPredictions(NamedTuple):
    """A recording whose predictions are written.

    Attributes:
        id: The recording's.
        can_be_evaluated: Whether there are ground truth, VIO and predictions.
        is_kept: Whether the predictions were there, by the same model.
    """

    id: str
    can_be_evaluated: bool
    is_kept: bool


def write_predictions(
    predict: Predict,
    scene: Scene,
    ids: Sequence[str],
    folder: Path,
    name: str,
    *,
    digest: str = "",
    overwrite: bool = False,
    tick: Tick = ignore,
) -> Iterator[WrittenPredictions]:
    """Predict recordings, one after the other, and write each as `evaluate` takes it.

    Predictions that are there, by the same model of the same images, are kept.

    Args:
        predict: Predicts the images of a recording.
        scene: Whose recordings.
        ids: Which.
        folder: Each recording's files go into a folder of its own in this one.
        name: Of the predictions' files, `apr_<name>.tum`.
        digest: The SHA-256 of the model's file, which may have settings behind it; "" to keep no
            predictions.
        overwrite: Whether files may be replaced that prediction did not write, or by another
            model.
        tick: Called for every image of recordings whose predictions are kept.

    Raises:
        AlreadyExistsError: There are such files, and they are not to be replaced.
        LockedError: Another process predicts into the folder.
        FileError: A recording is broken, or a file cannot be written.
    """
    file = f"{APR_PREFIX}{name}.tum"
    keys = {id_: f"{digest} {_fingerprint_images(scene, id_)}" for id_ in ids}
    results = {id_: ResultFolder(folder / id_, overwrite=overwrite) for id_ in ids}
    for id_ in ids:
        _check_predictions(results[id_], name, digest)
    with locked_folder(folder):
        for id_ in ids:
            is_kept = bool(digest) and results[id_].made_from(file) == keys[id_]
            predictions = None
            if is_kept:
                for _ in range(int(scene.recording(id_).frames.has_image.sum())):
                    tick()
            else:
                predictions = predict(id_)
            # Where there are none, those of another model, which may be replaced, go.
            gone = () if is_kept else (f"{APR_PREFIX}{name}.*",)
            with results[id_].adding({file: keys[id_]}, all_of=gone) as partial:
                if predictions is not None:
                    poses, sigmas = predictions
                    write_walk(partial, aprs={name: poses}, apr_sigmas={name: sigmas})
                has_both = write_walk_of_recording(partial, scene, id_)
            has_any = is_kept or predictions is not None
            yield WrittenPredictions(id_, has_both and has_any, is_kept)


def _check_predictions(results: ResultFolder, name: str, digest: str) -> None:
    """See that predictions would replace none of another model, and no file of the user's.

    Args:
        results: The walk's folder.
        name: Of the predictions.
        digest: Of the model's file, or "".

    Raises:
        AlreadyExistsError: They would.
    """
    results.check([f"{APR_PREFIX}{name}.*"])
    file = f"{APR_PREFIX}{name}.tum"
    made_from = results.made_from(file)
    if made_from is not None and made_from.split(" ")[0] != digest and not results.overwrite:
        raise AlreadyExistsError(
            results.folder / file,
            "exists, by another model: choose another `name`, or give `overwrite`",
        )


def _fingerprint_images(scene: Scene, id_: str) -> str:
    """Changes with the images of a recording, and their times."""
    frames = scene.recording(id_).frames
    folder = scene.recording_folder(id_) / IMAGES_FOLDER
    stats = [(folder / name).stat() for name in frames.image if name and (folder / name).exists()]
    sizes = [[found.st_size, found.st_mtime_ns] for found in stats]
    return fingerprint(list(frames.image), frames.timestamp_s, sizes)
