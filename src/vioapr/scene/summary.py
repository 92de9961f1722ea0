"""What is in a scene: the paper's Table 1, and how fast people walked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import VioAprError
from vioapr.files.append_table import Problem
from vioapr.geometry.vectors import step_lengths_m
from vioapr.plurals import count_of
from vioapr.scene.frames import Frames, Tracking, read_frame_blocks
from vioapr.scene.recording import FRAMES_FILE
from vioapr.scene.scene import SPLITS, Scene
from vioapr.schemas.summary import Extent, RecordingSummaryRecord, SceneSummaryRecord, TrackName

SPEED_SPAN_S = 1.0
"""Speeds are means over this time: between single frames of video they are mostly noise."""

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
    tracking: dict[str, int] = field(default_factory=dict[str, int])
    duration_s: float = 0.0
    is_timed: bool = True
    path_m: float = 0.0
    gt_frames: int = 0
    speeds_m_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    speeds_of: TrackName = ""
    extent_m: NDArray[np.float64] | None = None
    extent_of: TrackName = ""
    problem: str = ""

    def to_record(self) -> RecordingSummaryRecord:
        """The figures as they are written."""
        members = {k: v for k, v in vars(self).items() if k not in ("speeds_m_s", "extent_m")}
        has_speed, extent_m = len(self.speeds_m_s) > 0, self.extent_m
        return RecordingSummaryRecord(
            **members,
            extent_m=None if extent_m is None else (_xyz(extent_m[0]), _xyz(extent_m[1])),
            median_speed_m_s=float(np.median(self.speeds_m_s)) if has_speed else None,
        )


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
    def extent_m(self) -> tuple[NDArray[np.float64], TrackName] | None:
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

    def to_record(self) -> SceneSummaryRecord:
        """The figures as they are written."""
        extent = self.extent_m
        return SceneSummaryRecord(
            name=self.name,
            is_outdoor=self.is_outdoor,
            images={split: self.images(split) for split in SPLITS},
            extent_m=None if extent is None else _xyz(extent[0]),
            extent_of=None if extent is None else extent[1],
            recordings=tuple(recording.to_record() for recording in self.recordings),
        )


def summarize_scene(scene: Scene, tick: Callable[[int], object] | None = None) -> SceneSummary:
    """Sum up all recordings of a scene, reading each table once, a part at a time.

    Args:
        scene: What to sum up.
        tick: Called with a number of frames now and then, for progress.

    Raises:
        FormatError: A recording cannot be opened at all.
    """
    split_of = dict.fromkeys(scene.excluded, "excluded")
    split_of |= {id_: split for split, ids in scene.splits.items() for id_ in ids}
    recordings = [
        summarize_recording(scene, id_, split_of.get(id_, ""), tick or (lambda _: None))
        for id_ in scene.recording_ids
    ]
    return SceneSummary(scene.name, scene.is_outdoor, tuple(recordings))


def summarize_recording(
    scene: Scene, id_: str, split: str, tick: Callable[[int], object] = lambda _: None
) -> RecordingSummary:
    """Sum up one recording; a broken line or ground truth becomes its `problem`.

    Raises:
        FileError: It cannot be opened at all.
    """
    recording = scene.recording(id_)
    info = recording.info
    device = ", ".join(filter(None, (info.device, info.tracker or "no tracker")))
    summary = RecordingSummary(id_, split, device, is_timed=info.clock == "device")
    vio, truth = _Track(), _Track()
    problems: list[Problem] = []
    for block in read_frame_blocks(recording.folder / FRAMES_FILE, problems):
        summary.frames += len(block)
        summary.images += sum(1 for name in block.image if name)
        for tracking in Tracking:
            count = int((block.tracking == tracking).sum())
            summary.tracking[tracking.label] = summary.tracking.get(tracking.label, 0) + count
        vio.add(block)
        tick(len(block))
    errors = [problem for problem in problems if problem.is_error]
    if errors:
        summary.problem = (
            f"{count_of(len(errors), 'line')} of {FRAMES_FILE} left out: vioapr scene check"
        )
    summary.duration_s = float(vio.last_s - vio.first_s) if summary.frames else 0.0
    try:
        gt = scene.gt(id_)
    except VioAprError as error:
        gt, summary.problem = None, str(error)
    if gt is not None:
        summary.gt_frames = len(gt)
        truth.add_poses(gt.timestamp_s, gt.position_m, np.zeros(len(gt), dtype=np.int64))
    tracks: list[tuple[TrackName, _Track]] = [("gt", truth), ("vio", vio)]
    # Ground truth tells best where the cameras were, the tracker's finer steps how fast.
    for name, track in reversed(tracks):
        if np.isfinite(track.low_m).all():
            summary.extent_m = np.stack([track.low_m, track.high_m])
            summary.extent_of = name
    for name, track in tracks:
        if track.speeds_m_s:
            summary.speeds_m_s = np.concatenate(track.speeds_m_s)
            summary.speeds_of, summary.path_m = name, track.path_m
    return summary


def _xyz(vector: NDArray[np.float64]) -> Extent:
    x, y, z = vector.tolist()
    return x, y, z


class _Track:
    """Path length, extent and speeds of a track that passes by in blocks."""

    def __init__(self) -> None:
        self.path_m = 0.0
        self.first_s, self.last_s = np.nan, np.nan
        self.low_m, self.high_m = np.full(3, np.inf), np.full(3, -np.inf)
        self.speeds_m_s: list[NDArray[np.float64]] = []
        self._kept: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]] | None = None
        self._world = 0

    def add(self, block: Frames) -> None:
        """Add the next frames of a recording."""
        times = block.timestamp_s
        if np.isnan(self.first_s):
            self.first_s = times[0]
        self.last_s = times[-1]
        worlds = self._world + block.tracking_world
        self._world = int(worlds[-1])
        known = block.has_pose
        if known.any():
            self.add_poses(times[known], block.vio_from_cam.translation_m[known], worlds[known])

    def add_poses(
        self,
        timestamp_s: NDArray[np.float64],
        position_m: NDArray[np.float64],
        tracking_world: NDArray[np.int64],
    ) -> None:
        """Add the next poses; lengths are only measured within one tracking world.

        Args:
            timestamp_s: Shape (n,), s.
            position_m: Shape (n, 3), m.
            tracking_world: Shape (n,).
        """
        self.low_m = np.minimum(self.low_m, position_m.min(axis=0))
        self.high_m = np.maximum(self.high_m, position_m.max(axis=0))
        counted = 0
        if self._kept is not None:
            # Rows kept from the block before have their steps counted already, but the last.
            counted = len(self._kept[0]) - 1
            timestamp_s = np.concatenate([self._kept[0], timestamp_s])
            position_m = np.concatenate([self._kept[1], position_m])
            tracking_world = np.concatenate([self._kept[2], tracking_world])
        is_one_world = np.diff(tracking_world) == 0
        steps_m = np.where(is_one_world, step_lengths_m(position_m), 0.0)
        self.path_m += float(steps_m[counted:].sum())
        # Rows at least SPEED_SPAN_S apart.
        rows: list[int] = [0]
        row = 0
        while row < len(timestamp_s):
            next_s = float(timestamp_s[rows[-1]]) + SPEED_SPAN_S - 1e-6
            row = max(int(np.searchsorted(timestamp_s, next_s)), rows[-1] + 1)
            if row < len(timestamp_s):
                rows.append(row)
        took_s = np.diff(timestamp_s[rows])
        usual_s = np.median(np.diff(timestamp_s)) if len(timestamp_s) > 1 else SPEED_SPAN_S
        is_whole = took_s <= _MAX_GAP * max(SPEED_SPAN_S, float(usual_s))
        is_whole &= np.diff(tracking_world[rows]) == 0
        self.speeds_m_s.append(step_lengths_m(position_m[rows])[is_whole] / took_s[is_whole])
        start = rows[-1]
        self._kept = timestamp_s[start:], position_m[start:], tracking_world[start:]
