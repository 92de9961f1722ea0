"""How sure an index may be: measured on images that it has not seen.

Views of a recording are hidden while its own images are asked for. How far the answers are off
says how sharply to weigh similar views, and what spread and similarity mean in metres and degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from vioapr.geometry import quaternion
from vioapr.regression.networks.retrieval import CUES, Neighbourhood, RetrievalNetwork
from vioapr.regression.prediction import MEDIAN_OF_MEAN

_SHARPNESS = (1.0, 5.0, 10.0, 20.0)
"""Tried: from neighbours that all count alike to the nearest ones almost alone."""

_SMALLEST = 1e-4
"""Error below which answers are equally good, in the scene's unit and in rad."""

_TENTH = 1.774
"""What the mean of three absolute values of Laplace's distribution of size 1 exceeds in one case of
ten."""

_MOST = 2.0
"""Largest power of a cue that an uncertainty follows; the least is none."""


class Fold(NamedTuple):
    """Images that are asked for while a part of the index is hidden.

    Attributes:
        descriptor: (n, components).
        pose: Shape (n, 7), the true ones: x y z in metres and qx qy qz qw.
        is_hidden: Shape (views,).
    """

    descriptor: Tensor
    pose: NDArray[np.float64]
    is_hidden: NDArray[np.bool_]


class MedianError(NamedTuple):
    """Median errors on what was left out.

    Attributes:
        position_m: Of the position.
        orientation_deg: Of the orientation.
    """

    position_m: float
    orientation_deg: float


class _Asked(NamedTuple):
    """Answers to all folds, m of them, and how far off they are.

    Attributes:
        cues: Shape (m, CUES).
        axis_error: Shape (m, 3), of positions, in the scene's unit.
        angle_rad: Shape (m,).
    """

    cues: NDArray[np.float64]
    axis_error: NDArray[np.float64]
    angle_rad: NDArray[np.float64]

    @property
    def median(self) -> tuple[float, float]:
        """Median errors, in the scene's unit and in rad."""
        distance = np.linalg.norm(self.axis_error, axis=-1)
        return float(np.median(distance)), float(np.median(self.angle_rad))


@torch.inference_mode()
def calibrate_index(network: RetrievalNetwork, folds: Sequence[Fold]) -> MedianError:
    """Choose how sharply an index weighs similar views, and fit its uncertainties; in place.

    Args:
        network: With its index filled and its unit set.
        folds: At least one.
    """

    def ask_all(sharpness: float) -> _Asked:
        network.sharpness.fill_(sharpness)
        asked = [_ask(network, fold) for fold in folds]
        return _Asked(*(np.concatenate(column) for column in zip(*asked, strict=True)))

    tried = {sharpness: ask_all(sharpness) for sharpness in _SHARPNESS}
    best = min(tried, key=lambda sharpness: sum(tried[sharpness].median))
    network.sharpness.fill_(best)
    asked = tried[best]
    # Mean absolute errors an axis, as networks learn them.
    errors = np.abs(asked.axis_error).mean(axis=-1), asked.angle_rad / 3**0.5
    weights = np.stack([_fit_scale(asked.cues, error) for error in errors], axis=-1)
    network.sigma_weight.copy_(torch.from_numpy(weights))
    position, angle_rad = asked.median
    return MedianError(position * float(network.size_m[0]), float(np.degrees(angle_rad)))


def _ask(network: RetrievalNetwork, fold: Fold) -> _Asked:
    """Find the poses of a fold's images without its hidden views."""
    hidden = torch.from_numpy(fold.is_hidden).float()
    found: Neighbourhood = network.find(fold.descriptor, hidden)
    scene = torch.zeros(len(fold.pose), dtype=torch.int64)
    true_m = torch.from_numpy(fold.pose[:, :3])
    error = found.position.double() - network.to_unit(true_m, scene)
    quat_xyzw = quaternion.normalize(found.quat_xyzw.double().numpy())
    angle_deg = quaternion.angle_between_deg(quat_xyzw, fold.pose[:, 3:])
    return _Asked(found.cues().double().numpy(), error.numpy(), np.radians(angle_deg))


def _fit_scale(cues: NDArray[np.float64], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fit the logarithm of an error's scale as a weighted sum of cues, shape (CUES,).

    By the likelihood of Laplace's distribution, with a weak prior of no dependence. Then the
    typical error is made to be what is said, as validation does for networks, or the error that one
    in ten exceeds, where that is larger: who is fused by what they say must cover their tails.

    Args:
        cues: Shape (m, CUES).
        error: Shape (m,), mean absolute error of three axes.
    """
    error = np.maximum(error, _SMALLEST)

    def loss(weight: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        log_scale = cues @ weight
        ratio = error * np.exp(-log_scale)
        prior = 0.5 * np.append(0.0, weight[1:]) / len(error)
        value = np.mean(log_scale + ratio) + prior @ weight
        return float(value), cues.T @ (1 - ratio) / len(error) + 2 * prior

    start = np.append(np.log(error.mean()), np.zeros(CUES - 1))
    bounds = [(None, None), *[(0.0, _MOST)] * (CUES - 1)]
    weight = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    ratio = error * np.exp(-cues @ weight)
    weight[0] += np.log(max(np.median(ratio) / MEDIAN_OF_MEAN, np.quantile(ratio, 0.9) / _TENTH))
    return weight
