"""How good a network is on recordings that it has not learned from."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.regression.data import Samples
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.prediction import Predicted, predict_images

_MEDIAN_OF_MEAN = 0.891
"""Median of the mean of three absolute values of Laplace's distribution of size 1: a third of
a gamma-distributed number of shape 3."""


def validate(
    network: PoseNetwork, samples: Samples, crop: int, device: torch.device
) -> dict[str, float]:
    """Median errors, and by how much the stated uncertainties are too small.

    Returns:
        position_m, orientation_deg, score (lower is better, for comparing epochs), and the
        factors sigma_position and sigma_orientation.
    """
    was_training = network.training
    network.eval()
    images = (samples.read(np.array([row]))[0] for row in range(len(samples)))
    predicted = predict_images(network, images, crop, device=device)
    network.train(was_training)
    off_m = np.abs(predicted.position_m - samples.position_m)
    angle = _angle_rad(predicted, samples.quat_xyzw)
    median_m = float(np.median(np.linalg.norm(off_m, axis=-1)))
    median_rad = float(np.median(angle))
    size_m = float(network.size_m.mean())
    return {
        "position_m": median_m,
        "orientation_deg": float(np.degrees(median_rad)),
        "score": median_m / size_m + median_rad,
        "sigma_position": _factor(off_m.mean(axis=-1), predicted.sigma_position_m),
        "sigma_orientation": _factor(angle / 3**0.5, predicted.sigma_orientation_rad),
    }


def _angle_rad(predicted: Predicted, quat_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    found = predicted.quat_xyzw / np.linalg.norm(predicted.quat_xyzw, axis=-1, keepdims=True)
    return quaternion.angle_rad(quaternion.multiply(found, quaternion.inverse(quat_xyzw)))


def _factor(errors: NDArray[np.float64], sigmas: NDArray[np.float64]) -> float:
    """By which standard deviations must grow for the typical error to be as they say."""
    mean_of_sigma = sigmas / 2**0.5
    return float(np.median(errors / mean_of_sigma) / _MEDIAN_OF_MEAN)
