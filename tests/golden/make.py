"""Makes the golden vectors anew: `python tests/golden/make.py`.

Each file holds frames of a simulated walk and what a fusion method answers in NumPy, in double
precision, from inputs in single precision. What is NaN is null. docs/contract.md describes the
names. Make them anew only if a method is meant to answer differently.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.types import Estimate
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import SimulatedWalk, WalkParams, simulate_walk

FOLDER = Path(__file__).parent
METHODS = ("vio-apr", "consensus")
FRAMES = 60
SIGMAS = (
    "sigma_position_m",
    "sigma_orientation_deg",
    "sigma_position_axes_m",
    "sigma_orientation_axes_deg",
)


def make_frames() -> list[dict[str, Any]]:
    """Inputs: some frames lack predictions or stated errors; a tracker lost twice, reset once."""
    walk = simulate_walk(WalkParams(duration_s=FRAMES / 2, extent_m=12), seed=11)
    frames = []
    for row, time_s in enumerate(walk.gt.timestamp_s):
        apr, vio = (
            np.concatenate([track.position_m[row], track.quat_xyzw[row]])
            for track in (walk.apr, walk.vio)
        )
        stated = stated_sigmas(row, walk) if row % 5 else (None, None)
        has_apr, is_ok = row >= 2 and row % 6 != 4, row not in (24, 25, 26, 47)
        frames.append(
            {
                "timestamp_s": float(np.float32(time_s)),
                "apr_world_from_cam": _numbers(apr) if has_apr else None,
                "apr_sigma_position_m": stated[0] if has_apr else None,
                "apr_sigma_orientation_deg": stated[1] if has_apr else None,
                "has_apr": int(has_apr),
                "vio_from_cam": _numbers(vio) if is_ok else None,
                "tracking_ok": int(is_ok),
                "tracking_reset": int(row == 38),
            }
        )
    return frames


def stated_sigmas(row: int, walk: SimulatedWalk) -> list[float]:
    """What a regressor that knows its errors' sizes roughly would state, in m and deg."""
    gt, apr = (track.target_from_source.at(row) for track in (walk.gt, walk.apr))
    errors = np.array([rigid.distance_m(gt, apr), rigid.angle_deg(gt, apr)])
    return _numbers((0.5 + errors) * np.random.default_rng(row).lognormal(0, 0.3, 2))


def answer(method: str, frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A method's answers in NumPy."""
    localizer = Localizer(method)
    return [
        describe(
            localizer.update(
                frame["timestamp_s"],
                _pose(frame["apr_world_from_cam"]),
                _pose(frame["vio_from_cam"]),
                bool(frame["tracking_ok"]),
                tracking_reset=bool(frame["tracking_reset"]),
                apr_sigma_m=frame["apr_sigma_position_m"],
                apr_sigma_deg=frame["apr_sigma_orientation_deg"],
            )
        )
        for frame in frames
    ]


def describe(estimate: Estimate) -> dict[str, Any]:
    """An estimate under the contract's names."""
    sigmas = {name: getattr(estimate, name) for name in SIGMAS}
    return {
        "status": int(estimate.status),
        "confirmed_run": int(estimate.confirmed_run),
        "world_from_cam": _numbers(np.concatenate([*estimate.world_from_cam])),
        "world_from_vio": _numbers(np.concatenate([*estimate.world_from_vio])),
        **{k: _numbers(np.reshape(v, -1)) for k, v in sigmas.items() if v is not None},
    }


def _numbers(values: np.ndarray) -> list[float | None]:
    """In single precision's digits; null for NaN."""
    return [float(f"{x:.9g}") if np.isfinite(x) else None for x in values.astype(np.float32)]


def _pose(flat: list[float] | None) -> Rigid3 | None:
    return None if flat is None else Rigid3(np.array(flat[:3]), np.array(flat[3:]))


def main() -> None:
    """Write all files."""
    frames = make_frames()
    for method in METHODS:
        pairs = zip(frames, answer(method, frames), strict=True)
        rows = [json.dumps({"inputs": inputs, "outputs": outputs}) for inputs, outputs in pairs]
        head = f'"format": "vioapr golden vectors", "version": 1, "method": "{method}"'
        text = f'{{{head}, "frames": [\n' + ",\n".join(rows) + "\n]}\n"
        (FOLDER / f"{method}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
