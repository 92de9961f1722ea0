"""From scenes on disk to a run that can be trained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import torch

from vioapr.errors import ParameterError
from vioapr.regression.checkpoint import load_backbone_weights
from vioapr.regression.data import PosedFrames, load_samples, split_frames
from vioapr.regression.learner import Run, set_units
from vioapr.regression.networks import build
from vioapr.regression.params import TrainingParams
from vioapr.regression.spec import RegressorSpec
from vioapr.scene.scene import Scene


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
        """How many, of all."""
        return sum(map(len, [*self.learning, *self.validating]))


def choose_frames(scenes: Sequence[Scene], held_out: Sequence[str] = ()) -> ChosenFrames:
    """The training recordings of scenes; never those of other splits.

    Args:
        scenes: Of different names.
        held_out: Ids of training recordings that are not learned from.

    Raises:
        ParameterError: Scenes of the same name, or nothing is left to learn from.
        TrainingError: There are no images with ground truth, or no recordings of these ids.
        FormatError: A recording is broken.
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
        spec: What to build.
        params: How it will be trained; the seed decides the first weights.
        folder: Of the run.
        weights: File with pretrained weights of the backbone.
        tick: Called after every image.

    Raises:
        ParameterError: The network cannot be built.
        FormatError: Weights or an image are missing or broken.
    """
    torch.manual_seed(params.seed)
    # Before the images, which can take minutes: what is wrong with the weights is known at once.
    network = build(spec)
    if weights is not None:
        load_backbone_weights(network, weights)
    samples = load_samples(scenes, frames.learning, spec.resize, tick)
    checked = None
    if frames.validating:
        checked = load_samples(scenes, frames.validating, spec.resize, tick)
    set_units(network, samples)
    return Run(spec, network, samples, checked, folder, params)
