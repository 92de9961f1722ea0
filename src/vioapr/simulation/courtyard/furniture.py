"""What stands about in a yard: fountain, benches, lamps, a kiosk, tables, bicycles, crates.

Every function returns parts at the origin, which `place` puts where they belong.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from vioapr.simulation.courtyard.mesh import Mesh, Parts, box, join, lathe, patch, rod

IRON = (0.1, 0.12, 0.12)
BRONZE = (0.28, 0.42, 0.36)


def place(parts: Parts, x_m: float, y_m: float, yaw_deg: float = 0.0, z_m: float = 0.0) -> Parts:
    """Parts turned about their origin and put down."""
    return [(material, mesh.moved((x_m, y_m, z_m), yaw_deg)) for material, mesh in parts]


def fountain() -> Parts:
    """An octagonal basin with a bowl and a bronze figure."""
    basin = lathe([(2.9, 0), (2.9, 0.16), (2.65, 0.16), (2.6, 0.62), (2.68, 0.62), (2.68, 0.72),
                   (2.2, 0.72), (2.2, 0.2)], sides=8, smooth=False)  # fmt: skip
    water = lathe([(2.3, 0.5), (0.0, 0.5)], sides=16, gloss=0.9)
    pillar = lathe([(0.75, 0.2), (0.7, 0.7), (0.34, 0.85), (0.28, 1.3), (0.45, 1.5), (0.4, 1.55),
                    (1.15, 1.8), (1.25, 1.92), (1.15, 1.92), (0.9, 1.84), (0.3, 1.84), (0.3, 2.2),
                    (0.38, 2.25), (0.38, 2.4), (0.0, 2.4)], sides=14)  # fmt: skip
    return [
        ("limestone", basin),
        ("water", water),
        ("limestone", pillar),
        ("painted", statue().moved((0, 0, 2.4)).tinted(BRONZE)),
    ]


def statue() -> Mesh:
    """A draped figure that raises one arm with a torch."""
    robe = lathe([(0.34, 0), (0.3, 0.5), (0.22, 0.95), (0.27, 1.3), (0.24, 1.45), (0.08, 1.55),
                  (0.08, 1.6)], sides=11, flatten=0.75)  # fmt: skip
    head = lathe([(0.02, 1.57), (0.11, 1.63), (0.13, 1.73), (0.1, 1.84), (0.0, 1.88)], sides=9)
    arms = [rod((0.22, 0, 1.4), (0.5, -0.1, 1.75), (0.075, 0.055)),
            rod((0.5, -0.1, 1.75), (0.52, -0.12, 2.2), (0.055, 0.045)),
            rod((-0.22, 0, 1.4), (-0.36, -0.16, 1.05), (0.075, 0.05)),
            rod((-0.36, -0.16, 1.05), (-0.12, -0.32, 1.0), (0.05, 0.04))]  # fmt: skip
    torch = lathe([(0.03, 2.2), (0.09, 2.35), (0.05, 2.45), (0.0, 2.65)], centre_m=(0.52, -0.12, 0))
    return join([robe, head, *arms, torch])


def bench() -> Parts:
    """A park bench that faces -y."""
    seat = [box((-0.9, y, 0.44), (0.9, y + 0.1, 0.48)) for y in (-0.22, -0.09, 0.04)]
    back = [box((-0.9, 0.2, z), (0.9, 0.24, z + 0.12)) for z in (0.58, 0.76)]
    legs = [box((x - 0.03, y, 0), (x + 0.03, y + 0.05, z), tint=IRON)
            for x in (-0.75, 0.75) for y, z in ((-0.2, 0.44), (0.18, 0.9))]  # fmt: skip
    return [("wood", join([*seat, *back])), ("painted", join(legs))]


def lamp() -> Parts:
    """A cast-iron street lamp, 3.6 m high."""
    post = lathe([(0.2, 0), (0.18, 0.3), (0.09, 0.4), (0.07, 1.2), (0.05, 3.0), (0.11, 3.05),
                  (0.06, 3.1)], sides=8, tint=IRON)  # fmt: skip
    glass = lathe([(0.1, 3.1), (0.19, 3.45)], sides=6, smooth=False, glow=6.0,
                  tint=(1.0, 0.93, 0.8))  # fmt: skip
    hat = lathe([(0.24, 3.45), (0.1, 3.6), (0.02, 3.7), (0.0, 3.75)], sides=6, tint=IRON)
    return [("painted", join([post, glass, hat]))]


def advertising_column() -> Parts:
    """A round pillar of posters with a dark cap."""
    body = lathe([(0.62, 0.35), (0.62, 2.75)], sides=18)
    plinth = lathe([(0.72, 0), (0.7, 0.35), (0.62, 0.35)], sides=18)
    cap = lathe([(0.62, 2.75), (0.8, 2.8), (0.78, 2.95), (0.4, 3.25), (0.08, 3.4), (0.0, 3.7)],
                sides=18, tint=(0.2, 0.28, 0.24))  # fmt: skip
    return [("posters", body), ("limestone", plinth), ("painted", cap)]


def notice_board() -> Parts:
    """Posters under glass on two posts, facing -y."""
    board = patch((-0.9, -0.06, 0.9), (1.8, 0, 0), (0, 0, 1.2), uv_m=(1.1, 1.2), gloss=0.25)
    frame = join([box((-1.0, -0.05, 0.8), (1.0, 0.05, 2.2)),
                  box((-1.05, -0.25, 2.2), (1.05, 0.25, 2.28))])  # fmt: skip
    posts = join([box((x - 0.05, -0.05, 0), (x + 0.05, 0.05, 0.8)) for x in (-0.85, 0.85)])
    return [("posters", board), ("wood", join([frame, posts]))]


def litter_bin(tint: ArrayLike = (0.22, 0.36, 0.25)) -> Parts:
    """A round bin."""
    profile = [(0.22, 0.05), (0.26, 0.8), (0.29, 0.8), (0.29, 0.86), (0.2, 0.86), (0.19, 0.6),
               (0.0, 0.6)]  # fmt: skip
    return [("painted", lathe(profile, tint=tint))]


def kiosk() -> Parts:
    """A wooden stall with a counter, goods and a striped awning, facing -y."""
    body = box((-1.5, -1.0, 0), (1.5, 1.0, 1.05), faces="snewt")
    back = join([box((-1.5, 0.9, 1.05), (1.5, 1.0, 2.5)), box((-1.5, -1.0, 1.05), (-1.4, 1.0, 2.5)),
                 box((1.4, -1.0, 1.05), (1.5, 1.0, 2.5))])  # fmt: skip
    counter = box((-1.6, -1.2, 1.05), (1.6, -0.8, 1.11))
    roof = box((-1.7, -1.3, 2.5), (1.7, 1.2, 2.62))
    goods = patch((-1.4, 0.88, 1.05), (2.8, 0, 0), (0, 0, 1.45), uv_m=(0.3, 2.1), glow=0.6)
    awning = patch((-1.6, -1.9, 2.1), (3.2, 0, 0), (0, 0.7, 0.42))
    sign = patch((-1.2, -1.31, 2.55), (2.4, 0, 0), (0, 0, 0.42))
    return [("wood", join([body, back, counter, roof])), ("posters", goods), ("stripes", awning),
            ("stripes", flipped(awning)), ("sign_kiosk", sign)]  # fmt: skip


def flipped(mesh: Mesh) -> Mesh:
    """The other side of a thin sheet."""
    return replace(mesh, normal=-mesh.normal, triangles=mesh.triangles[:, ::-1])


def table_set(rng: np.random.Generator, parasol_tint: ArrayLike | None) -> Parts:
    """A café table with three chairs and perhaps a parasol."""
    top = lathe([(0.36, 0.72), (0.36, 0.75), (0.0, 0.75)], sides=14, tint=(0.85, 0.82, 0.75))
    foot = lathe([(0.2, 0), (0.18, 0.03), (0.03, 0.06), (0.03, 0.72)], sides=8, tint=IRON)
    cup = lathe([(0.035, 0.75), (0.05, 0.83)], centre_m=(0.12, 0.08, 0), sides=8)
    parts: Parts = [("painted", join([top, foot, cup]))]
    for angle in np.array([20, 140, 260]) + rng.uniform(-25, 25, 3):
        parts += [(m, mesh.moved((0, 0.65, 0)).moved(yaw_deg=angle)) for m, mesh in chair()]
    if parasol_tint is not None:
        pole = rod((0, 0, 0), (0, 0, 2.5), (0.025, 0.025))
        shade = lathe([(1.35, 2.05), (0.7, 2.35), (0.0, 2.55)], sides=8, smooth=False,
                      tint=parasol_tint)  # fmt: skip
        parts += [("painted", pole), ("cloth", shade), ("cloth", flipped(shade).tinted(0.7))]
    return parts


def chair() -> Parts:
    """A wooden chair that faces -y."""
    seat = box((-0.2, -0.2, 0.43), (0.2, 0.2, 0.46))
    back = box((-0.2, 0.18, 0.6), (0.2, 0.21, 0.85))
    legs = [rod((x, y, 0), (x, y, 0.85 if y > 0 else 0.43), (0.014, 0.014), sides=3, tint=IRON)
            for x in (-0.18, 0.18) for y in (-0.18, 0.19)]  # fmt: skip
    return [("wood", join([seat, back])), ("painted", join(legs))]


def bicycle(tint: ArrayLike) -> Parts:
    """A bicycle on its stand, along x."""
    tubes = [((-0.5, 0.33), (-0.1, 0.3)), ((-0.1, 0.3), (-0.2, 0.85)), ((-0.5, 0.33), (-0.17, 0.7)),
             ((-0.17, 0.7), (0.38, 0.78)), ((-0.1, 0.3), (0.38, 0.7)), ((0.52, 0.33), (0.36, 0.95)),
             ((0.36, 0.95), (0.28, 1.02))]  # fmt: skip
    frame = [rod((a[0], 0.03, a[1]), (b[0], 0.03, b[1]), (0.022, 0.022), sides=4, tint=tint)
             for a, b in tubes]  # fmt: skip
    wheels = [wheel(x) for x in (-0.5, 0.52)]
    bar = rod((0.3, -0.25, 1.02), (0.3, 0.3, 1.02), (0.015, 0.015), sides=5, tint=IRON)
    saddle = box((-0.32, -0.05, 0.86), (-0.08, 0.11, 0.92), tint=(0.15, 0.1, 0.08))
    return [("painted", join([*frame, *wheels, bar, saddle]))]


def wheel(x_m: float) -> Mesh:
    """A bicycle's wheel along x, its hub at `x_m`."""
    angle = np.linspace(0, 2 * np.pi, 13)
    along, height = 0.32 * np.cos(angle), 0.33 + 0.32 * np.sin(angle)
    rim = np.column_stack([x_m + along, 0 * angle + 0.03, height])
    tyre = [rod(a, b, (0.024, 0.024), sides=3, tint=(0.09, 0.09, 0.09))
            for a, b in pairwise(rim)]  # fmt: skip
    spokes = [rod((x_m, 0.03, 0.33), p, (0.008, 0.005), sides=3, tint=(0.6, 0.6, 0.6))
              for p in rim[:-1:2]]  # fmt: skip
    return join([*tyre, *spokes])


def crates(rng: np.random.Generator, count: int = 6) -> Parts:
    """A careless stack of wooden crates."""
    parts = []
    for number in range(count):
        level, size = number // 3, 0.5
        x, y = (number % 3 - 1) * 0.58 + rng.normal(0, 0.03), rng.normal(0, 0.05)
        crate = box((-size / 2, -0.18, 0), (size / 2, 0.18, 0.36), tint=rng.uniform(0.8, 1.25))
        parts.append(crate.moved((x, y, 0.37 * level), rng.uniform(-9, 9)))
    return [("crate", join(parts))]


def woodpile(rng: np.random.Generator, length_m: float = 2.6) -> Parts:
    """Split logs stacked against a wall, their ends facing -y."""
    parts = []
    for level in range(7):
        for x in np.arange(-length_m / 2, length_m / 2, 0.19):
            radius, shade = rng.uniform(0.075, 0.1), rng.uniform(1.5, 2.1)
            log = lathe([(radius, 0.35), (radius, 0.5)], sides=6, tint=(0.8, 0.7, 0.6))
            disc = lathe([(radius, 0.5), (0.0, 0.5)], sides=6, tint=shade)
            upright = join([log, disc])
            parts.append(_laid(upright, (x + rng.normal(0, 0.015) + 0.09 * (level % 2), 0.25,
                                         0.1 + 0.165 * level)))  # fmt: skip
    dark = box((-length_m / 2, -0.05, 0), (length_m / 2 + 0.1, 0.25, 1.15), tint=0.3)
    return [("wood", join([dark, *parts]))]


def _laid(mesh: Mesh, offset_m: ArrayLike) -> Mesh:
    """A quarter turn about x: what pointed up points to -y."""
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float32)
    return replace(
        mesh,
        position_m=(mesh.position_m @ turn.T + np.asarray(offset_m)).astype(np.float32),
        normal=mesh.normal @ turn.T,
    )


def van(tint: ArrayLike) -> Parts:
    """A small delivery van, its front towards +x."""
    body = join(
        [box((-2.1, -0.85, 0.35), (1.2, 0.85, 2.0)), box((1.2, -0.85, 0.35), (2.1, 0.85, 1.15))]
    )
    slope = patch((2.0, -0.8, 1.15), (0, 1.6, 0), (-0.75, 0, 0.8), gloss=0.9, tint=0.12)
    glass = [
        patch((x, -0.86, 1.2), (0.9, 0, 0), (0, 0, 0.6), gloss=0.9, tint=0.12) for x in (0.25,)
    ]
    glass += [patch((1.15, 0.86, 1.2), (-0.9, 0, 0), (0, 0, 0.6), gloss=0.9, tint=0.12)]
    sides = [
        patch((1.2, -0.85, 1.15), (0.8, 0, 0), (0, 0, 0.01)),
    ]
    name = patch((-1.9, -0.87, 0.9), (2.0, 0, 0), (0, 0, 0.8))
    wheels = [
        _laid(
            lathe(
                [(0.33, 0), (0.33, 0.18), (0.2, 0.19), (0.0, 0.19)],
                sides=14,
                tint=(0.12, 0.12, 0.12),
            ),
            (x, -0.7, 0.33),
        )
        for x in (-1.35, 1.35)
    ]
    other = [w.moved(yaw_deg=180) for w in wheels]
    lights = [box((2.1, y - 0.1, 0.7), (2.13, y + 0.1, 0.85), tint=1.2) for y in (-0.6, 0.6)]
    return [("painted", join([body.tinted(tint), *sides, slope, *glass, *wheels, *other, *lights])),
            ("sign_van", name)]  # fmt: skip
