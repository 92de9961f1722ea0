"""Poses of images by a trained regressor, and the files that fusion and evaluation take."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.stated_sigmas import Sigmas
from vioapr.geometry import quaternion
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.cache import read_images
from vioapr.regression.checkpoint import LoadedRegressor, load
from vioapr.regression.data import Samples
from vioapr.regression.networks import PoseNetwork
from vioapr.scene.cameras import describe_other_camera, relative_camera
from vioapr.scene.predictions import Predictions, write_predictions
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import Scene
from vioapr.trajectory import Trajectory

_LOG = logging.getLogger(__name__)

MEDIAN_OF_MEAN = 0.891
"""Median of the mean of three absolute values of Laplace's distribution of size 1: a third of
a gamma-distributed number of shape 3."""


class Predicted(NamedTuple):
    """Poses world_from_cam of n images.

    Attributes:
        position_m: Shape (n, 3).
        quat_xyzw: Shape (n, 4).
        sigma_position_m: Shape (n,).
        sigma_orientation_rad: Shape (n,).
        scene: Shape (n,), number of the scene that the network sees in each.
    """

    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    sigma_position_m: NDArray[np.float64]
    sigma_orientation_rad: NDArray[np.float64]
    scene: NDArray[np.int64]


def predict_images(
    network: PoseNetwork,
    images: Iterable[NDArray[np.uint8]],
    crop: int,
    *,
    batch_size: int = 32,
    tick: Callable[[], object] = lambda: None,
) -> Predicted:
    """Predict the poses of images.

    Args:
        network: In evaluation mode, on any device.
        images: Each of shape (resize, resize, 3), RGB.
        crop: Size of the middle part that the network sees.
        batch_size: Images at once.
        tick: Called after every image.
    """
    device, images = network.size_m.device, iter(images)
    columns: list[list[NDArray]] = [[] for _ in Predicted._fields]
    while block := list(islice(images, batch_size)):
        with torch.inference_mode():
            batch = torch.from_numpy(np.stack(block)).to(device)
            raw = network.forward_raw(middle_crop(batch, crop))
            predicted = network.to_prediction(raw)
            scene = torch.zeros(len(batch), dtype=torch.int64)
            if raw.scene_logits is not None:
                scene = raw.scene_logits.argmax(dim=-1)
        for column, values in zip(columns, (*predicted, scene), strict=True):
            column.append(values.cpu().numpy())
        for _ in block:
            tick()
    *poses, scenes = (np.concatenate(column) for column in columns)
    position, quat, sigma_m, sigma_rad = (values.astype(np.float64) for values in poses)
    return Predicted(position, quat, sigma_m, sigma_rad, scenes)


def validate(network: PoseNetwork, samples: Samples, crop: int) -> dict[str, float]:
    """Measure median errors, and by how much the stated uncertainties are too small.

    Returns:
        position_m, orientation_deg, score (lower is better, for comparing epochs), and the
        factors sigma_position and sigma_orientation, by which standard deviations must grow for
        the typical error to be as they say.
    """
    was_training = network.training
    network.eval()
    images = (image for recording in samples.images for image in recording)
    predicted = predict_images(network, images, crop)
    network.train(was_training)
    error_m = np.abs(predicted.position_m - samples.position_m)
    quat_xyzw = quaternion.normalize(predicted.quat_xyzw)
    angle_rad = np.radians(quaternion.angle_between_deg(quat_xyzw, samples.quat_xyzw))
    median_m = float(np.median(np.linalg.norm(error_m, axis=-1)))
    median_rad = float(np.median(angle_rad))
    # Mean absolute errors an axis over those that Laplace's distribution has at this sigma.
    ratio_m = error_m.mean(axis=-1) / (predicted.sigma_position_m / 2**0.5)
    ratio_rad = angle_rad / 3**0.5 / (predicted.sigma_orientation_rad / 2**0.5)
    return {
        "position_m": median_m,
        "orientation_deg": float(np.degrees(median_rad)),
        "score": median_m / float(network.size_m.mean()) + median_rad,
        "sigma_position": float(np.median(ratio_m) / MEDIAN_OF_MEAN),
        "sigma_orientation": float(np.median(ratio_rad) / MEDIAN_OF_MEAN),
    }


def predict_recording(
    regressor: LoadedRegressor,
    scene: Scene,
    id_: str,
    *,
    batch_size: int = 32,
    tick: Callable[[], object] = lambda: None,
) -> tuple[Trajectory, Predicted]:
    """Predict the poses of all images of a recording, with or without ground truth.

    Raises:
        FileError: The recording has no images, or one is broken.
    """
    frames = scene.recording(id_).frames
    rows = np.flatnonzero(frames.has_image)
    folder = scene.recording_folder(id_) / IMAGES_FOLDER
    if not len(rows):
        raise FormatError(folder, "expected images, found none")
    expected = getattr(regressor.spec.points, "camera", None)
    camera = relative_camera(frames.at_rows(rows).intrinsics)
    if problem := describe_other_camera(camera, expected):
        _LOG.warning("%s: %s: take a model of this camera's recordings", id_, problem)
    images = read_images([folder / frames.image[row] for row in rows], regressor.spec.resize)
    predicted = predict_images(
        regressor.network, images, regressor.spec.crop, batch_size=batch_size, tick=tick
    )
    poses = Trajectory.from_arrays(
        frames.timestamp_s[rows], predicted.position_m, predicted.quat_xyzw
    )
    return poses, predicted


class PredictedWalk(NamedTuple):
    """A recording whose predictions are written.

    Attributes:
        id: The recording's.
        scene: Shape (n,), number of the scene that the network sees in each image.
        can_be_evaluated: Whether there are ground truth and VIO beside the predictions.
        is_kept: Whether the predictions were there, by this regressor; `scene` is empty then.
    """

    id: str
    scene: NDArray[np.int64]
    can_be_evaluated: bool
    is_kept: bool = False


def load_predictor(path: Path) -> LoadedRegressor:
    """Read a regressor as `checkpoint.load`, onto the GPU if there is one.

    Raises:
        FileError: It is missing, broken, half-written or something else.
    """
    regressor = load(path)
    regressor.network.to("cuda" if torch.cuda.is_available() else "cpu")
    return regressor


def predict_walks(
    regressor: LoadedRegressor,
    scene: Scene,
    ids: Sequence[str],
    folder: Path,
    name: str,
    *,
    digest: str = "",
    overwrite: bool = False,
    batch_size: int = 32,
    tick: Callable[[], object] = lambda: None,
) -> Iterator[PredictedWalk]:
    """Predict recordings, one after the other, and write each as `evaluate` takes it.

    Predictions that are there, by the same regressor of the same images, are kept; see
    `write_predictions`.

    Args:
        regressor: On any device.
        scene: Whose recordings.
        ids: Which.
        folder: Each recording's files go into a folder of its own in this one.
        name: Of the predictions' files, `apr_<name>.tum`.
        digest: The SHA-256 of the regressor's file; "" to keep no predictions.
        overwrite: Whether files may be replaced that prediction did not write, or by another
            regressor.
        batch_size: Images at once.
        tick: Called after every image.

    Raises:
        AlreadyExistsError: There are such files, and they are not to be replaced.
        LockedError: Another process predicts into the folder.
        FileError: A recording has no images, is broken, or a file cannot be written.
    """
    seen: dict[str, NDArray[np.int64]] = {}

    def predict(id_: str) -> Predictions:
        poses, predicted = predict_recording(
            regressor, scene, id_, batch_size=batch_size, tick=tick
        )
        seen[id_] = predicted.scene
        sigma_deg = np.degrees(predicted.sigma_orientation_rad)
        return Predictions(poses, Sigmas(predicted.sigma_position_m, sigma_deg))

    written = write_predictions(
        predict, scene, ids, folder, name, digest=digest, overwrite=overwrite, tick=tick
    )
    for walk in written:
        unseen = np.zeros(0, dtype=np.int64)
        yield PredictedWalk(walk.id, seen.get(walk.id, unseen), walk.can_be_evaluated, walk.is_kept)
