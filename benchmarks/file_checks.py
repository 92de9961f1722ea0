"""How often wrong files are named, and right ones are not: faults put into pairs of tracks.

    VIOAPR_DATA=... python benchmarks/file_checks.py [--json FILE] [--update-docs]

Every fault is put into the VIO (or both files) of every pair, and `check_pair`, which `fuse`,
`evaluate`, `localize` and `import images` call, looks at the two. `named` is the share in which the
right fault is named with a remedy that mends it; `other` the share in which something else is
named; the rest gets no warning. Without a fault, every warning is a false alarm.

Pairs: the real predictions of `bench/` with real and simulated odometries of their walks, and
simulated walks of three sizes of a regressor's errors. Walks of 7-Scenes last 17 to 33 s, and their
regressors err by up to 10 deg: what is not named there is mostly not to be seen.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common import describe_machine, publish, write_json
from rich.table import Table

from vioapr.formats.pair_checks import Track, check_pair
from vioapr.formats.readings import READINGS
from vioapr.formats.registry import read_trajectory
from vioapr.geometry import quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.regressors import RegressorErrors
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.trajectory import Trajectory

PAGE = "file-checks.md"
SIMULATED_SEEDS = 8
REGRESSORS = {
    "good": RegressorErrors(0.2, 1.0, 0.05, 0.3, 0.02),
    "usual": RegressorErrors(),
    "bad": RegressorErrors(2.0, 6.0, 0.5, 3.0, 0.1),
}
KNOWN_FAULTS = ("chess_seq03/vio_dso",)
"""Real files with a fault: this odometry is 0.94 s off its clock, by its own frame numbers."""

BODY_FROM_CAM = Rigid3(
    np.array([-0.02, -0.06, 0.01]), quaternion.from_rotvec(np.array([-0.02, 0.02, 1.556]))
)
QUARTER_TURN = quaternion.from_rotvec(np.array([0.0, 0.0, np.pi / 2]))
BY_NAME = {reading.name: reading for reading in READINGS}


@dataclass(frozen=True)
class Pair:
    """A walk's two tracks.

    Attributes:
        group: Where it is from.
        title: For people.
        apr: Predictions.
        vio: Tracked poses.
    """

    group: str
    title: str
    apr: Trajectory
    vio: Trajectory


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes:
        name: For people.
        inject: From right tracks to wrong ones.
        kind: The warning that names it.
        remedy: What its remedy must say.
    """

    name: str
    inject: Callable[[Pair], Pair]
    kind: str
    remedy: str = ""


def of_vio(change: Callable[[Rigid3], Rigid3]) -> Callable[[Pair], Pair]:
    """Change the poses of the VIO."""
    return lambda pair: replace(
        pair, vio=pair.vio.with_transforms(change(pair.vio.target_from_source))
    )


def misread(name: str) -> Callable[[Pair], Pair]:
    """Poses to which a reading gives back what they were; but for two, a reading undoes itself."""
    swapped = {"wxyz": "xyzw", "xyzw": "wxyz"}
    return of_vio(BY_NAME[swapped.get(name, name)].change)


def scaled(factor: float) -> Callable[[Pair], Pair]:
    """Lengths of the VIO, times a factor."""
    return of_vio(lambda poses: poses._replace(translation_m=poses.translation_m * factor))


def late(seconds: float) -> Callable[[Pair], Pair]:
    """A VIO whose clock is ahead."""
    return lambda pair: replace(
        pair, vio=replace(pair.vio, timestamp_s=pair.vio.timestamp_s + seconds)
    )


def in_milliseconds(pair: Pair) -> Pair:
    """Timestamps of the VIO in milliseconds."""
    return replace(pair, vio=replace(pair.vio, timestamp_s=pair.vio.timestamp_s * 1000))


FAULTS = (
    Fault("quaternion wxyz read as xyzw", misread("wxyz"), "convention", "--reading wxyz"),
    Fault("quaternion xyzw read as wxyz", misread("xyzw"), "convention", "--reading xyzw"),
    Fault("OpenGL camera axes", misread("opengl"), "convention", "--reading opengl"),
    Fault("poses inverted", misread("inverted"), "convention", "--reading inverted"),
    Fault("positions mirrored in x", misread("mirror-x"), "convention", "--reading mirror-x"),
    Fault("positions mirrored in z", misread("mirror-z"), "convention", "--reading mirror-z"),
    Fault("left-handed world", misread("left-handed-z"), "convention", "--reading left-handed-z"),
    Fault("the IMU's body", of_vio(lambda poses: poses @ BODY_FROM_CAM.inverse()), "device"),
    Fault(
        "images turned by a quarter",
        of_vio(lambda p: p._replace(quat_xyzw=quaternion.multiply(p.quat_xyzw, QUARTER_TURN))),
        "device",
    ),
    Fault("centimetres", scaled(100), "scale", "--scale 0.01"),
    Fault("half scale", scaled(0.5), "scale", "--scale"),
    Fault("milliseconds", in_milliseconds, "time-unit", "--time-unit ms"),
    Fault("clock 0.15 s ahead", late(0.15), "clock", "--shift-s=-0.1"),
    Fault("clock 2 s ahead", late(2.0), "clock", "--shift-s=-"),
    Fault("clock 7 s behind", late(-7.0), "clock", "--shift-s="),
    Fault("files swapped", lambda p: replace(p, apr=p.vio, vio=p.apr), "swapped"),
    Fault("the same file twice", lambda p: replace(p, vio=p.apr), "same"),
)
RIGHT = Fault("none", lambda pair: pair, "")


def real_pairs(data: Path) -> Iterator[Pair]:
    """All predictions of every walk of the benchmark, with its odometries in turn."""
    for folder in sorted((data / "bench").glob("*/*/")):
        vios = {path.stem: read_trajectory(path) for path in sorted(folder.glob("vio_*.tum"))}
        right = [name for name in vios if f"{folder.name}/{name}" not in KNOWN_FAULTS]
        for index, path in enumerate(sorted(folder.glob("apr_*.tum"))):
            name = right[index % len(right)]
            title = f"{folder.name} {path.stem} {name}"
            yield Pair(folder.parent.name, title, read_trajectory(path), vios[name])


def simulated_pairs() -> Iterator[Pair]:
    """Walks of two minutes."""
    for name, errors in REGRESSORS.items():
        for seed in range(SIMULATED_SEEDS):
            params = WalkParams(duration_s=120, rate_hz=(2, 5)[seed % 2], regressor=errors)
            walk = simulate_walk(params, seed)
            yield Pair(f"simulated, {name} regressor", f"{name} {seed}", walk.apr, walk.vio)


def measure(pairs: list[Pair]) -> list[dict]:
    """Every fault in every pair."""
    rows = []
    for fault in (RIGHT, *FAULTS):
        for pair in pairs:
            wrong = fault.inject(pair)
            begin = time.perf_counter()
            tracks = Track("apr.tum", "apr", wrong.apr), Track("vio.tum", "vio", wrong.vio)
            found = check_pair(*tracks).warnings
            seconds = time.perf_counter() - begin
            is_named = any(w.kind == fault.kind and fault.remedy in w.remedy for w in found)
            is_other = bool(found) and not is_named
            rows.append(
                {
                    "fault": fault.name,
                    "group": pair.group,
                    "pair": pair.title,
                    "named": is_named,
                    "other": is_other,
                    "warnings": [f"{w.kind}: {w}" for w in found],
                    "seconds": seconds,
                }
            )
    return rows


def tabulate(rows: list[dict], pairs: list[Pair]) -> Table:
    """Shares by fault and group of pairs."""
    groups = list(dict.fromkeys(pair.group for pair in pairs))
    median_ms = 1000 * float(np.median([row["seconds"] for row in rows]))
    table = Table(
        title=f"Named % (something else named %) of {len(pairs)} pairs; a check takes "
        f"{median_ms:.0f} ms (median)"
    )
    table.add_column("fault of the VIO")
    for group in groups:
        table.add_column(f"{group} ({sum(pair.group == group for pair in pairs)})", justify="right")
    for fault in (RIGHT, *FAULTS):
        cells = []
        for group in groups:
            of_group = [r for r in rows if r["fault"] == fault.name and r["group"] == group]
            named, other = (
                100 * float(np.mean([row[key] for row in of_group])) for key in ("named", "other")
            )
            if fault is RIGHT:
                cells.append(f"{sum(row['other'] for row in of_group)} false alarms")
            else:
                cells.append(f"{named:.0f}" + (f" ({other:.0f})" if other else ""))
        table.add_row(fault.name, *cells)
    return table


def main() -> None:
    """Measure, print, and write what was asked for."""
    raw = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--update-docs", action="store_true")
    options = parser.parse_args()
    data = os.environ.get("VIOAPR_DATA")
    pairs = [*(real_pairs(Path(data)) if data else ()), *simulated_pairs()]
    rows = measure(pairs)
    publish(tabulate(rows, pairs), PAGE, "file_checks", update_docs=options.update_docs)
    if options.json is not None:
        machine = describe_machine(("numpy", "vioapr"))
        write_json(options.json, {"machine": machine, "checks": rows})


if __name__ == "__main__":
    main()
