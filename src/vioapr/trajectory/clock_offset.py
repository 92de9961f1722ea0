"""The offset between the clocks of two tracks of one walk, by correlating their turn rates.

A device turns the same whoever tracks it. So the turns of both tracks, each in its own device's
axes, correlate best when one is shifted by the offset of its clock. A constant rotation between
the devices does not matter: of the 3x3 cross-correlation the best rotation is taken out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory.trajectory import Trajectory, bracket

FloatArray = NDArray[np.float64]

_STEP_S, _MAX_SAMPLES = 0.1, 20_000
_WINDOW_S = 1.0
_SMOOTHING_S, _MAX_HALF_WIDTH, _PART = 1.0, 200, 4096
_LONGEST_GAP_S, _GAP_STEPS = 1.0, 3.0
_LEAST_OVERLAP_S, _LEAST_OVERLAP_SHARE = 15.0, 0.3
_CLIP = 3.0
_LEAST_POSES = 8
_BLOCKS = 6
_FINE_STEP_S, _FINE_REACH_S = 0.02, 0.6
_LEAST_OFFSET_S, _LEAST_SIGMA_S, _SIGMAS = 0.1, 0.015, 5.0
_LEAST_SMOOTHED_S = 0.3
_LEAST_CORRELATION, _LEAST_LEAD = 0.5, 4.0


class ClockOffset(NamedTuple):
    """How far the right track's clock is ahead of the left one's.

    Attributes:
        offset_s: To be subtracted from the right track's timestamps.
        sigma_s: Standard deviation, by blocks of the walk.
        correlation: Of the turns at this offset, 0 to 1.
    """

    offset_s: float
    sigma_s: float
    correlation: float


class _Turns(NamedTuple):
    """Rotation vectors over a window, at even times; zero where the track has a gap."""

    start_s: float
    vectors: FloatArray
    is_known: NDArray[np.bool_]


def find_clock_offset(left: Trajectory, right: Trajectory) -> ClockOffset | None:
    """Find an offset between two clocks, if it is evident.

    It is, where the turns correlate well at it, clearly better than at any offset that is another
    by more than the correlation's own width, and where it stands out of its own uncertainty.

    Args:
        left: With a clock.
        right: Another track of the same walk.

    Returns:
        None where no offset is evident: the clocks are one, or the walk does not tell.
    """
    tracks = (left, right)
    if not (left.is_timed and right.is_timed and min(len(left), len(right)) >= _LEAST_POSES):
        return None
    found = _find(tracks, _WINDOW_S)
    if found is None:
        # Noise of single frames does less harm to longer turns, which tell less of short offsets.
        smooth = (_without_outliers(left), _without_outliers(right))
        found = _find(smooth, 2 * _WINDOW_S)
        if found is None or abs(found.offset_s) < _LEAST_SMOOTHED_S:
            return None
    is_evident = abs(found.offset_s) > max(_LEAST_OFFSET_S, _SIGMAS * found.sigma_s)
    return found if is_evident else None


def _find(tracks: tuple[Trajectory, Trajectory], window_s: float) -> ClockOffset | None:
    """The offset, maybe zero, at which turns over a window correlate clearly best, if one is."""
    durations = [float(track.timestamp_s[-1] - track.timestamp_s[0]) for track in tracks]
    frame_s = max(float(np.median(np.diff(track.timestamp_s))) for track in tracks)
    step_s = max(_STEP_S, max(durations) / _MAX_SAMPLES)
    window_s = max(window_s, 2 * frame_s)
    least_s = max(_LEAST_OVERLAP_S, _LEAST_OVERLAP_SHARE * min(durations))
    if min(durations) < least_s + window_s:
        return None
    turns = [_turns_at(track, _grid(track, step_s, window_s), window_s) for track in tracks]
    lags, as_read, turned, overlap = _correlate(turns[0], turns[1], round(least_s / step_s))
    if not len(lags):
        return None
    offsets_s = lags * step_s + turns[1].start_s - turns[0].start_s
    for correlation in (as_read, turned):
        peak = int(np.argmax(correlation))
        highest, coarse_s = float(correlation[peak]), float(offsets_s[peak])
        others = correlation[np.abs(offsets_s - coarse_s) > 2 * window_s]
        independent = max(float(overlap[peak]) * step_s / (2 * window_s), 1.0)
        lead = highest - float(others.max(initial=0.0))
        lead *= np.sqrt(independent) / (1 - highest**2 + 1e-9)
        if highest > _LEAST_CORRELATION and lead > _LEAST_LEAD:
            if abs(coarse_s) < step_s / 2:
                return ClockOffset(0.0, step_s, highest)
            offset_s, sigma_s = _refine(tracks[0], tracks[1], coarse_s, window_s, step_s)
            return ClockOffset(offset_s, max(sigma_s, _LEAST_SIGMA_S), highest)
    return None


def _without_outliers(track: Trajectory) -> Trajectory:
    """A track whose rotations are running medians over about a second.

    Regressors take one place for another in single frames, and turn by tens of degrees.
    """
    step_s = float(np.median(np.diff(track.timestamp_s)))
    half = min(max(round(_SMOOTHING_S / step_s / 2), 1), _MAX_HALF_WIDTH)
    width = 2 * half + 1
    dots = (track.quat_xyzw[1:] * track.quat_xyzw[:-1]).sum(axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0, -1.0, 1.0)]))
    padded = np.pad(track.quat_xyzw * signs[:, None], ((half, half), (0, 0)), "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=0)
    # By parts, as every part is copied.
    starts = range(0, len(windows), _PART)
    middle = np.concatenate([np.median(windows[k : k + _PART], axis=-1) for k in starts])
    lengths = np.linalg.norm(middle, axis=1, keepdims=True)
    kept = np.where(lengths > 0.5, middle / np.maximum(lengths, 1e-9), track.quat_xyzw)
    return replace(track, quat_xyzw=kept)


def _grid(track: Trajectory, step_s: float, window_s: float) -> FloatArray:
    first, last = track.timestamp_s[0], track.timestamp_s[-1]
    count = min(max(int((last - first - window_s) / step_s), 0), _MAX_SAMPLES)
    return first + np.arange(count) * step_s


def _turns_at(track: Trajectory, times: FloatArray, window_s: float) -> _Turns:
    """Rotation vectors between the poses at some times and those a window later, clipped."""
    steps_s = np.diff(track.timestamp_s)
    longest_s = max(_LONGEST_GAP_S, _GAP_STEPS * float(np.median(steps_s)))
    poses: list[Rigid3] = []
    known = np.ones(len(times), dtype=bool)
    for at in (times, times + window_s):
        before, after = bracket(at, track.timestamp_s)
        gap_s = track.timestamp_s[after] - track.timestamp_s[before]
        fraction = np.clip((at - track.timestamp_s[before]) / np.maximum(gap_s, 1e-9), 0, 1)
        whole = track.target_from_source
        poses.append(rigid.interpolate(whole.at(before), whole.at(after), fraction))
        known &= gap_s <= longest_s
    turn = quaternion.multiply(quaternion.inverse(poses[0].quat_xyzw), poses[1].quat_xyzw)
    vectors = quaternion.to_rotvec(turn)
    if known.any():
        vectors = vectors - np.median(vectors[known], axis=0)
        lengths = np.linalg.norm(vectors, axis=1)
        longest = _CLIP * max(float(np.median(lengths[known])), 1e-9)
        vectors = vectors * np.minimum(1.0, longest / np.maximum(lengths, 1e-12))[:, None]
    return _Turns(float(times[0]) if len(times) else 0.0, vectors * known[:, None], known)


def _correlate(
    left: _Turns, right: _Turns, least_overlap: int
) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
    """The correlation at every lag with enough overlap: right row = left row + lag.

    Returns:
        Lags; correlations of the vectors as they are; correlations after the best rotation of
        each lag; and rows that overlap.
    """
    n, m = len(left.vectors), len(right.vectors)
    size = 1 << (n + m - 1).bit_length()
    columns = [
        np.column_stack([t.vectors, (t.vectors**2).sum(axis=1), t.is_known]) for t in (left, right)
    ]
    spectra = [np.fft.rfft(c, size, axis=0) for c in columns]

    def cross(i: int, j: int) -> FloatArray:
        return np.fft.irfft(np.conj(spectra[0][:, i]) * spectra[1][:, j], size)

    lags = np.arange(-(n - 1), m)
    covariance = np.stack(
        [np.stack([cross(i, j) for j in range(3)], axis=-1) for i in range(3)], axis=-2
    )[lags]
    energies = cross(3, 4)[lags] * cross(4, 3)[lags]
    overlap = np.round(cross(4, 4)[lags])
    enough = overlap >= least_overlap
    lags, covariance, overlap = lags[enough], covariance[enough], overlap[enough]
    energies = np.maximum(energies[enough], 1e-12)
    singular = np.linalg.svd(covariance, compute_uv=False)
    handed = np.where(np.linalg.det(covariance) < 0, -1.0, 1.0)
    shared = singular[:, 0] + singular[:, 1] + handed * singular[:, 2]
    as_read = np.trace(covariance, axis1=1, axis2=2)
    return lags, as_read / np.sqrt(energies), shared / np.sqrt(energies), overlap


def _refine(
    left: Trajectory, right: Trajectory, offset_s: float, window_s: float, step_s: float
) -> tuple[float, float]:
    """The offset near a coarse one, and its standard deviation, by blocks of the walk."""
    times = _grid(left, step_s, window_s)
    inside = (times + offset_s >= right.timestamp_s[0]) & (
        times + offset_s + window_s <= right.timestamp_s[-1]
    )
    times = times[inside]
    fixed = _turns_at(left, times, window_s)
    shifts = np.arange(-_FINE_REACH_S, _FINE_REACH_S + 1e-9, _FINE_STEP_S)
    moved = [_turns_at(right, times + offset_s + shift, window_s).vectors for shift in shifts]
    centre = moved[len(moved) // 2]
    u, _, vt = np.linalg.svd(fixed.vectors.T @ centre)
    rotation = (u * [1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
    products = np.stack([(fixed.vectors * (each @ rotation.T)).sum(axis=1) for each in moved])
    energy = np.stack([(each**2).sum(axis=1) for each in moved])

    def best(rows: NDArray[np.intp]) -> float:
        own = float((fixed.vectors[rows] ** 2).sum())
        r = products[:, rows].sum(axis=1) / np.sqrt(
            np.maximum(own * energy[:, rows].sum(axis=1), 1e-12)
        )
        k = int(np.clip(np.argmax(r), 1, len(r) - 2))
        bend = r[k - 1] - 2 * r[k] + r[k + 1]
        between = 0.0 if bend >= 0 else 0.5 * (r[k - 1] - r[k + 1]) / bend
        return float(shifts[k] + between * _FINE_STEP_S)

    blocks = [best(rows) for rows in np.array_split(np.arange(len(times)), _BLOCKS) if len(rows)]
    spread_s = 1.4826 * float(np.median(np.abs(np.array(blocks) - np.median(blocks))))
    return offset_s + best(np.arange(len(times))), 1.25 * spread_s / np.sqrt(len(blocks))
