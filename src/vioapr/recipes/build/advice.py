"""What to record next, in sentences, the most useful first."""

from __future__ import annotations

from collections.abc import Iterator

from vioapr.plurals import count_of
from vioapr.schemas.build import BuiltLocalizer, CoverageRecord, GapRecord, MappedScene

_ARROWS = "→↗↑↖←↙↓↘"
_COMPASS = (
    "east",
    "north-east",
    "north",
    "north-west",
    "west",
    "south-west",
    "south",
    "south-east",
)
_MUCH = 0.5
_FEW_REGISTERED = 0.9
_MOST_NAMED = 4


def advise(
    mapped: MappedScene,
    localizer: BuiltLocalizer,
    coverage: CoverageRecord,
    *,
    train: int,
    tests: int,
) -> Iterator[str]:
    """Say what to record next, a sentence each.

    Args:
        mapped: Where poses come from.
        localizer: What was built.
        coverage: Of the training images.
        train: Number of training recordings.
        tests: Number of test recordings with ground truth.
    """
    if not tests:
        yield (
            "Record a walk to test with (vioapr import ... --split test): nothing tells yet how "
            "accurate this localizer is."
        )
    elif tests > 1 and localizer.why_not:
        yield f"Tracker and regressor are not calibrated: {localizer.why_not}."
    elif tests == 1:
        yield (
            "Record another walk to test with: from two on, tracker and regressor are calibrated, "
            "and each walk tells whether the stated uncertainties hold on it."
        )
    if train < 2:
        yield (
            "Walk through the place again, at another time of day: all pictures to learn from are "
            "of one recording, so light and people that it happened to have are learned too."
        )
    elif coverage.one_walk > _MUCH:
        yield (
            f"{_percent(coverage.one_walk)} of the views are of one recording alone: walk the same "
            "ways again at another time of day."
        )
    if coverage.one_way > _MUCH:
        yield (
            f"Walk back, too: {_percent(coverage.one_way)} of the ground was passed through one "
            "way only, and who comes from the other side sees nothing known."
        )
    if mapped.is_mapped and mapped.registered < _FEW_REGISTERED * mapped.images:
        yield (
            f"{mapped.images - mapped.registered} of {count_of(mapped.images, 'image')} have no "
            "place in the map: walk more slowly there, and join them to what is mapped with a walk "
            "that sees both."
        )


def describe_gap(gap: GapRecord, *, has_compass: bool) -> str:
    """Say where an area is, where to look from there, and whether somebody missed it.

    Args:
        gap: The area.
        has_compass: Whether the world's x is east.
    """
    x, y = gap.position_m
    where = f"Around x {x:.1f} m, y {y:.1f} m (about {max(gap.radius_m, 1.0):.0f} m)"
    if len(gap.headings_deg) >= len(_ARROWS) - 1:
        look = "turn slowly all round"
    elif len(gap.headings_deg) > _MOST_NAMED or not has_compass:
        look = f"look {' '.join(_ARROWS[_sector(deg)] for deg in gap.headings_deg)} as on the plan"
    else:
        names = [_COMPASS[_sector(deg)] for deg in gap.headings_deg]
        look = f"look {', '.join(names)}"
    missed = f"; {count_of(gap.asked, 'test image')} looked there" if gap.asked else ""
    return f"{where}, {look}{missed}."


def _sector(heading_deg: float) -> int:
    return round(heading_deg / 45) % len(_ARROWS)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
