"""The whole reproduction: imports, trainings, predictions, tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from vioapr.errors import UnwritableError
from vioapr.recipes.comparison import compare, compare_references, load_paper
from vioapr.recipes.datasets import (
    DataSet,
    FoundScenes,
    choose_scenes,
    find_scenes,
    import_scene,
)
from vioapr.recipes.paper import MODELS, Configuration, choose_models
from vioapr.recipes.pooling import pool_errors
from vioapr.recipes.report import Report, comparison_table, reference_table
from vioapr.recipes.trainings import (
    SCENES_FOLDER,
    Training,
    count_images,
    finished_epochs,
    keep_settings,
    plan_trainings,
    predicted_note,
    work_of,
)
from vioapr.scene.scene import Scene
from vioapr.schemas.reproduction import ImageCounts, ReproducedTraining, Reproduction
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress


@dataclass(frozen=True)
class Request:
    """A reproduction to make.

    Attributes:
        data_set: Which.
        data: Its folder.
        out: Everything goes here, and what is there already is not done again.
        scenes: Some of the data set's; none for all.
        models: Keys of `MODELS`.
        change: From a published configuration to the one that is wanted, see `paper.changed`.
        weights: Files of the models' backbones.
    """

    data_set: DataSet
    data: Path
    out: Path
    scenes: Sequence[str] = ()
    models: Sequence[str] = tuple(MODELS)
    change: Callable[[Configuration], Configuration] = lambda published: published
    weights: Mapping[str, Path | None] = field(default_factory=dict)


def reproduce(
    request: Request, progress: Progress, say: Callable[[str], object] = lambda text: None
) -> Report:
    """Import, train, predict and compare; go on where an earlier call was stopped.

    Args:
        request: Data set, folders and settings.
        progress: Opened for every recording that is imported, and for all trainings.
        say: Called with a line on every part that is done.

    Raises:
        LockedError: Another process reproduces in the folder.
        VioAprError: Something is not as it should be; all that is finished stays.
    """
    data_set = request.data_set
    models = choose_models(request.models)
    wanted = choose_scenes(data_set, request.scenes)
    found = find_scenes(request.data, data_set, wanted)
    trainings = plan_trainings(
        data_set, tuple(found.folders), models, request.out, request.change, request.weights
    )
    try:
        request.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnwritableError.of(request.out, error) from None
    with locked_folder(request.out):
        return _reproduce_alone(request, found, trainings, progress, say)


def _reproduce_alone(
    request: Request,
    found: FoundScenes,
    trainings: Sequence[Training],
    progress: Progress,
    say: Callable[[str], object],
) -> Report:
    """Do what is left, in a folder that no other process reproduces in; see `reproduce`."""
    data_set, models = request.data_set, choose_models(request.models)
    wanted = choose_scenes(data_set, request.scenes)
    for training in trainings:
        keep_settings(training)
    scenes = {
        name: import_scene(data_set, source, request.out / SCENES_FOLDER / name, progress)
        for name, source in found.folders.items()
    }
    run_trainings(trainings, scenes, progress, say)
    pooled = {}
    parts = [(one, name) for one in trainings for name in one.scenes]
    with progress("fusing", len(parts)) as tick:
        for training, name in parts:
            walks = [training.walks_folder(name) / id_ for id_ in scenes[name].splits["test"]]
            pooled[training.model, name] = pool_errors(walks, training.model)
            tick(1)
    comparisons = lines = None
    if data_set.has_tracker:
        comparisons = tuple(compare(pooled, data_set.groups, models))
        tables = tuple(map(comparison_table, comparisons))
    else:
        lines = tuple(compare_references(data_set.name, wanted, models, pooled))
        tables = (reference_table(data_set.title, lines, models),)
    content = Reproduction(
        title=data_set.title,
        differences=tuple(dict.fromkeys(text for one in trainings for text in one.differences)),
        notes=(*scene_notes(data_set, found, scenes), *training_notes(trainings)),
        trainings=tuple(
            ReproducedTraining(model=one.model, **msgspec.structs.asdict(one.settings))
            for one in trainings
        ),
        tables=comparisons,
        scenes=lines,
    )
    return Report(content, tables)


def run_trainings(
    trainings: Sequence[Training],
    scenes: Mapping[str, Scene],
    progress: Progress,
    say: Callable[[str], object],
) -> None:
    """Train and predict all that is left, under one bar; see `reproduce`."""
    open_ = [(one, work) for one in trainings if (work := work_of(one, scenes)).images]
    done = len(trainings) - len(open_)
    if done:
        say(f"{done} of {len(trainings)} trainings are finished already")
    if not open_:
        return
    from vioapr.recipes.running import run_training

    with progress("training and predicting, images", sum(work.images for _, work in open_)) as tick:
        for number, (training, _) in enumerate(open_, start=done + 1):
            place = f"{training.title} ({number} of {len(trainings)})"
            begun, epochs = finished_epochs(training), training.configuration.epochs
            say(f"{place}: epochs {begun} of {epochs} done, going on")
            run_training(training, scenes, tick)
            say(f"{place}: trained, predicted")


def scene_notes(
    data_set: DataSet, found: FoundScenes, scenes: Mapping[str, Scene]
) -> Iterator[str]:
    """Say what one must know of the scenes to read the tables, a line each."""
    if found.missing:
        yield f"MISSING in the data's folder: {', '.join(found.missing)}"
    for folder in found.unknown:
        yield f"passed over: {folder.name}, which is none of the data set's scenes by name"
    printed = load_paper().images if data_set.name == "marvin" else {}
    for name, scene in scenes.items():
        images = ImageCounts(count_images(scene, "train"), count_images(scene, "test"))
        if name in printed and images != printed[name]:
            yield (
                f"{name}: {images.train} images to train and {images.test} to test with, "
                f"{printed[name].train} and {printed[name].test} in the paper's Table 1"
            )
        if scene.excluded:
            ids = ", ".join(scene.excluded)
            yield f"{name}: recordings left out, as their tracker diverges: {ids}"
    if data_set.has_tracker:
        yield (
            "figures are over all test frames of a scene, as the paper's; share: part of them "
            "that the fused figures count; raw, same: the regressor alone on those very frames"
        )
    else:
        yield "no tracker's poses in this data set: nothing to fuse, so these are raw medians"


def training_notes(trainings: Sequence[Training]) -> Iterator[str]:
    """Say how often a network of several scenes saw the right one."""
    for training in trainings:
        for name in training.scenes if len(training.scenes) > 1 else ():
            note = predicted_note(training, name)
            if note is not None and note.images:
                share = 100 * note.right_scene / note.images
                yield f"{training.title}: {share:.1f} % of {name}'s test images taken for {name}"
