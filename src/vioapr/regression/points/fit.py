"""Fit a map of points: views chosen, their key points triangulated, and told when it is sure.

    frames ──► retrieval ──► views ──► key points ──► triangulated ──► PointsNetwork, calibrated

There is no training: poses are known, and the descriptors are XFeat's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from vioapr.errors import ParameterError, TrainingError
from vioapr.geometry import quaternion
from vioapr.regression.augmentation import middle_crop
from vioapr.regression.cache import read_images
from vioapr.regression.data import PosedFrames
from vioapr.regression.networks.xfeat import DESCRIPTOR
from vioapr.regression.points.calibration import Query, calibrate_points
from vioapr.regression.points.keypoints import Keypoints
from vioapr.regression.points.network import PointsNetwork
from vioapr.regression.points.triangulation import (
    MapPoints,
    Picture,
    nearest_views,
    triangulate,
)
from vioapr.regression.pretrained import LITE0_NOTICE, POINTS, XFEAT_NOTICE, find_xfeat
from vioapr.regression.retrieval import Fitted, choose_views, every_nth, fit_retrieval
from vioapr.regression.run import ChosenFrames
from vioapr.schemas.regressor import (
    FittedMap,
    LeftOutKind,
    PointsShape,
    RegressorSpec,
    RetrievalShape,
    Trained,
)

IMAGE_SIZE = 288
"""Pixels, of the whole image squeezed to a square."""

MAP_MB = 8.0
"""The largest map, unless asked otherwise."""

_POINTS = 256
_BYTES_A_VIEW = _POINTS * (DESCRIPTOR + 12) + 1024
_CANDIDATES_A_VIEW = 4
_SHARE = 2
"""One view of this number of candidates: neighbours in a walk see the same."""

_FEWEST_VIEWS = 10
_OTHERS = 12
"""Pictures by which a view's key points are triangulated."""

_PARTS = 5
_QUERIES = 150
"""Images by which it is calibrated."""

_CAMERA_TOLERANCE = 0.01

_WHOLE_INDEX_MB = 1e3
"""Of the retrieval within: it holds all candidates, whose number the map bounds."""


class PointsPlan(NamedTuple):
    """What a map will be fitted to.

    Attributes:
        frames: Thinned evenly in time, where there are many times more than the map holds.
        views: Pictures of the map.
        queries: Images by which it is calibrated, at most.
    """

    frames: ChosenFrames
    views: int
    queries: int

    @property
    def images(self) -> int:
        """How often an image will be looked at."""
        return self.frames.images + self.views + self.queries


def plan_points(frames: ChosenFrames, map_mb: float = MAP_MB) -> PointsPlan:
    """Plan a map.

    Args:
        frames: Of `choose_frames`. The map is calibrated by the validating recordings; without
            any, by hiding each recording in turn, or each fifth of the only one.
        map_mb: Megabytes of points, descriptors of 8 bits.

    Raises:
        ParameterError: The map would hold too few views.
        TrainingError: There are too few images.
    """
    most = int(map_mb * 1e6) // _BYTES_A_VIEW
    if most < _FEWEST_VIEWS:
        least = _FEWEST_VIEWS * _BYTES_A_VIEW / 1e6
        raise ParameterError(f"map_mb: expected at least {least:.2g}, got {map_mb:g}")
    count = sum(map(len, frames.learning))
    if count < _FEWEST_VIEWS:
        raise TrainingError(f"expected at least {_FEWEST_VIEWS} training images, got {count}")
    step = -(-count // (most * _CANDIDATES_A_VIEW))
    thinned = frames._replace(learning=[every_nth(one, step) for one in frames.learning])
    kept = sum(map(len, thinned.learning))
    asked = sum(map(len, frames.validating)) or kept
    views = max(min(most, kept // _SHARE), _FEWEST_VIEWS)
    return PointsPlan(thinned, views, min(_QUERIES, asked))


def fit_points(
    scene: str,
    plan: PointsPlan,
    *,
    image_size: int = IMAGE_SIZE,
    tick: Callable[[], object] = lambda: None,
) -> Fitted:
    """Fit a map of a scene's training images.

    Args:
        scene: The scene's name.
        plan: Of `plan_points`.
        image_size: Images are squeezed to this square, pixels; a multiple of 32.
        tick: Called after every image.

    Raises:
        MissingExtraError: The weights of XFeat or of the backbone are not installed.
        TrainingError: There are too few images, or their cameras are unknown or differ.
        FileError: An image is missing or broken.
        ParameterError: The images' size is not a multiple of 32.
    """
    if image_size % 32:
        raise ParameterError(f"resize: expected a multiple of 32 pixels, got {image_size}")
    began, weights = time.perf_counter(), find_xfeat(f"model {POINTS}")
    candidates = Candidates.of(plan.frames.learning)
    camera = common_camera(candidates.camera)
    index = fit_retrieval(
        scene, plan.frames, index_mb=_WHOLE_INDEX_MB, image_size=image_size // 2, tick=tick
    )
    assert isinstance(index.spec.retrieval, RetrievalShape)
    fx, fy, cx, cy = camera.tolist()
    shape = PointsShape(
        plan.views, index.spec.retrieval, (fx, fy, cx, cy), neighbours=min(10, plan.views)
    )
    spec = RegressorSpec(POINTS, (scene,), "quat", image_size, image_size, points=shape)
    network = PointsNetwork(shape).eval()
    network.retrieval.load_state_dict(index.network.state_dict())
    network.xfeat.load_published(torch.load(weights, weights_only=True, map_location="cpu"))
    network.set_unit(0, network.retrieval.centre_m[0], float(network.retrieval.size_m[0]))
    network.camera.copy_(torch.from_numpy(camera * image_size))
    rows = choose_views(network.retrieval.descriptor.T, plan.views)
    points = fill_map(network, candidates, rows, image_size, tick)
    queries, left_out = choose_queries(candidates, rows, plan)
    error = calibrate_points(network, queries, image_size, tick)
    seconds = round(time.perf_counter() - began, 1)
    fitted = FittedMap(plan.views, points, left_out, *error, seconds)
    notice = f"{LITE0_NOTICE} {XFEAT_NOTICE}"
    return Fitted(network, spec, Trained(images=len(candidates), weights=notice, map=fitted))


class Candidates(NamedTuple):
    """Images with poses, n of them.

    Attributes:
        paths: Of the images.
        position_m: Shape (n, 3).
        quat_xyzw: Shape (n, 4), world_from_cam.
        camera: Shape (n, 4), see `PosedFrames`.
        recording: Shape (n,), number of each one's recording.
    """

    paths: tuple[Path, ...]
    position_m: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    camera: NDArray[np.float64]
    recording: NDArray[np.int64]

    @classmethod
    def of(cls, frames: Sequence[PosedFrames]) -> Candidates:
        """Those of all recordings."""
        return cls(
            tuple(path for one in frames for path in one.paths),
            np.concatenate([one.position_m for one in frames]),
            np.concatenate([one.quat_xyzw for one in frames]),
            np.concatenate([one.camera for one in frames]),
            np.repeat(np.arange(len(frames)), [len(one) for one in frames]),
        )

    def __len__(self) -> int:
        return len(self.paths)


def common_camera(camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """The camera of all images, shape (4,), over their width and height.

    Raises:
        TrainingError: It is unknown, or there are several.
    """
    known = camera[np.isfinite(camera).all(axis=-1)]
    if not len(known):
        raise TrainingError(
            "model points: expected images whose camera is known (fx, fy, cx, cy), found none: "
            "import them with --focal-px, or map the scene"
        )
    middle = np.median(known, axis=0)
    off = np.abs(known - middle).max()
    if off > _CAMERA_TOLERANCE:
        raise TrainingError(
            "model points: expected images of one camera, found cameras that differ by "
            f"{off:.0%} of the image's size: make a scene of one phone's recordings"
        )
    return middle


@torch.inference_mode()
def fill_map(
    network: PointsNetwork,
    candidates: Candidates,
    rows: NDArray[np.int64],
    image_size: int,
    tick: Callable[[], object],
) -> int:
    """Triangulate the key points of some views and keep them; returns how many there are."""
    rotation = quaternion.to_matrix(candidates.quat_xyzw[rows])
    centre_m = candidates.position_m[rows] - network.centre_m[0].numpy()
    pictures = []
    for image, turn, place in zip(
        read_images([candidates.paths[row] for row in rows], image_size),
        rotation,
        centre_m,
        strict=True,
    ):
        _, keypoints = network.look(middle_crop(torch.from_numpy(np.stack([image])), image_size))
        turned, place_m = (torch.from_numpy(part).float() for part in (turn.T.copy(), place))
        pictures.append(Picture(keypoints, turned, place_m, network.camera))
        tick()
    near = nearest_views(
        centre_m, rotation[:, :, 2], np.arange(len(rows)), _OTHERS, float(network.size_m[0])
    )
    kept = []
    for view, others in zip(pictures, near, strict=True):
        found = triangulate(view, [pictures[other] for other in others])
        kept.append(best_points(view.keypoints, found, network.shape.points))
    known = (descriptor for _, descriptor in kept if len(descriptor))
    largest = max((float(descriptor.abs().max()) for descriptor in known), default=1.0)
    network.descriptor_scale.fill_(largest / 127)
    for row, (picture, (world_m, descriptor)) in enumerate(zip(pictures, kept, strict=True)):
        count = len(world_m)
        packed = torch.round(descriptor / network.descriptor_scale).to(torch.int8)
        network.point_m[row, : count * 3] = world_m.reshape(-1)
        network.point_descriptor[row, : count * DESCRIPTOR] = packed.reshape(-1)
        network.view_rotation[row] = picture.rotation
        network.view_translation_m[row] = -(picture.rotation @ picture.centre_m)
    network.view_descriptor.copy_(network.retrieval.descriptor[:, rows])
    return sum(len(world_m) for world_m, _ in kept)


def best_points(
    keypoints: Keypoints, found: MapPoints, most: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Places and descriptors of the points that most pictures agree on."""
    worth = found.others + keypoints.score
    order = torch.argsort(worth, descending=True, stable=True)[:most]
    order = order[found.others[order] > 0]
    return found.world_m[order], keypoints.descriptor[order]


def choose_queries(
    candidates: Candidates, rows: NDArray[np.int64], plan: PointsPlan
) -> tuple[list[Query], LeftOutKind]:
    """Images with known poses, and the views that must be hidden for each."""
    kind: LeftOutKind
    if plan.frames.validating:
        asked, kind = Candidates.of(plan.frames.validating), "validation"
        hidden = np.zeros((len(asked), len(rows)), dtype=bool)
    else:
        asked, part, kind = candidates, candidates.recording, "recordings"
        if part[0] == part[-1]:
            part, kind = np.arange(len(part)) * _PARTS // len(part), "parts"
        hidden = part[:, None] == part[rows]
    step = -(-len(asked) // plan.queries)
    return [
        Query(asked.paths[row], asked.position_m[row], asked.quat_xyzw[row], hidden[row])
        for row in range(0, len(asked), step)
        if not hidden[row].all()
    ], kind
