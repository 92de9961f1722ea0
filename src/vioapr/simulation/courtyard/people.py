"""Passers-by: figures that walk along the routes, or stand about."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.simulation.courtyard.mesh import Mesh, join, lathe, rod
from vioapr.simulation.courtyard.render import Figure
from vioapr.simulation.courtyard.walks import ROUTES_M, closed_route

PHASES = 12
"""Of a stride, for which there are meshes; one more shows a person who stands."""
_STRIDE_M = 1.35
_STEP_M = 0.01
_TOO_NEAR_M = 1.1
_SKINS = ((0.6, 0.38, 0.28), (0.3, 0.18, 0.12), (0.48, 0.3, 0.2), (0.13, 0.08, 0.055))
_COATS = ((0.03, 0.04, 0.09), (0.35, 0.05, 0.04), (0.04, 0.04, 0.04), (0.3, 0.24, 0.12),
          (0.08, 0.14, 0.09), (0.5, 0.5, 0.5), (0.1, 0.2, 0.38), (0.55, 0.38, 0.06))  # fmt: skip


def figure_meshes(rng: np.random.Generator, people: int) -> list[Mesh]:
    """Meshes of people, `PHASES + 1` of each one, feet at the origin, facing +x."""
    meshes = []
    for _ in range(people):
        look = Look(
            coat=np.array(_COATS[rng.integers(len(_COATS))]) * rng.uniform(0.7, 1.3),
            trousers=rng.uniform(0.02, 0.16) * np.array([1, 1, rng.uniform(1.0, 1.8)]),
            skin=np.array(_SKINS[rng.integers(len(_SKINS))]),
            hair=rng.uniform(0.01, 0.16) * np.array([1, 0.75, 0.5]),
            scale=rng.uniform(0.93, 1.06),
        )
        swings = [*(2 * np.pi * np.arange(PHASES) / PHASES), None]
        meshes += [person(look, swing) for swing in swings]
    return meshes


@dataclass(frozen=True)
class Look:
    """Linear colours of a person's clothes, skin and hair, and their size, about 1."""

    coat: NDArray
    trousers: NDArray
    skin: NDArray
    hair: NDArray
    scale: float


def person(look: Look, swing: float | None) -> Mesh:
    """A person at a phase of their stride, rad, or standing if it is None."""
    reach = 0.0 if swing is None else 0.42 * np.sin(swing)
    hip, shoulder = 0.9, 1.41
    coat = [(0.14, hip - 0.14), (0.15, hip), (0.13, 1.1), (0.155, 1.3), (0.12, 1.44), (0.05, 1.49)]
    face = [(0.05, 1.46), (0.055, 1.53), (0.085, 1.58), (0.095, 1.67), (0.08, 1.74), (0.0, 1.77)]
    hair = [(0.08, 1.55), (0.1, 1.62), (0.108, 1.7), (0.09, 1.77), (0.0, 1.8)]
    parts = [
        lathe(coat, sides=10, flatten=1.5, tint=look.coat),
        lathe(face, sides=8, centre_m=(0.02, 0, 0), tint=look.skin),
        lathe(hair, sides=8, centre_m=(-0.028, 0, 0), tint=look.hair),
    ]
    for side, swung in ((1, reach), (-1, -reach)):
        leg = _limb((0, 0.09 * side, hip), swung, 0.43, (0.08, 0.055), 0.35 * max(-swung, 0))
        arm = _limb((0, 0.225 * side, shoulder), -0.7 * swung, 0.29, (0.052, 0.038), -0.4)
        foot, hand = leg.end, arm.end
        parts += [mesh.tinted(look.trousers) for mesh in leg.bars]
        parts += [mesh.tinted(look.coat) for mesh in arm.bars]
        parts.append(
            rod(hand, hand + np.array([0.03, 0, -0.1]), (0.035, 0.025), sides=5, tint=look.skin)
        )
        shoe = np.array([foot[0] - 0.06, foot[1], max(foot[2], 0.05)])
        parts.append(
            rod(shoe, shoe + np.array([0.2, 0, -0.01]), (0.05, 0.035), sides=5, tint=(0.03,) * 3)
        )
    whole = join(parts)
    return replace(whole, position_m=(whole.position_m * look.scale).astype(np.float32))


class _Limb(NamedTuple):
    bars: list[Mesh]
    end: NDArray[np.float64]


def _limb(
    start: tuple[float, float, float],
    angle: float,
    length_m: float,
    radii: tuple[float, float],
    bend: float,
) -> _Limb:
    """Two bars with a joint between, swung forwards by an angle."""
    joint = np.array(start) + length_m * np.array([np.sin(angle), 0, -np.cos(angle)])
    end = joint + length_m * np.array([np.sin(angle - bend), 0, -np.cos(angle - bend)])
    bars = [
        rod(start, joint, radii, sides=6),
        rod(joint, end, (radii[1], 0.75 * radii[1]), sides=6),
    ]
    return _Limb(bars, end)


class _Walker(NamedTuple):
    """One passer-by.

    Attributes:
        places_m: Places along their closed route, every `_STEP_M`, (n, 2).
        courses_rad: Its direction there, (n,).
        start: Row of the places at which they are at first.
        speed_m_s: Negative for the other way round, 0 for one who stands.
        facing_rad: Where one who stands looks.
    """

    places_m: NDArray[np.float64]
    courses_rad: NDArray[np.float64]
    start: int
    speed_m_s: float
    facing_rad: float


class Crowd:
    """The passers-by of a recording, and where they are at a time."""

    def __init__(self, rng: np.random.Generator, people: int) -> None:
        """Send people on their ways: two thirds walk, the others stand.

        Args:
            rng: Source of randomness.
            people: How many.
        """
        names = list(ROUTES_M)
        self._walkers = []
        for number in range(people):
            line, length = closed_route(ROUTES_M[names[rng.integers(len(names))]])
            along = np.arange(0, length, _STEP_M)
            forward = line(along, 1)
            left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
            speed = 0.0 if number % 3 == 2 else rng.uniform(0.9, 1.5) * rng.choice([-1, 1])
            places = line(along) + rng.uniform(-0.6, 0.6) * left
            courses = np.arctan2(forward[:, 1], forward[:, 0]) + np.pi * (speed < 0)
            start = int(rng.integers(len(along)))
            self._walkers.append(_Walker(places, courses, start, speed, rng.uniform(0, 2 * np.pi)))

    def at(self, time_s: float, camera_m: NDArray) -> list[Figure]:
        """Figures to render; passers-by too near to the camera are left out."""
        figures = []
        for number, walker in enumerate(self._walkers):
            row = int(walker.start + walker.speed_m_s * time_s / _STEP_M)
            place = walker.places_m[row % len(walker.places_m)]
            if np.hypot(*(place - camera_m[:2])) < _TOO_NEAR_M:
                continue
            mesh, course = number * (PHASES + 1) + PHASES, walker.facing_rad
            if walker.speed_m_s:
                mesh += int(abs(row) * _STEP_M / _STRIDE_M * PHASES) % PHASES - PHASES
                course = walker.courses_rad[row % len(walker.courses_rad)]
            cos, sin = np.cos(course), np.sin(course)
            world_from_model = np.eye(4)
            world_from_model[:2, :2] = [[cos, -sin], [sin, cos]]
            world_from_model[:2, 3] = place
            figures.append(Figure(mesh, world_from_model))
        return figures
