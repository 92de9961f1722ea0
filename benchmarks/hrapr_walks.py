"""Walks of HR-APR's public repository: predictions raw and refined, with similarity scores.

The repository (https://github.com/lck666666/HR-APR, no licence: never copied into this one) holds,
for each scene and regressor, the predictions of the test images, the same refined by 10, 30 and 50
iterations of NeFeS, and the similarity of each image to training images near its prediction.

Poses of all files are world_from_cam with OpenGL camera axes, `name x y z qw qx qy qz`, metres;
`check_readings` sees to it, by the errors against ground truth. The world is turned upright by the
mean of the scene's cameras, and odometry is drawn as a phone would drift, on the same frames as in
the prepared benchmark: 5 Hz of 7Scenes, 2 Hz of Cambridge.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vioapr.evaluation.cases import Case
from vioapr.evaluation.metrics import PoseErrors, pose_errors
from vioapr.formats.registry import read_trajectory
from vioapr.formats.stated_sigmas import Sigmas
from vioapr.fusion.pairing import pair_frames
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.trackers import track
from vioapr.trajectory import Trajectory

REGRESSORS = {"posenet": "PoseNet", "mst": "MS-Transformer", "dfnet": "DFNet"}
KINDS = {"raw": "predict", "nefes10": "Nefes_10", "nefes30": "Nefes_30", "nefes50": "Nefes_50"}
SIMILARITY_CLASSES = (0.0, 1e-9, 0.9, 0.95, 0.98)
"""Lower ends of the classes that images are put in; 0: no training image is near."""
MEDIAN_LENGTH = 1.538
"""Median length of a vector whose three components have a standard deviation of 1."""
_FEW = 10
"""Images of a class that tell its error."""


@dataclass(frozen=True)
class SceneSet:
    """Scenes of one data set.

    Attributes:
        scenes: Those to develop with; the others are kept aside to judge by.
        similarity: How the files of similarity scores end.
        stride: One frame of this many is used.
        interval_s: Between frames, before that.
    """

    scenes: tuple[str, ...]
    similarity: str
    stride: int
    interval_s: float


SETS = {
    "7Scenes": SceneSet(("chess", "fire", "office", "pumpkin"), "simi_20", 6, 1 / 30),
    "Cambridge": SceneSet(("KingsCollege", "ShopFacade"), "simi_150", 1, 0.5),
}


@dataclass(frozen=True, eq=False)
class Predictions:
    """A regressor's poses of a scene's n test images, in a z-up world.

    Attributes:
        set_name: A key of `SETS`.
        scene: Its name.
        regressor: A key of `REGRESSORS`.
        names: Of the images, "sequence/frame".
        gt_world_from_cam: Shape (n,).
        world_from_cam: By a key of `KINDS`, shape (n,).
        similarity: Shape (n,), 0 to 1.
    """

    set_name: str
    scene: str
    regressor: str
    names: tuple[str, ...]
    gt_world_from_cam: Rigid3
    world_from_cam: Mapping[str, Rigid3]
    similarity: NDArray[np.float64]

    def errors(self, kind: str) -> PoseErrors:
        """Of the predictions of a kind, shape (n,)."""
        return pose_errors(self.gt_world_from_cam, self.world_from_cam[kind])


def read_predictions(clone: Path, set_name: str, scene: str, regressor: str) -> Predictions:
    """Read a scene's files. A kind whose file is a copy of one with more iterations is left out.

    Raises:
        FileError: A file is missing or malformed.
        ValueError: Files do not name the same images.
    """
    folder = clone / REGRESSORS[regressor]
    paths = {kind: folder / set_name / f"{scene}_{end}.txt" for kind, end in KINDS.items()}
    texts = {kind: path.read_bytes() for kind, path in paths.items()}
    kinds = list(KINDS)
    originals = [
        kind for at, kind in enumerate(kinds)
        if texts[kind] not in [texts[later] for later in kinds[at + 1 :]]
    ]  # fmt: skip
    gt = read_trajectory(folder / set_name / f"{scene}_test_gt.txt", "hrapr")
    tracks = {kind: read_trajectory(paths[kind], "hrapr") for kind in originals}
    scores_path = folder / "simi_ranking" / f"{scene}_{SETS[set_name].similarity}.txt"
    scores = dict(line.split() for line in scores_path.read_text().splitlines())
    for name, names in [*((k, t.names) for k, t in tracks.items()), ("similarity", scores)]:
        if set(names or ()) != set(gt.names or ()):
            raise ValueError(f"{scores_path.parent}: {scene}: {name} is not of the images of gt")
    assert gt.names is not None
    upright = _upright_from(gt.target_from_source)
    return Predictions(
        set_name,
        scene,
        regressor,
        gt.names,
        upright @ gt.target_from_source,
        {kind: upright @ track.target_from_source for kind, track in tracks.items()},
        np.array([float(scores[name]) for name in gt.names]),
    )


def read_all(clone: Path) -> list[Predictions]:
    """Read all scenes to develop with, by all regressors."""
    return [
        read_predictions(clone, set_name, scene, regressor)
        for set_name, chosen in SETS.items()
        for scene in chosen.scenes
        for regressor in REGRESSORS
    ]


def _upright_from(world_from_cam: Rigid3) -> Rigid3:
    """To a world whose z is the mean up of the cameras, by the shortest turn."""
    up = -quaternion.to_matrix(world_from_cam.quat_xyzw)[:, :, 1].mean(axis=0)
    up /= np.linalg.norm(up)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(axis))
    turn = axis / max(length, 1e-12) * np.arctan2(length, up[2])
    return Rigid3(np.zeros(3), quaternion.from_rotvec(turn))


def check_readings(predictions: Predictions, kind: str) -> dict[str, PoseErrors]:
    """Median errors of a file's poses as they are read, and as they might be meant instead.

    Raises:
        ValueError: Another reading has smaller errors than the documented one.
    """
    poses, gt = predictions.world_from_cam[kind], predictions.gt_world_from_cam
    readings = {
        "world_from_cam, qw first": poses,
        "cam_from_world": poses.inverse(),
        "centre and cam_from_world": poses._replace(quat_xyzw=quaternion.inverse(poses.quat_xyzw)),
        "qw last": poses._replace(quat_xyzw=poses.quat_xyzw[:, [1, 2, 3, 0]]),
        "centimetres": poses._replace(translation_m=poses.translation_m / 100),
    }
    medians = {
        name: PoseErrors(*map(np.median, pose_errors(gt, p))) for name, p in readings.items()
    }
    ours, *others = medians.values()
    for name, other in zip(list(medians)[1:], others, strict=True):
        if other.position_m < ours.position_m or other.orientation_deg < ours.orientation_deg:
            raise ValueError(f"{predictions.scene}, {predictions.regressor}, {kind}: rather {name}")
    return medians


def sigmas_from_similarity(scenes: Sequence[Predictions], of: Predictions, kind: str) -> Sigmas:
    """What the similarity scores say of a scene's errors, as learnt from the other scenes.

    An image states the median error of those of its class of similarity in the set's other scenes,
    by the same regressor, as a standard deviation per axis; NaN where these have few of its class.
    """
    others = [
        other for other in scenes
        if (other.set_name, other.regressor) == (of.set_name, of.regressor)
        and other.scene != of.scene and kind in other.world_from_cam
    ]  # fmt: skip
    stated = np.full((2, len(of.names)), np.nan)
    own_class = np.digitize(of.similarity, SIMILARITY_CLASSES)
    if others:
        class_ = np.digitize(np.concatenate([o.similarity for o in others]), SIMILARITY_CLASSES)
        errors = np.concatenate([np.stack(o.errors(kind)) for o in others], axis=1)
        for number in np.unique(class_):
            if (class_ == number).sum() >= _FEW:
                median = np.median(errors[:, class_ == number], axis=1)
                stated[:, own_class == number] = median[:, None] / MEDIAN_LENGTH
    return Sigmas(*stated)


def make_cases(
    scenes: Sequence[Predictions], *, seed: int, draws: int, with_sigmas: bool
) -> Iterator[Case]:
    """Every sequence with every kind of predictions, each with some draws of odometry.

    Args:
        scenes: From `read_all`.
        seed: Of the odometries; every regressor and kind gets the same.
        draws: Odometries a sequence.
        with_sigmas: Whether predictions state the sigmas that their similarity tells.
    """
    for one in scenes:
        for walk, rows, timestamp_s in sequences(one):
            gt = Trajectory.from_arrays(timestamp_s, *one.gt_world_from_cam.at(rows))
            number = [seed, *f"{one.scene}/{walk}".encode()]
            for draw in range(draws):
                rng = np.random.default_rng([*number, draw])
                vio = gt.with_transforms(track(rng, timestamp_s, gt.target_from_source))
                for kind, poses in one.world_from_cam.items():
                    sigmas = None
                    if with_sigmas:
                        stated = sigmas_from_similarity(scenes, one, kind)
                        sigmas = Sigmas(*(sigma[rows] for sigma in stated))
                    apr = gt.with_transforms(poses.at(rows))
                    frames = pair_frames(apr, vio, apr_sigmas=sigmas)
                    labels = (one.set_name, f"{one.scene}_{walk}", f"sim{draw}")
                    yield Case(*labels, f"{one.regressor} {kind}", frames, gt.target_from_source)


def sequences(
    predictions: Predictions,
) -> Iterator[tuple[str, NDArray[np.intp], NDArray[np.float64]]]:
    """The name of every sequence of a scene, the rows of its frames that are used, their times."""
    chosen = SETS[predictions.set_name]
    sequence_of = np.array([name.split("/")[0] for name in predictions.names])
    frame_of = np.array([int(re.findall(r"\d+", name)[-1]) for name in predictions.names])
    for sequence in dict.fromkeys(sequence_of.tolist()):
        rows = np.flatnonzero((sequence_of == sequence) & (frame_of % chosen.stride == 0))
        rows = rows[np.argsort(frame_of[rows], kind="stable")]
        yield sequence.replace("-", ""), rows, chosen.interval_s * frame_of[rows]
