"""How good a network is on recordings that it has not learned from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion
from vioapr.regression.data import Samples
from vioapr.regression.networks import PoseNetwork
from vioapr.regression.prediction import predict_images

_MEDIAN_OF_MEAN = 0.891
"""Median of the mean of three absolute values of Laplace's distribution of size 1: a third of
a gamma-distributed number of shape 3."""


def validate(network: PoseNetwork, samples: Samples, crop: int) -> dict[str, float]:
    """Median errors, and by how much the stated uncertainties are too small.

    Returns:
        position_m, orientation_deg, score (lower is better, for comparing epochs), and the
        factors sigma_position and sigma_orientation.
    """
    was_training = network.training
    network.eval()
    images = (image for recording in samples.images for image in recording)
    predicted = predict_images(network, images, crop)
    network.train(was_training)
    off_m = np.abs(predicted.position_m - samples.position_m)
    said = quaternion.normalize(predicted.quat_xyzw)
    angle_rad = np.radians(quaternion.angle_between_deg(said, samples.quat_xyzw))
    median_m = float(np.median(np.linalg.norm(off_m, axis=-1)))
    median_rad = float(np.median(angle_rad))
    size_m = float(network.size_m.mean())
    return {
        "position_m": median_m,
        "orientation_deg": float(np.degrees(median_rad)),
        "score": median_m / size_m + median_rad,
        "sigma_position": _factor(off_m.mean(axis=-1), predicted.sigma_position_m),
        "sigma_orientation": _factor(angle_rad / 3**0.5, predicted.sigma_orientation_rad),
    }


def _factor(errors: NDArray[np.float64], sigmas: NDArray[np.float64]) -> float:
    """By which standard deviations must grow for the typical error to be as they say."""
    mean_of_sigma = sigmas / 2**0.5
    return float(np.median(errors / mean_of_sigma) / _MEDIAN_OF_MEAN)
