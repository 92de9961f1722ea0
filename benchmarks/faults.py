"""What faults do to a localizer: its error during the fault, and the time it takes to recover.

    python benchmarks/faults.py [--json FILE] [--update-docs]

Simulated walks of three minutes (the regressor's errors as in the package's demo: a bias that
depends on the view, noise, look-alike places), 20 seeds, 2 Hz; each fault begins after 90 s.
`during` is the median error over the fault's frames (for a fault of one moment, over the 10 s
after it); `recovered` the seconds from the fault's end until the error stays, for five seconds,
below the 95th percentile of the same method's on the same walk without the fault; `sigma` the
median of the stated sigma during the fault over that without it. Errors and sigmas are those of
the frames that have an answer; their share stands beside them. Means over the seeds' figures would
hide single failures, so the median and the worst seed are given.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from common import describe_machine, replace_section, write_json
from numpy.typing import NDArray

from vioapr.fusion.fused_walk import FusedWalk
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import fuse_walks
from vioapr.fusion.pairing import PairedFrames, pair_frames
from vioapr.fusion.types import FrameInput
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import WalkParams, simulate_walk

DOCS = Path(__file__).parent.parent / "docs" / "results" / "accuracy.md"
METHOD_NAMES = ("chain", "vio-apr")
SEEDS = 20
START_S = 90.0
AFTERMATH_S = 10.0
STEADY_S = 5.0
WALK = WalkParams(duration_s=180.0)


class Faulty(NamedTuple):
    """A walk with a fault.

    Attributes:
        frames: What the localizer gets.
        gt_world_from_cam: Ground truth of these frames.
    """

    frames: FrameInput
    gt_world_from_cam: Rigid3


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes:
        name: For people.
        seconds: How long it lasts; 0 for a moment.
        inject: From frames, ground truth, the rows of the fault and a generator.
    """

    name: str
    seconds: float
    inject: Callable[[Faulty, NDArray[np.bool_], np.random.Generator], Faulty]


def move_tracker(offset: Rigid3) -> Callable[..., Faulty]:
    """The tracker's world jumps by a transform at the fault's beginning, without notice."""

    def inject(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
        after = np.cumsum(during) > 0
        moved = offset @ walk.frames.vio_from_cam
        vio = rigid.choose(after, moved, walk.frames.vio_from_cam)
        return walk._replace(frames=walk.frames._replace(vio_from_cam=vio))

    return inject


def reset_tracker(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """The tracker starts again at the fault's beginning, without notice.

    Position and heading are zero; up stays up, as trackers measure gravity.
    """
    start = walk.frames.vio_from_cam.at(int(np.flatnonzero(during)[0]))
    forward = quaternion.rotate(start.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    heading = np.arctan2(forward[0], forward[2])
    turn = quaternion.from_rotvec(np.array([0.0, -heading, 0.0]))
    new_from_old = Rigid3(-quaternion.rotate(turn, start.translation_m), turn)
    return move_tracker(new_from_old)(walk, during, rng)


def scale_tracker(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """The tracker's scale is 10 % too large from the fault's beginning on."""
    position = walk.frames.vio_from_cam.translation_m
    steps = np.diff(position, axis=0, prepend=position[:1])
    steps = np.where((np.cumsum(during) > 0)[:, None], 1.1 * steps, steps)
    scaled = position[0] + np.cumsum(steps, axis=0)
    vio = walk.frames.vio_from_cam._replace(translation_m=scaled)
    return walk._replace(frames=walk.frames._replace(vio_from_cam=vio))


def hide_predictions(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """No predictions."""
    return walk._replace(frames=walk.frames._replace(has_apr=walk.frames.has_apr & ~during))


def bias_predictions(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """All predictions lie 10 m to one side: a look-alike place."""
    direction = rng.uniform(0, 2 * np.pi)
    offset = 10 * np.array([np.cos(direction), np.sin(direction), 0.0])
    apr = walk.frames.apr_world_from_cam
    moved = np.where(during[:, None], apr.translation_m + offset, apr.translation_m)
    apr = apr._replace(translation_m=moved)
    return walk._replace(frames=walk.frames._replace(apr_world_from_cam=apr))


def cover_camera(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """Predictions are anywhere in the place, in any direction."""
    apr = walk.frames.apr_world_from_cam
    low, high = apr.translation_m.min(axis=0), apr.translation_m.max(axis=0)
    count = len(during)
    anywhere = Rigid3(
        rng.uniform(low, high, (count, 3)), quaternion.normalize(rng.standard_normal((count, 4)))
    )
    apr = rigid.choose(during, anywhere, apr)
    return walk._replace(frames=walk.frames._replace(apr_world_from_cam=apr))


def repeat_frames(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """Each frame of the fault comes five times, a millisecond apart, with the same poses."""
    repeats = np.where(during, 5, 1)
    rows = np.repeat(np.arange(len(during)), repeats)
    nth = np.arange(len(rows)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    frames = walk.frames.at(rows)
    frames = frames._replace(timestamp_s=frames.timestamp_s + 0.001 * nth)
    return Faulty(frames, walk.gt_world_from_cam.at(rows))


def thin_predictions(walk: Faulty, during: NDArray[np.bool_], rng: np.random.Generator) -> Faulty:
    """60 Hz of VIO and 1 Hz of predictions, all the walk."""
    times = walk.frames.timestamp_s
    fine = np.arange(times[0], times[-1], 1 / 60)
    row = np.clip(np.searchsorted(times, fine, side="right") - 1, 0, len(times) - 2)
    fraction = (fine - times[row]) / (times[row + 1] - times[row])

    def between(poses: Rigid3) -> Rigid3:
        return rigid.interpolate(poses.at(row), poses.at(row + 1), fraction)

    is_predicted = (np.diff(row, prepend=-1) > 0) & (row % 2 == 0)
    frames = FrameInput(
        fine,
        walk.frames.apr_world_from_cam.at(row),
        is_predicted,
        between(walk.frames.vio_from_cam),
        np.ones(len(fine), dtype=bool),
        np.zeros(len(fine), dtype=bool),
    )
    return Faulty(frames, between(walk.gt_world_from_cam))


FAULTS = (
    Fault("tracker jumps by 5 m", 0, move_tracker(Rigid3(np.array([3.0, 0, 4.0]), np.eye(4)[3]))),
    Fault("tracker is reset to the identity", 0, reset_tracker),
    Fault("tracker's scale is 10 % off from then on", 90, scale_tracker),
    Fault("20 s without predictions", 20, hide_predictions),
    Fault("30 s of predictions biased by 10 m", 30, bias_predictions),
    Fault("camera covered for 20 s: random predictions", 20, cover_camera),
    Fault("repeated frames for 20 s", 20, repeat_frames),
    Fault("60 Hz VIO, 1 Hz predictions", 180, thin_predictions),
)


def make_walk(seed: int) -> Faulty:
    """A walk without faults."""
    walk = simulate_walk(WALK, seed)
    return Faulty(pair_frames(walk.apr, walk.vio).inputs, walk.gt.target_from_source)


def spoil(fault: Fault, seed: int) -> Faulty:
    """A walk with a fault."""
    walk = make_walk(seed)
    times = walk.frames.timestamp_s - walk.frames.timestamp_s[0]
    begin = 0.0 if fault.seconds == WALK.duration_s else START_S
    during = (times >= begin) & (times <= begin + fault.seconds)
    return fault.inject(walk, during, np.random.default_rng(seed))


def judge(fault: Fault, clean: FusedWalk, fused: FusedWalk, gts: tuple[Rigid3, Rigid3]) -> dict:
    """One seed's figures; NaN where there is no answer."""
    errors = [
        np.where(walk.is_localized, rigid.distance_m(gt, walk.world_from_cam), np.nan)
        for walk, gt in zip((clean, fused), gts, strict=True)
    ]
    times = fused.timestamp_s - fused.timestamp_s[0]
    begin = 0.0 if fault.seconds == WALK.duration_s else START_S
    end = begin + fault.seconds
    window = (times >= begin) & (times <= max(end, begin + AFTERMATH_S))
    limit = np.nanpercentile(errors[0], 95)
    after = times > end
    is_answer = window & np.isfinite(errors[1])
    figures = {
        "during_m": _median(errors[1][is_answer]),
        "coverage": float(is_answer.sum() / window.sum()),
        "clean_m": float(np.nanmedian(errors[0])),
        "recovered_s": recovery_s(times[after] - end, errors[1][after] <= limit),
    }
    if fused.sigma_position_m is not None and clean.sigma_position_m is not None:
        usual = np.nanmedian(clean.sigma_position_m)
        figures["sigma_ratio"] = _median(fused.sigma_position_m[is_answer]) / usual
        inside = errors[1][is_answer] <= 3 * fused.sigma_position_m[is_answer]
        figures["within_3_sigma"] = float(inside.mean()) if len(inside) else np.nan
    return figures


def _median(values: NDArray[np.floating]) -> float:
    return float(np.median(values)) if len(values) else np.nan


def recovery_s(times: NDArray[np.floating], is_good: NDArray[np.bool_]) -> float:
    """The first time from which on all is good for `STEADY_S`; infinite if there is none."""
    for start in np.flatnonzero(is_good):
        window = (times >= times[start]) & (times <= times[start] + STEADY_S)
        if is_good[window].all():
            return float(times[start])
    return 0.0 if not len(times) else float("inf")


def measure() -> list[dict]:
    """Every fault with every method."""
    rows = []
    for name in METHOD_NAMES:
        method = METHODS[name]
        params = method.params_type()

        def fuse(walks: list[Faulty], method=method, params=params) -> list[FusedWalk]:
            return fuse_walks(method, params, [PairedFrames(w.frames) for w in walks], view="live")

        cleans = [make_walk(seed) for seed in range(SEEDS)]
        fused_cleans = fuse(cleans)
        for fault in FAULTS:
            faulty = [spoil(fault, seed) for seed in range(SEEDS)]
            seeds = [
                judge(fault, clean, fused, (a.gt_world_from_cam, b.gt_world_from_cam))
                for clean, fused, a, b in zip(
                    fused_cleans, fuse(faulty), cleans, faulty, strict=True
                )
            ]
            rows.append({"fault": fault.name, "method": name, **summarize(seeds)})
    return rows


def summarize(seeds: list[dict]) -> dict:
    """Median and worst over the seeds."""
    figures = {}
    for key in seeds[0]:
        values = np.array([seed[key] for seed in seeds])
        worst = np.nanmin if key in ("coverage", "within_3_sigma", "sigma_ratio") else np.nanmax
        figures[key] = float(np.nanmedian(values))
        figures[f"{key}_worst"] = float(worst(values))
    return figures


def markdown(rows: list[dict]) -> str:
    """One row a fault, methods side by side."""
    lines = [
        "| fault | method | error before m | during m (worst seed) | answers % | "
        "recovered s (worst seed) | sigma grows by | within 3 sigma % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for fault in FAULTS:
        for row in (row for row in rows if row["fault"] == fault.name):
            has_sigma = "sigma_ratio" in row
            cells = [
                fault.name if row["method"] == METHOD_NAMES[0] else "",
                row["method"],
                f"{row['clean_m']:.2f}",
                f"{row['during_m']:.2f} ({row['during_m_worst']:.2f})",
                f"{100 * row['coverage']:.0f}",
                f"{row['recovered_s']:.1f} ({row['recovered_s_worst']:.1f})",
                f"{row['sigma_ratio']:.1f}" if has_sigma else "",
                f"{100 * row['within_3_sigma']:.0f}" if has_sigma else "",
            ]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    rows = measure()
    print(markdown(rows))
    if options.json:
        write_json(options.json, {"machine": describe_machine(["numpy"]), "rows": rows})
    if options.update_docs:
        replace_section(DOCS, "faults", markdown(rows))


if __name__ == "__main__":
    main()
