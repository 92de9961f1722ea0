"""The plan of the courtyard's recordings: sizes and rates, routes, weathers, tracker events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vioapr.errors import ParameterError
from vioapr.scene.frames import Intrinsics
from vioapr.simulation.courtyard.walks import Motion, walk
from vioapr.simulation.trackers import TrackerEvents

FOCAL_PER_WIDTH = 0.78
"""Focal length by image width: 65 degrees across, as phones' main cameras have."""


@dataclass(frozen=True)
class CourtyardParams:
    """The sizes and rates of a simulated scene."""

    train: int = 4
    """Recordings to train and map with."""
    test: int = 2
    """Recordings to test with."""
    duration_s: float = 90.0
    """Length of each, s."""
    rate_hz: float = 10.0
    """Images per second."""
    width_px: int = 480
    """Width of the images."""
    height_px: int = 360
    """Height of the images."""
    oversampled: bool = False
    """Whether every pixel is the mean of four: features are found more exactly, see
    docs/guide/simulate.md, and rendering takes two to three times as long."""
    people: int = 9
    """Passers-by in each recording."""
    texture_px_per_m: float = 64.0
    """Density of the walls' pictures: less is made sooner."""
    same_way: bool = False
    """Whether all recordings walk one route the same way round, so that even short ones share
    views, and can be mapped."""

    def __post_init__(self) -> None:
        lowest = {"train": 1, "test": 0, "width_px": 32, "height_px": 32, "people": 0}
        for name, least in lowest.items():
            if getattr(self, name) < least:
                raise ParameterError(
                    f"{name}: expected at least {least}, got {getattr(self, name)}"
                )
        for name, least in (("duration_s", 2.0), ("rate_hz", 0.5), ("texture_px_per_m", 8.0)):
            if not least <= getattr(self, name) < float("inf"):
                raise ParameterError(
                    f"{name}: expected a number of at least {least:g}, got {getattr(self, name)}"
                )

    @property
    def frames(self) -> int:
        """Images of one recording."""
        return int(self.duration_s * self.rate_hz)

    @property
    def camera(self) -> Intrinsics:
        """The phone's camera."""
        focal = FOCAL_PER_WIDTH * self.width_px
        return Intrinsics(
            self.width_px, self.height_px, focal, focal, self.width_px / 2, self.height_px / 2
        )


PRESETS = {
    "full": CourtyardParams(),
    "small": CourtyardParams(
        train=2, test=1, duration_s=10.0, width_px=192, height_px=144, people=4,
        texture_px_per_m=24.0, same_way=True,
    ),
}  # fmt: skip
"""By name: the whole scene, and one that is made in seconds, for tests and demonstrations."""


@dataclass(frozen=True)
class Plan:
    """The plan of one recording.

    Attributes:
        id_: Its name.
        split: "train" or "test".
        number: Among all recordings, from 0; with the seed it decides all that is random.
        route: A key of `ROUTES_M`.
        backwards: Whether the route is walked the other way round.
        weather: A key of `WEATHERS`.
        tracker_events: What interrupts the tracker.
    """

    id_: str
    split: str
    number: int
    route: str
    backwards: bool
    weather: str
    tracker_events: TrackerEvents


_TRAIN = (
    ("around", False, "sunny"), ("figure eight", False, "overcast"),
    ("around", True, "late sun"), ("through the middle", False, "morning"),
    ("along the arcade", True, "overcast"), ("past the shops", False, "low light"),
)  # fmt: skip
_TEST = (
    ("figure eight", True, "after rain"), ("along the arcade", False, "low light"),
    ("back and forth", False, "sunny"), ("past the shops", True, "morning"),
)  # fmt: skip


SHARED_ROUTE = "around"
"""The route of recordings that walk the same way."""


def plan_recordings(params: CourtyardParams) -> list[Plan]:
    """Plan recordings by routes and weathers in turn; the second loses track, the third jumps.

    Of a single recording both happen to that one. Once all routes have been walked, they are
    walked the other way round, in other weathers.
    """
    chosen = [("train", *_in_turn(_TRAIN, i)) for i in range(params.train)]
    chosen += [("test", *_in_turn(_TEST, i)) for i in range(params.test)]
    if params.same_way:
        chosen = [(split, SHARED_ROUTE, False, weather) for split, _, _, weather in chosen]
    loses, jumps = min(1, len(chosen) - 1), min(2, len(chosen) - 1)
    plans = []
    for number, (split, route, backwards, weather) in enumerate(chosen):
        within = number if split == "train" else number - params.train
        events = TrackerEvents(
            0.35 * params.duration_s if number == loses else None,
            0.72 * params.duration_s if number == jumps else None,
        )
        id_ = f"{split}-{within + 1:02d}"
        plans.append(Plan(id_, split, number, route, backwards, weather, events))
    return plans


def _in_turn(table: tuple[tuple[str, bool, str], ...], i: int) -> tuple[str, bool, str]:
    """Route, whether backwards, and weather of the i-th recording."""
    rounds, row = divmod(i, len(table))
    route, backwards, _ = table[row]
    _, _, weather = table[(row + rounds) % len(table)]
    return route, backwards ^ bool(rounds % 2), weather


def plan_motion(plan: Plan, params: CourtyardParams, seed: int) -> Motion:
    """The camera's motion in a recording."""
    rng = np.random.default_rng([seed, 2, plan.number])
    return walk(rng, plan.route, params.duration_s, backwards=plan.backwards)
