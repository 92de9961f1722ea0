"""When each image of a folder was taken: by its name, by a trajectory, or by a rate.

Names may be times of another clock than the trajectory's, as of the camera app and of the tracker.
Then their steps show whether image k is of pose k; a wrong pairing is refused.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import FormatError
from vioapr.formats.base import TimeUnit
from vioapr.formats.times import PER_SECOND, UNIT_NAMES, find_time_unit, has_plausible_rate
from vioapr.importers.image_pairing import ImageFiles, Track, last_of, pairs_by_name, stem_of
from vioapr.plurals import count_of
from vioapr.trajectory import nearest_rows

_DEFAULT_RATE_HZ = 1.0
_LEAST_TIME = 1e8
"""Smaller whole numbers in names count frames, unless they are a trajectory's times."""

_MOSTLY = 0.9


class ImageTimes(NamedTuple):
    """When each image was taken, and how that is known.

    Attributes:
        timestamp_s: Shape (n,), s.
        how: For people.
        is_measured: Whether by a clock, rather than a rate.
        is_doubtful: Whether a user should see how.
    """

    timestamp_s: NDArray[np.float64]
    how: str
    is_measured: bool = True
    is_doubtful: bool = False


def find_times(
    found: ImageFiles,
    tracks: list[Track],
    rate_hz: float | None,
    unit: TimeUnit | None = None,
) -> ImageTimes:
    """Find when each image was taken.

    Args:
        found: The images.
        tracks: Trajectories of the same walk, the one to trust most first.
        rate_hz: Frames per second, if the user says so.
        unit: Of times in names, if the user says so.

    Raises:
        FormatError: Neither names nor trajectories tell, or they contradict each other.
    """
    names = found.names
    if rate_hz is not None:
        times = np.arange(len(names)) / rate_hz
        return ImageTimes(times, f"no timestamps: {rate_hz:g} Hz", is_measured=False)
    stamps = timestamps_of_names(names, unit)
    timed = [track for track in tracks if track.track.is_timed]
    if stamps is not None:
        known_s = timed[0].track.timestamp_s if timed else stamps
        if stamps[0] <= known_s[-1] and known_s[0] <= stamps[-1]:
            return ImageTimes(stamps, "from the images' names")
    for track in timed:
        pairs = pairs_by_name(names, track.track)
        if len(pairs) == len(names):
            times = track.track.timestamp_s[[of for _, of in pairs]]
            if (np.diff(times) > 0).all():
                return ImageTimes(times, "the trajectory's, by the images' names")
    if timed and unit is None and (of_clock := _times_of_clock(names, timed[0])) is not None:
        return of_clock
    for track in timed:
        placed = track.rows_in_file()
        if placed is not None and len(placed[1]) == len(names):
            return _pair_in_order(found, stamps, placed[1], track)
    if timed:
        raise FormatError(found.folder, _why_no_times(found, timed[0], stamps))
    times = np.arange(len(names)) / _DEFAULT_RATE_HZ
    how = f"no timestamps: counted at {_DEFAULT_RATE_HZ:g} Hz"
    return ImageTimes(times, how, is_measured=False, is_doubtful=True)


def _times_of_clock(names: list[str], of_walk: Track) -> ImageTimes | None:
    """Whole numbers in names, in the unit in which they are the times of a trajectory's poses."""
    stems = [_time_text(name) for name in names]
    if not all(stem.isdecimal() and len(stem) < 20 for stem in stems):
        return None
    known_s = of_walk.track.timestamp_s
    step_s = float(np.median(np.diff(known_s))) if len(known_s) > 1 else 0.0
    for unit, per_second in PER_SECOND.items():
        if unit == "s" and int(stems[-1]) < _LEAST_TIME:
            continue  # frames that are counted, one a second
        times = np.array([int(stem) / per_second for stem in stems])
        if not (np.diff(times) > 0).all():
            return None
        nearest, back = nearest_rows(times, known_s), nearest_rows(known_s, times)
        is_pair = back[nearest] == np.arange(len(times))
        is_pair &= np.abs(times - known_s[nearest]) <= 0.25 * step_s
        if is_pair.mean() >= _MOSTLY:
            how = f"from the images' names, in {UNIT_NAMES[unit]}, as the trajectory's times say"
            return ImageTimes(times, how)
    return None


def _pair_in_order(
    found: ImageFiles,
    stamps: NDArray[np.float64] | None,
    placed_s: NDArray[np.float64],
    of_walk: Track,
) -> ImageTimes:
    """The trajectory's times, image by image; times of another clock must have the same steps."""
    in_order = "pose k is taken to be of image k"
    if stamps is None or len(stamps) < 2:
        return ImageTimes(placed_s, f"the trajectory's: {in_order}")
    offset_s = float(np.median(stamps - placed_s))
    off_s = np.abs(stamps - placed_s - offset_s)
    step_s = float(np.median(np.diff(placed_s)))
    clocks = (
        f"images are named by times of another clock ({stamps[0]:.3f} to {stamps[-1]:.3f} s) than "
        f"the poses of {of_walk.path.name} ({placed_s[0]:.3f} to {placed_s[-1]:.3f} s)"
    )
    if (off_s <= 0.5 * step_s).mean() < _MOSTLY:
        raise FormatError(
            found.folder,
            f"{clocks}, and their steps differ by up to {off_s.max():.3g} s: they cannot be paired "
            "in order; give poses of the same clock, or `time_unit` if their unit was misread",
        )
    how = f"the trajectory's: {clocks}; their steps agree at {offset_s:.3f} s apart, so {in_order}"
    return ImageTimes(placed_s, how, is_doubtful=True)


def _why_no_times(found: ImageFiles, of_walk: Track, stamps: NDArray[np.float64] | None) -> str:
    names, poses, nothing = found.names, len(of_walk.track), len(of_walk.reading.left_out)
    have = "has" if nothing == 1 else "have"
    rows = f", of {poses + nothing} rows {nothing} {have} none" if nothing else ""
    got = f"got {count_of(len(names), 'image')} as {names[0]}"
    known_s = of_walk.track.timestamp_s
    if stamps is not None:
        got += (
            f", times of another clock ({stamps[0]:.3f} to {stamps[-1]:.3f} s) than the poses "
            f"({known_s[0]:.3f} to {known_s[-1]:.3f} s)"
        )
    return (
        f"expected images named by timestamps of {of_walk.path.name}, or one for each of its rows "
        f"({count_of(poses, 'pose')}{rows}), {got}: give `rate_hz`, or a trajectory with names"
    )


def timestamps_of_names(
    names: list[str], unit: TimeUnit | None = None
) -> NDArray[np.float64] | None:
    """Seconds from names as 1305031102.175304.png; None if names are none of times.

    Whole numbers are times in the unit that their size or their steps show, unless they are
    small: then they count frames. In names as ARKitScenes' 41069021_306.508.png, the time comes
    after the video's number.

    Args:
        names: Of the images, in order.
        unit: Of whole numbers, if the user says so.
    """
    stems = [_time_text(name) for name in names]
    try:
        values = np.array([float(stem) for stem in stems])
    except ValueError:
        return None
    if not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        return None
    if not all(stem.isdecimal() for stem in stems):
        return values
    if unit is None and values[-1] < _LEAST_TIME:
        return None
    if unit is not None and not has_plausible_rate(values, unit):
        return None
    per_second = PER_SECOND[unit or find_time_unit(values).unit]
    return np.array([int(stem) / per_second for stem in stems])


def _time_text(name: str) -> str:
    """What an image's name has as its time; nothing where it has an underscore besides."""
    stem = stem_of(last_of(name))
    video, _, time = stem.rpartition("_")
    text = time if video.isdecimal() and "." in time else stem
    return "" if "_" in text else text  # Python would read 1_2 as 12
