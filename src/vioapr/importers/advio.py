"""ADVIO: iPhone ARKit or Pixel ARCore tracks with ground truth, a folder a sequence; no images.

Every sequence is a scene of its own. Both layouts are read: the data set's own,
`advio-NN/{ground-truth,iphone,pixel}/`, and flat folders of `advio-NN_arkit.*`,
`advio-NN_arcore.*`, `advio-NN_gt*.*`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.files.text import natural_key, plain_name
from vioapr.formats import advio
from vioapr.formats.base import ReadOptions
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Place,
    Walk,
    id_of,
    one_walk,
    tracking_of,
)
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

_TRACKERS = {"arkit": ("iPhone 6s", "ARKit"), "arcore": ("Google Pixel", "ARCore")}
_OUTDOOR = range(20, 24)


def read(source: Path, options: ImportOptions) -> list[ImportedScene]:
    """All sequences at a path, each a scene: their ground truths share no world.

    Raises:
        FormatError: There are none.
        ParameterError: No such tracker.
    """
    tracker = (options.tracker or "arkit").lower()
    if tracker not in _TRACKERS:
        raise ParameterError(f"--tracker: expected {' or '.join(_TRACKERS)}, got {tracker!r}")
    found = _find_sequences(source, tracker)
    if not found:
        raise FormatError(
            source, f"expected ADVIO sequences with a track advio-NN_{tracker}.csv, found none"
        )
    if options.id is not None and len(found) > 1:
        raise ParameterError(f"--id names one recording, and {source} holds {len(found)}")
    return [
        one_walk(
            partial(_read_sequence, options.id or name, track, truth, tracker, options),
            name=name,
            place=_place_of(name),
        )[0]
        for name, (track, truth) in found.items()
    ]


def _find_sequences(source: Path, tracker: str) -> dict[str, tuple[Path, Path | None]]:
    """The tracker's file and the ground truth of every sequence, by name."""
    if source.is_file():
        return {_sequence_of(source): (source, _truth_beside(source, tracker))}
    tracks = [p for p in source.rglob(f"*{tracker}*") if p.is_file() and ".csv" in p.name]
    tracks = tracks or [p for p in source.rglob(f"*{tracker}*.tum*") if p.is_file()]
    tracks.sort(key=lambda path: natural_key(str(path)))
    return {_sequence_of(path): (path, _truth_beside(path, tracker)) for path in tracks}


def _sequence_of(path: Path) -> str:
    """advio-NN from the file's name or a folder's above it."""
    for part in (path.name, *(parent.name for parent in path.resolve().parents)):
        if match := re.search(r"advio-?\d+", part):
            return match.group()
    return id_of(path.resolve().parent.name)


def _truth_beside(track: Path, tracker: str) -> Path | None:
    stem = track.name.split(tracker)[0]
    for pattern in (f"{stem}gt_pose*", f"{stem}gt.*"):
        if stem and (found := sorted(track.parent.glob(pattern))):
            return found[0]
    pose = track.parent.parent / "ground-truth" / "pose.csv"
    return pose if pose.exists() else None


def _place_of(name: str) -> Place:
    """Sequences 20 to 23 are outdoors, the others indoors."""
    return "outdoor" if int(re.sub(r"\D", "", name) or 0) in _OUTDOOR else "indoor"


def _read_sequence(
    id_: str, track: Path, truth: Path | None, tracker: str, options: ImportOptions
) -> Walk:
    device, title = _TRACKERS[tracker]
    is_raw = plain_name(track).endswith(".csv")
    vio = _read_track(track, is_raw=is_raw, is_tracker=True)
    walk = Walk(
        id=id_,
        split=options.split_or("test"),
        info=RecordingInfo(device=device, tracker=title, source="ADVIO", has_images=False),
        source=track,
        timestamp_s=vio.timestamp_s,
        image_names=[""] * len(vio),
        images=(),
        vio_from_cam=vio.target_from_source,
        tracking=tracking_of(vio.target_from_source),
    )
    walk.note("no images: poses only")
    if truth is None:
        walk.warn("no ground truth beside the track")
        return walk
    gt = _read_track(truth, is_raw=is_raw, is_tracker=False)
    if is_raw:
        vio = _meet_clocks(walk, vio, gt) if tracker == "arcore" else vio
        vio, gt = _correct(walk, vio, gt)
        walk.vio_from_cam = vio.target_from_source
    walk.gt = _common(gt.with_transforms(z_up_from_y_up(gt.target_from_source)), walk)
    return walk


def _read_track(path: Path, *, is_raw: bool, is_tracker: bool) -> Trajectory:
    if is_raw:
        format_ = advio.VIO_FORMAT if is_tracker else advio.FORMAT
        return format_.read(path, ReadOptions())
    return advio.read_corrected(path, is_tracker=is_tracker)


def _meet_clocks(walk: Walk, vio: Trajectory, gt: Trajectory) -> Trajectory:
    """The tracker's poses on the clock of the ground truth: its phone has another."""
    offset_s = advio.find_clock_offset(gt, vio)
    walk.timestamp_s = vio.timestamp_s + offset_s
    walk.note(f"clock: {offset_s:+.2f} s were added, so that both turn at the same times")
    return replace(vio, timestamp_s=walk.timestamp_s)


def _correct(walk: Walk, vio: Trajectory, gt: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Undo the unknown turn of a sequence's rotations, found from the two tracks."""
    turn = advio.find_turn(gt, vio)
    text = (
        f"rotations: a turn of {turn.angle_deg:.0f} deg about z was undone; relative rotations of "
        f"tracker and ground truth now differ by {turn.residual_deg:.1f} deg (median over 1 s)"
    )
    if turn.residual_deg > advio.MAX_RESIDUAL_DEG:
        walk.warn(f"{text}: they do not belong together, so orientations are not to be trusted")
    else:
        walk.note(text)
    return advio.undo_turn(vio, turn.angle_deg, is_tracker=True), advio.undo_turn(
        gt, turn.angle_deg, is_tracker=False
    )


def _common(gt: Trajectory, walk: Walk) -> Trajectory:
    """Ground truth at the times of frames that it covers."""
    times = walk.timestamp_s
    inside = (times >= gt.timestamp_s[0]) & (times <= gt.timestamp_s[-1])
    if not inside.any():
        raise FormatError(
            walk.source,
            f"expected the track and the ground truth to share a clock, but the track is of "
            f"{times[0]:.3f} to {times[-1]:.3f} s and the truth of {gt.timestamp_s[0]:.3f} to "
            f"{gt.timestamp_s[-1]:.3f} s",
        )
    return gt.interpolate(times[inside])


IMPORTER = Importer(
    name="advio",
    title="ADVIO sequences (ARKit or ARCore, no images)",
    layout="advio-NN folders, or a folder of advio-NN_arkit.csv and advio-NN_gt_pose.csv",
    read=read,
    uses=frozenset({"tracker"}),
)
