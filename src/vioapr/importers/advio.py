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
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.importers.base import (
    ImportedScene,
    Importer,
    ImportOptions,
    Walk,
    id_of,
    one_walk,
    require_one,
    tracking_of,
)
from vioapr.importers.reading import Reading, read_noted
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
        raise ParameterError(f"tracker: expected {' or '.join(_TRACKERS)}, got {tracker!r}")
    if source.is_file():
        tracks = [source]
    else:
        tracks = [p for p in source.rglob(f"*{tracker}*") if p.is_file() and ".csv" in p.name]
        tracks = tracks or [p for p in source.rglob(f"*{tracker}*.tum*") if p.is_file()]
        tracks.sort(key=lambda path: natural_key(str(path)))
    track_of = {sequence_name(path): path for path in tracks}
    if not track_of:
        raise FormatError(
            source, f"expected ADVIO sequences with a track advio-NN_{tracker}.csv, found none"
        )
    require_one(source, options, len(track_of))
    return [
        one_walk(
            partial(read_walk, options.id or name, track, tracker, options),
            name=name,
            place="outdoor" if int(re.sub(r"\D", "", name) or 0) in _OUTDOOR else "indoor",
        )[0]
        for name, track in track_of.items()
    ]


def sequence_name(path: Path) -> str:
    """The name advio-NN from a file's name or a folder's above it."""
    for part in (path.name, *(parent.name for parent in path.resolve().parents)):
        if match := re.search(r"advio-?\d+", part):
            return match.group()
    return id_of(path.resolve().parent.name)


def find_gt(track: Path, tracker: str) -> Path | None:
    """The ground truth that belongs to a tracker's file, in either layout; None without one."""
    stem = track.name.split(tracker)[0]
    for pattern in (f"{stem}gt_pose*", f"{stem}gt.*"):
        if stem and (found := sorted(track.parent.glob(pattern))):
            return found[0]
    pose = track.parent.parent / "ground-truth" / "pose.csv"
    return pose if pose.exists() else None


def read_walk(id_: str, track: Path, tracker: str, options: ImportOptions) -> Walk:
    """Read one sequence: a tracker's file, and the ground truth that belongs to it."""
    device, title = _TRACKERS[tracker]
    is_raw = plain_name(track).endswith(".csv")
    reading = _read_track(track, options, is_raw=is_raw, is_tracker=True)
    vio = reading.trajectory
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
    reading.say(walk)
    walk.note("no images: poses only")
    truth = find_gt(track, tracker)
    if truth is None:
        walk.warn("no ground truth beside the track")
        return walk
    reading = _read_track(truth, options, is_raw=is_raw, is_tracker=False)
    reading.say(walk)
    gt = reading.trajectory
    if is_raw:
        gt = correct_raw(walk, vio, gt, has_own_clock=tracker == "arcore")
    # Ground truth is kept at the times of frames that it covers.
    times = walk.timestamp_s
    inside = (times >= gt.timestamp_s[0]) & (times <= gt.timestamp_s[-1])
    if not inside.any():
        raise FormatError(
            walk.source,
            f"expected the track and the ground truth to share a clock, but the track is of "
            f"{times[0]:.3f} to {times[-1]:.3f} s and the truth of {gt.timestamp_s[0]:.3f} to "
            f"{gt.timestamp_s[-1]:.3f} s",
        )
    upright = gt.with_transforms(z_up_from_y_up(gt.target_from_source))
    walk.gt = upright.interpolate(times[inside])
    return walk


def _read_track(path: Path, options: ImportOptions, *, is_raw: bool, is_tracker: bool) -> Reading:
    if is_raw:
        return read_noted((advio.VIO_FORMAT if is_tracker else advio.FORMAT).read, path, options)
    return Reading(advio.read_corrected(path, is_tracker=is_tracker), (), ())


def correct_raw(walk: Walk, vio: Trajectory, gt: Trajectory, *, has_own_clock: bool) -> Trajectory:
    """Find what the data set's own files leave open, a clock and a turn, from the two tracks.

    Args:
        walk: Its times and tracker's poses are corrected; findings are added.
        vio: The tracker's poses as read.
        gt: Ground truth as read.
        has_own_clock: Whether the tracker's phone has another clock than the ground truth.

    Returns:
        Ground truth, corrected.
    """
    if has_own_clock:
        offset_s = advio.find_clock_offset(gt, vio)
        vio = replace(vio, timestamp_s=vio.timestamp_s + offset_s)
        walk.timestamp_s = vio.timestamp_s
        walk.note(f"clock: {offset_s:+.2f} s were added, so that both turn at the same times")
    turn = advio.find_turn(gt, vio)
    text = (
        f"rotations: a turn of {turn.angle_deg:.0f} deg about z was undone; relative rotations of "
        f"tracker and ground truth now differ by {turn.residual_deg:.1f} deg (median over 1 s)"
    )
    if turn.residual_deg > advio.MAX_RESIDUAL_DEG:
        walk.warn(f"{text}: they do not belong together, so orientations are not to be trusted")
    else:
        walk.note(text)
    walk.vio_from_cam = advio.undo_turn(vio, turn.angle_deg, is_tracker=True).target_from_source
    return advio.undo_turn(gt, turn.angle_deg, is_tracker=False)


IMPORTER = Importer(
    name="advio",
    title="ADVIO sequences (ARKit or ARCore, no images)",
    layout="advio-NN folders, or a folder of advio-NN_arkit.csv and advio-NN_gt_pose.csv",
    read=read,
    uses=frozenset({"tracker"}),
)
