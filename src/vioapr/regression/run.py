"""A training run before it starts: network, images to learn from, parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from vioapr.errors import FileMissingError, ParameterError, TrainingError
from vioapr.regression.checkpoint import load_backbone_weights
from vioapr.regression.data import PosedFrames, Samples, load_samples, split_frames
from vioapr.regression.networks import PoseNetwork, build
from vioapr.regression.params import TrainingParams
from vioapr.regression.pretrained import LITE0, LITE0_NOTICE, find_pretrained
from vioapr.regression.watch import Watch
from vioapr.scene.scene import Scene
from vioapr.schemas.regressor import REGRESSOR_FILE, STATE_FILE, RegressorSpec


class Run(NamedTuple):
    """A network, its images, and how it learns from them.

    Attributes:
        spec: The regressor's.
        network: With its first weights and its scenes' units.
        samples: To learn from.
        validation: To choose the best epoch by, or None: then the last one is.
        folder: Where checkpoints go.
        params: The loop's.
        tick: Called after every step.
        watch: Told how it goes, or None.
        weights: Where the backbone's first weights come from; None for random ones.
    """

    spec: RegressorSpec
    network: PoseNetwork
    samples: Samples
    validation: Samples | None
    folder: Path
    params: TrainingParams
    tick: Callable[[], object] = lambda: None
    watch: Watch | None = None
    weights: str | None = None


class ChosenFrames(NamedTuple):
    """Recordings with images and ground truth.

    Attributes:
        learning: To learn from, at least one.
        validating: To choose the best epoch by; none for the last epoch.
    """

    learning: list[PosedFrames]
    validating: list[PosedFrames]

    @property
    def images(self) -> int:
        """The number of images, of all recordings."""
        return sum(map(len, [*self.learning, *self.validating]))


def choose_frames(scenes: Sequence[Scene], held_out: Sequence[str] = ()) -> ChosenFrames:
    """Choose the training recordings of scenes; never those of other splits.

    Args:
        scenes: Of different names.
        held_out: Ids of training recordings that are not learned from.

    Raises:
        ParameterError: Scenes of the same name, or nothing is left to learn from.
        TrainingError: There are no images with ground truth, or no recordings of these ids.
        FileError: A recording is missing or broken.
    """
    names = [scene.name for scene in scenes]
    if len(set(names)) < len(names):
        raise ParameterError(f"expected scenes of different names, got {', '.join(names)}")
    frames = split_frames(scenes, "train")
    validating = split_frames(scenes, "train", held_out) if held_out else []
    learning = [one for one in frames if one.recording not in held_out]
    if not learning:
        raise ParameterError("validation: expected to leave recordings to learn from, none is left")
    return ChosenFrames(learning, validating)


def prepare_run(
    scenes: Sequence[Scene],
    frames: ChosenFrames,
    spec: RegressorSpec,
    params: TrainingParams,
    folder: Path,
    weights: Path | None = None,
    tick: Callable[[], object] = lambda: None,
) -> Run:
    """Build the network and load the images.

    Args:
        scenes: In the order of the specification's names.
        frames: Of these scenes.
        spec: The network to build.
        params: How it will be trained; the seed decides the first weights.
        folder: Of the run.
        weights: File with pretrained weights of the backbone; of `efficientnet-lite0`, None
            takes those of the extra `pretrained`.
        tick: Called after every image.

    Raises:
        ParameterError: The network cannot be built.
        MissingExtraError: Weights are not given, and those of the network are not installed.
        FileError: Weights or an image are missing or broken.
    """
    torch.manual_seed(params.seed)
    # Before the images, which can take minutes: wrong weights are known at once.
    network = build(spec)
    origin = None if weights is None else f"Backbone: weights of the file {weights.name}."
    if weights is None and spec.model == LITE0:
        weights, origin = find_pretrained(f"model {LITE0}"), LITE0_NOTICE
    if weights is not None:
        load_backbone_weights(network, weights)
    samples = load_samples(scenes, frames.learning, spec.resize, tick)
    validation = None
    if frames.validating:
        validation = load_samples(scenes, frames.validating, spec.resize, tick)
    set_units(network, samples)
    return Run(spec, network, samples, validation, folder, params, weights=origin)


def set_units(network: PoseNetwork, samples: Samples) -> None:
    """Set the units of all scenes, in which networks say positions, from the training cameras."""
    for scene in range(len(network.size_m)):
        position_m = samples.position_m[samples.scene == scene]
        size_m = float(position_m.std(axis=0).max())
        centre_m = torch.as_tensor(position_m.mean(axis=0), dtype=torch.float32)
        network.set_unit(scene, centre_m, max(size_m, 1e-3))


def check_run(run: Run, *, resume: bool) -> None:
    """Refuse a run that cannot be trained, before anything is started or written.

    Raises:
        FileMissingError: There is no state to resume from.
        ParameterError: There is one, and it is not to be resumed; or more devices than images.
        TrainingError: Images are to be turned whose intrinsics are not known.
    """
    state = run.folder / STATE_FILE
    regressor = run.folder / REGRESSOR_FILE
    if regressor.exists() and not state.exists() and not resume:
        raise ParameterError(
            f"{run.folder}: expected a folder without a regressor, found {REGRESSOR_FILE} and no "
            "state to go on from: another folder begins a new run"
        )
    if state.exists() and not resume:
        raise ParameterError(
            f"{run.folder}: expected a folder without a training run, found {STATE_FILE}: "
            "`resume` goes on with it, another folder begins a new run"
        )
    if resume and not state.exists():
        raise FileMissingError(state, "expected the state of a training run to resume, found none")
    if len(run.samples) < run.params.devices * run.params.nodes:
        raise ParameterError(
            f"devices: expected at most {len(run.samples)}, the training images, "
            f"got {run.params.devices * run.params.nodes}"
        )
    if run.params.augmentation.turn_deg > 0 and not np.isfinite(run.samples.camera).all():
        raise TrainingError(
            "turn_deg: expected known intrinsics of all training images, some have none in "
            "frames.csv: train without turns"
        )
