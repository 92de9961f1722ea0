"""Make the golden vectors: `python scripts/make_golden.py [FOLDER]`, by default schema/golden.

A file a batched fusion method, of the record `vioapr.schemas.golden.GoldenVectors`: frames of a
simulated walk, and what the method answers in NumPy. Make them again only if a method is meant
to answer differently: they are what other implementations are tested with.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UNSET

from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS
from vioapr.fusion.types import Estimate
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas.golden import GoldenFrame, GoldenInputs, GoldenOutputs, GoldenVectors
from vioapr.simulation.walks import WalkParams, simulate_walk

FOLDER = Path(__file__).parents[1] / "schema" / "golden"
FRAMES = 60
SIGMAS = (
    "sigma_position_m",
    "sigma_orientation_deg",
    "sigma_position_axes_m",
    "sigma_orientation_axes_deg",
    "confidence",
)


def make_inputs() -> list[GoldenInputs]:
    """A walk whose tracker is lost twice and reset once; some frames lack predictions or sigmas."""
    walk = simulate_walk(WalkParams(duration_s=FRAMES / 2, extent_m=12), seed=11)
    inputs = []
    for row, time_s in enumerate(walk.gt.timestamp_s):
        gt, apr, vio = (track.target_from_source.at(row) for track in (walk.gt, walk.apr, walk.vio))
        has_apr, is_ok = row >= 2 and row % 6 != 4, row not in (24, 25, 26, 47)
        sigma_m = sigma_deg = None
        if has_apr and row % 5:
            # A regressor that knows its errors' sizes roughly would state these.
            errors = np.array([rigid.distance_m(gt, apr), rigid.angle_deg(gt, apr)])
            noise = np.random.default_rng(row).lognormal(0, 0.3, 2)
            sigma_m, sigma_deg = to_numbers((0.5 + errors) * noise)
        inputs.append(
            GoldenInputs(
                timestamp_s=float(np.float32(time_s)),
                apr_world_from_cam=to_numbers(np.concatenate([*apr])) if has_apr else None,
                apr_sigma_position_m=sigma_m,
                apr_sigma_orientation_deg=sigma_deg,
                has_apr=int(has_apr),
                vio_from_cam=to_numbers(np.concatenate([*vio])) if is_ok else None,
                tracking_ok=int(is_ok),
                tracking_reset=int(row == 38),
            )
        )
    return inputs


def answer(method: str, inputs: list[GoldenInputs]) -> list[GoldenOutputs]:
    """A method's answers in NumPy."""

    def pose(flat: Any) -> Rigid3 | None:
        return None if flat is None else Rigid3(np.array(flat[:3]), np.array(flat[3:]))

    localizer = Localizer(method)
    return [
        to_outputs(
            localizer.update(
                frame.timestamp_s,
                pose(frame.apr_world_from_cam),
                pose(frame.vio_from_cam),
                bool(frame.tracking_ok),
                tracking_reset=bool(frame.tracking_reset),
                apr_sigma_m=frame.apr_sigma_position_m,
                apr_sigma_deg=frame.apr_sigma_orientation_deg,
            )
        )
        for frame in inputs
    ]


def to_outputs(estimate: Estimate) -> GoldenOutputs:
    """An estimate under the contract's names."""
    sigmas = {name: getattr(estimate, name) for name in SIGMAS}
    state = estimate.localization_state
    return GoldenOutputs(
        status=int(estimate.status),
        confirmed_run=int(estimate.confirmed_run),
        world_from_cam=to_numbers(np.concatenate([*estimate.world_from_cam])),
        world_from_vio=to_numbers(np.concatenate([*estimate.world_from_vio])),
        localization_state=UNSET if state is None else int(state),
        **{k: to_numbers(np.reshape(v, -1)) for k, v in sigmas.items() if v is not None},
    )


def to_numbers(values: np.ndarray) -> tuple[float, ...]:
    """In single precision's digits."""
    return tuple(float(f"{value:.9g}") for value in values.astype(np.float32))


def make_texts() -> dict[str, str]:
    """The content of every file, by its name."""
    inputs = make_inputs()
    return {
        f"{name}.json": GoldenVectors(
            method=name,
            frames=tuple(map(GoldenFrame, inputs, answer(name, inputs))),
        ).to_json()
        for name, method in METHODS.items()
        if method.is_batched
    }


def main() -> None:
    """Write all files."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in make_texts().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
