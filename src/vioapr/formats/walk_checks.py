"""What looks wrong with the tracks of one walk: predictions, tracking and ground truth together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from vioapr.errors import AssociationError
from vioapr.formats.anomalies import check_track
from vioapr.formats.common_motion import find_common_frames
from vioapr.formats.frozen_tracks import check_count, check_frozen
from vioapr.formats.pair_checks import Track, check_pair, check_sources
from vioapr.formats.track_warnings import TrackWarning
from vioapr.trajectory import DEFAULT_TOLERANCE_S


def check_walk(
    aprs: Sequence[Track],
    vios: Sequence[Track],
    gt: Track | None = None,
    tolerance_s: float = DEFAULT_TOLERANCE_S,
) -> list[TrackWarning]:
    """Check every track of a walk by another one, and by itself.

    Ground truth, where there is any, tells most: it has neither noise nor drift to speak of.

    Args:
        aprs: Predictions, world_from_cam.
        vios: Trackers' poses.
        gt: Ground truth, world_from_cam.
        tolerance_s: Largest difference of paired timestamps, s.

    Returns:
        Possibly none.
    """
    unusable = _find_unusable(aprs, vios, gt)
    if gt is not None and gt.path in unusable:
        return list(unusable.values())
    aprs, vios = ([one for one in kind if one.path not in unusable] for kind in (aprs, vios))
    found = list(unusable.values())
    for track in (*vios, *aprs) if gt is not None else ():
        assert gt is not None
        found += check_pair(gt, track, tolerance_s).warnings
    for apr in aprs:
        for vio in vios:
            if gt is None:
                found += check_pair(apr, vio, tolerance_s).warnings
            else:
                found += _check_sources(apr, vio, tolerance_s)
    if found:
        return found
    # Tracks that agree may all be wrong in the same way: their motion tells.
    for track in (*([gt] if gt is not None else []), *vios, *aprs):
        found += [
            TrackWarning(warning.kind, f"{track.name}: {warning.sentence}", warning.remedy)
            for warning in check_track(track.poses, is_smooth=track.role != "apr")
        ]
    return found


def _find_unusable(
    aprs: Sequence[Track], vios: Sequence[Track], gt: Track | None
) -> dict[str, TrackWarning]:
    """Tracks that tell nothing of the others, by their paths: too short ones, and frozen ones."""
    tracks = (*([gt] if gt is not None else []), *vios, *aprs)
    found = {track.path: warning for track in tracks if (warning := check_count(track))}
    pairs = product(aprs, vios) if gt is None else product((gt,), (*vios, *aprs))
    for pair in pairs:
        for track, other in (pair, pair[::-1]):
            if track.path not in found and (warning := check_frozen(track, other)):
                found[track.path] = warning
    return found


def _check_sources(apr: Track, vio: Track, tolerance_s: float) -> list[TrackWarning]:
    try:
        common = find_common_frames(vio.poses, apr.poses, tolerance_s)
    except AssociationError:
        return []
    return check_sources(apr, vio, common)
