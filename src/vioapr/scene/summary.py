"""What is in a scene: the paper's Table 1, and how fast people walked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import VioAprError
from vioapr.files.append_table import Problem
from vioapr.scene.frames import Frames, Tracking, read_frame_blocks
from vioapr.scene.recording import FRAMES_FILE, Recording
from vioapr.scene.scene import SPLITS, Scene
from vioapr.trajectory import Trajectory

SPEED_SPAN_S = 1.0
"""Speeds are of the way made in so long: of single frames of video they are mostly noise."""

_MAX_GAP = 1.5


@dataclass
class RecordingSummary:
    """What a recording holds.

    Attributes:
        id: Its id.
        split: "train", "test", "excluded" or "".
        device: The phone and its tracker, for people.
        frames: Number of frames.
        images: Number of frames with an image.
        tracking: Number of frames by state, by label.
        duration_s: From the first frame to the last, s.
        is_timed: Whether times were measured.
        path_m: Length of the way walked, m; 0 if not known.
        gt_frames: Number of frames with ground truth.
        speeds_m_s: Mean speeds over stretches of about `SPEED_SPAN_S`.
        speeds_of: What they are of: "vio", "gt" or "" (not known).
        extent_m: Lowest and highest position, shape (2, 3): of ground truth in the world, else
            of the tracker in its own; None without either.
        extent_of: "gt", "vio" or "".
        problem: Why it could not be read whole, or "".
    """

    id: str
    split: str
    device: str = ""
    frames: int = 0
    images: int = 0
    tracking: dict[str, int] = field(default_factory=dict)
    duration_s: float = 0.0
    is_timed: bool = True
    path_m: float = 0.0
    gt_frames: int = 0
    speeds_m_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    speeds_of: str = ""
    extent_m: NDArray[np.float64] | None = None
    extent_of: str = ""
    problem: str = ""


@dataclass(frozen=True)
class SceneSummary:
    """What a scene holds; see `RecordingSummary`."""

    name: str
    is_outdoor: bool
    recordings: tuple[RecordingSummary, ...]

    def images(self, split: str) -> int:
        """Number of images in a split."""
        return sum(recording.images for recording in self.recordings if recording.split == split)

    @property
    def used(self) -> list[RecordingSummary]:
        """The recordings in a split."""
        return [recording for recording in self.recordings if recording.split in SPLITS]

    @property
    def speeds_m_s(self) -> NDArray[np.float64]:
        """Of all recordings in a split."""
        return np.concatenate([np.zeros(0), *(r.speeds_m_s for r in self.used)])

    @property
    def extent_m(self) -> tuple[NDArray[np.float64], str] | None:
        """Size along x, y and z, and what it is of.

        Of ground truth: of the space that all recordings cover together. Else of the tracker's
        worlds, which do not share axes: of the largest recording, its height (y) last.
        """
        truths = [r.extent_m for r in self.used if r.extent_of == "gt" and r.extent_m is not None]
        if truths:
            corners = np.concatenate(truths)
            return np.ptp(corners, axis=0), "gt"
        tracks = [r.extent_m for r in self.used if r.extent_of == "vio" and r.extent_m is not None]
        if not tracks:
            return None
        sizes = [np.ptp(track, axis=0) for track in tracks]
        largest = max(sizes, key=lambda size: float(size[0] * size[2]))
        return largest[[0, 2, 1]], "vio"


def summarize_scene(scene: Scene, tick: Callable[[int], object] | None = None) -> SceneSummary:
    """Sum up all recordings of a scene, reading each table once, a part at a time.

    Args:
        scene: What to sum up.
        tick: Called with a number of frames after every so many, for progress.

    Raises:
        FormatError: A recording cannot be opened at all.
    """
    split_of = dict.fromkeys(scene.excluded, "excluded")
    split_of |= {id_: split for split, ids in scene.splits.items() for id_ in ids}
    recordings = [
        _summarize(scene, id_, split_of.get(id_, ""), tick or (lambda _: None))
        for id_ in scene.recording_ids
    ]
    return SceneSummary(scene.name, scene.is_outdoor, tuple(recordings))


def _summarize(
    scene: Scene, id_: str, split: str, tick: Callable[[int], object]
) -> RecordingSummary:
    recording = scene.recording(id_)
    info = recording.info
    device = ", ".join(filter(None, (info.device, info.tracker or "no tracker")))
    summary = RecordingSummary(id_, split, device, is_timed=info.clock == "device")
    walk = _Walk()
    problems: list[Problem] = []
    for block in read_frame_blocks(recording.folder / FRAMES_FILE, problems):
        _count(summary, block)
        walk.add(block)
        tick(len(block))
    errors = [problem for problem in problems if problem.is_error]
    if errors:
        summary.problem = f"{len(errors)} lines of {FRAMES_FILE} were left out: vioapr scene check"
    _add_motion(summary, walk, _read_gt(scene, recording, summary))
    return summary


def _count(summary: RecordingSummary, block: Frames) -> None:
    summary.frames += len(block)
    summary.images += sum(1 for name in block.image if name)
    for tracking in Tracking:
        count = int((block.tracking == tracking).sum())
        summary.tracking[tracking.label] = summary.tracking.get(tracking.label, 0) + count


def _read_gt(scene: Scene, recording: Recording, summary: RecordingSummary) -> Trajectory | None:
    try:
        return scene.gt(recording.id)
    except VioAprError as error:
        summary.problem = str(error)
        return None


class _Walk:
    """Distance, extent and speeds of a track that passes by in blocks."""

    def __init__(self) -> None:
        self.path_m = 0.0
        self.first_s, self.last_s = np.nan, np.nan
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.speeds: list[NDArray[np.float64]] = []
        self._carry: tuple[NDArray, NDArray, NDArray] | None = None
        self._world = 0

    def add(self, block: Frames) -> None:
        """The next frames of a recording."""
        times = block.timestamp_s
        if np.isnan(self.first_s):
            self.first_s = times[0]
        self.last_s = times[-1]
        worlds = self._world + block.tracking_world
        self._world = int(worlds[-1])
        known = block.has_pose
        if known.any():
            self.add_poses(times[known], block.vio_from_cam.translation_m[known], worlds[known])

    def add_poses(self, times: NDArray, positions: NDArray, worlds: NDArray) -> None:
        """Positions m at times s; a way is only measured within one tracking world."""
        self.low = np.minimum(self.low, positions.min(axis=0))
        self.high = np.maximum(self.high, positions.max(axis=0))
        if self._carry is not None:
            times, positions, worlds = (
                np.concatenate(pair)
                for pair in zip(self._carry, (times, positions, worlds), strict=True)
            )
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        # Frames that were carried over have their steps counted already, but the last.
        fresh = len(self._carry[0]) - 1 if self._carry is not None else 0
        self.path_m += float(np.where(np.diff(worlds) == 0, steps, 0.0)[fresh:].sum())
        picked = _pick(times)
        way = np.linalg.norm(np.diff(positions[picked], axis=0), axis=1)
        took = np.diff(times[picked])
        usual = np.median(np.diff(times)) if len(times) > 1 else SPEED_SPAN_S
        whole = (np.diff(worlds[picked]) == 0) & (took <= _MAX_GAP * max(SPEED_SPAN_S, usual))
        self.speeds.append(way[whole] / took[whole])
        start = picked[-1]
        self._carry = times[start:], positions[start:], worlds[start:]


def _pick(times: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rows at least `SPEED_SPAN_S` apart, beginning with the first."""
    picked = [0]
    while True:
        row = int(np.searchsorted(times, times[picked[-1]] + SPEED_SPAN_S - 1e-6))
        if row >= len(times):
            return np.array(picked)
        picked.append(max(row, picked[-1] + 1))


def _add_motion(summary: RecordingSummary, vio: _Walk, gt: Trajectory | None) -> None:
    summary.duration_s = float(vio.last_s - vio.first_s) if summary.frames else 0.0
    truth = _Walk()
    if gt is not None:
        summary.gt_frames = len(gt)
        truth.add_poses(gt.timestamp_s, gt.position_m, np.zeros(len(gt)))
    for name, walk in (("gt", truth), ("vio", vio)):
        if np.isfinite(walk.low).all():
            summary.extent_m, summary.extent_of = np.stack([walk.low, walk.high]), name
            break
    for name, walk in (("vio", vio), ("gt", truth)):
        if walk.speeds:
            summary.speeds_m_s, summary.speeds_of = np.concatenate(walk.speeds), name
            summary.path_m = walk.path_m
            break
