"""Fit an index of training images: described, chosen, whitened, and told how far off it is.

    frames ──► thin_frames ──► fit_retrieval ──► RetrievalNetwork, its spec and its figures

One pass over the images and a few products of matrices: there is no training.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vioapr.errors import ParameterError, TrainingError
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.cache import read_images
from vioapr.regression.checkpoint import load_backbone_weights
from vioapr.regression.data import PosedFrames
from vioapr.regression.index_calibration import Fold, calibrate_index
from vioapr.regression.networks.base import PoseNetwork
from vioapr.regression.networks.retrieval import DESCRIBED, RetrievalNetwork
from vioapr.regression.pretrained import LITE0_NOTICE, RETRIEVAL, find_pretrained
from vioapr.regression.run import ChosenFrames
from vioapr.schemas.regressor import (
    FittedIndex,
    LeftOutKind,
    RegressorSpec,
    RetrievalShape,
    Trained,
)

IMAGE_SIZE = 128
"""Pixels, of the whole image squeezed to a square: 224 retrieves no better, and takes three times
as long (docs/design/regression.md)."""

INDEX_MB = 4.0
"""The largest index, unless asked otherwise."""

_COMPONENTS = 128
_WHITENING = 0.75
"""1 is full whitening, 0 none. Few images give small components that are noise: full whitening
makes these count as much as the others."""

_BYTES_A_VIEW = 4 * (_COMPONENTS + 7)
_CANDIDATES_A_VIEW = 4
"""Images that are described for each that the index can hold; more choices gain little."""

_BATCH = 32

_PARTS = 5
"""Of the only recording, left out in turn: long enough to have no views of the same moment."""

_QUERIES = 2000
"""Images by which uncertainties are calibrated: more change nothing."""

_FEWEST = 10
"""Images below which there is nothing to interpolate, or to calibrate by."""


class Fitted(NamedTuple):
    """A model that was fitted, ready to predict, and to be saved by `save_regressor`.

    Attributes:
        network: In evaluation mode.
        spec: Its specification.
        trained: What it was made from, and how far off it is.
    """

    network: PoseNetwork
    spec: RegressorSpec
    trained: Trained


class Described(NamedTuple):
    """Images described, n of them.

    Attributes:
        values: Shape (n, DESCRIBED).
        pose: Shape (n, 7), x y z in metres and qx qy qz qw.
        recording: Shape (n,), number of each one's recording.
    """

    values: Tensor
    pose: NDArray[np.float64]
    recording: NDArray[np.int64]

    def descriptor(self, network: RetrievalNetwork) -> Tensor:
        """Shorten all, (n, components)."""
        with torch.inference_mode():
            return network.shorten(self.values)


def thin_frames(frames: ChosenFrames, index_mb: float = INDEX_MB) -> ChosenFrames:
    """Leave out images evenly in time, where there are many times more than an index holds.

    Args:
        frames: As chosen for training.
        index_mb: See `fit_retrieval`.

    Raises:
        ParameterError: The index would hold too few images.
    """
    most = _CANDIDATES_A_VIEW * views_of(index_mb)
    step = -(-sum(map(len, frames.learning)) // most)
    thinned = [every_nth(one, step) for one in frames.learning]
    return frames._replace(learning=thinned)


def every_nth(frames: PosedFrames, step: int) -> PosedFrames:
    """Keep every n-th frame of a recording."""
    kept = {
        field.name: getattr(frames, field.name)[::step]
        for field in dataclasses.fields(frames)
        if field.name not in ("scene", "recording")
    }
    return dataclasses.replace(frames, **kept)


def views_of(index_mb: float) -> int:
    """The number of images that an index of a size holds.

    Raises:
        ParameterError: Too few.
    """
    views = int(index_mb * 1e6) // _BYTES_A_VIEW
    if views < _FEWEST:
        least = _FEWEST * _BYTES_A_VIEW / 1e6
        raise ParameterError(f"index_mb: expected at least {least:.2g}, got {index_mb:g}")
    return views


def fit_retrieval(
    scene: str,
    frames: ChosenFrames,
    *,
    index_mb: float = INDEX_MB,
    image_size: int = IMAGE_SIZE,
    weights: Path | None = None,
    tick: Callable[[], object] = lambda: None,
) -> Fitted:
    """Fit an index of a scene's training images.

    Args:
        scene: The scene's name.
        frames: Of `choose_frames`, and `thin_frames` for large scenes. Uncertainties are
            calibrated by the validating recordings; without any, by leaving out each recording in
            turn, or each fifth of the only one.
        index_mb: Megabytes of descriptions and poses, in single precision. Where images do not
            fit, those that are least like each other are kept.
        image_size: Images are squeezed to this square, pixels.
        weights: File of the backbone's weights; None for those of the extra `pretrained`.
        tick: Called after every image.

    Raises:
        MissingExtraError: Weights are not given, and the extra is not installed.
        ParameterError: The index would hold too few images.
        TrainingError: There are too few images.
        FileError: Weights or an image are missing or broken.
    """
    began = time.perf_counter()
    count, most = sum(map(len, frames.learning)), views_of(index_mb)
    if count < _FEWEST:
        raise TrainingError(f"expected at least {_FEWEST} training images, got {count}")
    shape = RetrievalShape(min(count, most), min(_COMPONENTS, count - 1, DESCRIBED))
    spec = RegressorSpec(RETRIEVAL, (scene,), "quat", image_size, image_size, retrieval=shape)
    network = RetrievalNetwork(shape).eval()
    load_backbone_weights(network, weights or find_pretrained(f"model {RETRIEVAL}"))
    candidates = describe_frames(network, frames.learning, image_size, tick)
    fill_projection(network, candidates.values)
    rows = fill_views(network, candidates)
    if frames.validating:
        held_out = describe_frames(network, frames.validating, image_size, tick)
        folds = [Fold(held_out.descriptor(network), held_out.pose, np.zeros(len(rows), bool))]
        left_out = "validation"
    else:
        folds, left_out = folds_of(candidates, candidates.descriptor(network), rows)
    error = calibrate_index(network, folds)
    seconds = time.perf_counter() - began
    index = FittedIndex(
        candidates=count, left_out=left_out, position_m=error.position_m,
        orientation_deg=error.orientation_deg, seconds=round(seconds, 1),
    )  # fmt: skip
    origin = LITE0_NOTICE if weights is None else f"Backbone: weights of the file {weights.name}."
    return Fitted(network, spec, Trained(images=count, weights=origin, index=index))


@torch.inference_mode()
def describe_frames(
    network: RetrievalNetwork,
    frames: Sequence[PosedFrames],
    image_size: int,
    tick: Callable[[], object] = lambda: None,
) -> Described:
    """Describe images, which are decoded ahead."""
    paths = [path for one in frames for path in one.paths]
    images, blocks = read_images(paths, image_size), []
    while block := list(islice(images, _BATCH)):
        batch = torch.from_numpy(np.stack(block))
        blocks.append(network.describe(middle_crop(batch, image_size)))
        for _ in block:
            tick()
    poses = [np.concatenate([one.position_m, one.quat_xyzw], axis=-1) for one in frames]
    recording = np.repeat(np.arange(len(frames)), [len(one) for one in frames])
    return Described(torch.cat(blocks), np.concatenate(poses), recording)


@torch.inference_mode()
def fill_projection(network: RetrievalNetwork, values: Tensor) -> None:
    """Set the principal components that descriptions (n, DESCRIBED) are shortened to."""
    mean = values.mean(dim=0)
    centred = (values - mean).double()
    variance, axes = torch.linalg.eigh(centred.T @ centred / len(values))
    variance, axes = variance.flip(0), axes.flip(1)
    kept = network.shape.components
    # Images that are all alike leave components without any variance: these say nothing.
    scale = variance[:kept].clamp_min(1e-9 * float(variance[0]) + 1e-12) ** (-_WHITENING / 2)
    network.mean.copy_(mean)
    network.projection.copy_(axes[:, :kept] * scale)


@torch.inference_mode()
def fill_views(network: RetrievalNetwork, candidates: Described) -> NDArray[np.int64]:
    """Choose the index's views and set the scene's unit; returns the rows of the chosen."""
    position_m = candidates.pose[:, :3]
    size_m = max(float(position_m.std(axis=0).max()), 1e-3)
    network.set_unit(0, torch.from_numpy(position_m.mean(axis=0)).float(), size_m)
    descriptor = candidates.descriptor(network)
    rows = choose_views(descriptor, network.shape.views)
    pose = candidates.pose[rows]
    pose[:, :3] = (pose[:, :3] - network.centre_m[0].numpy()) / size_m
    network.descriptor.copy_(descriptor[rows].T)
    network.view_pose.copy_(torch.from_numpy(pose))
    return rows


def choose_views(descriptor: Tensor, count: int) -> NDArray[np.int64]:
    """Choose images so that every other one has a similar one among them (k-center, greedy).

    Args:
        descriptor: Unit vectors, (n, components).
        count: To be chosen, at most n.

    Returns:
        Their rows in order, shape (count,).
    """
    if count == len(descriptor):
        return np.arange(count)
    chosen = [0]
    nearest = descriptor @ descriptor[0]
    while len(chosen) < count:
        nearest[chosen[-1]] = torch.inf
        chosen.append(int(nearest.argmin()))
        torch.maximum(nearest, descriptor @ descriptor[chosen[-1]], out=nearest)
    return np.sort(np.array(chosen))


def folds_of(
    candidates: Described, descriptor: Tensor, rows: NDArray[np.int64]
) -> tuple[list[Fold], LeftOutKind]:
    """Divide images by what is left out together: each recording, or each fifth of the only one.

    Args:
        candidates: All images.
        descriptor: Of these, (n, components).
        rows: Of those in the index.
    """
    part, kind = candidates.recording, "recordings"
    if part[0] == part[-1]:
        part, kind = np.arange(len(part)) * _PARTS // len(part), "parts"
    step = -(-len(part) // _QUERIES)
    asked = np.zeros(len(part), dtype=bool)
    asked[::step] = True
    folds = []
    for number in np.unique(part):
        own = np.flatnonzero(asked & (part == number))
        is_hidden = part[rows] == number
        if len(own) and not is_hidden.all():
            folds.append(Fold(descriptor[own], candidates.pose[own], is_hidden))
    return folds, kind
