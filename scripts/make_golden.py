"""Make the golden vectors: `python scripts/make_golden.py [FOLDER]`, by default schema/golden.

A file a batched fusion method, of the record `vioapr.schemas.golden.GoldenVectors`: frames of a
simulated walk, and what the method answers in NumPy. Make them again only if a method is meant
to answer differently: they are what other implementations are tested with.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
from msgspec import UNSET

from vioapr.fusion.easing import Eased
from vioapr.fusion.methods import METHODS
from vioapr.fusion.session import Picture, Session, begin, step
from vioapr.fusion.types import Estimate, FrameInput
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


LATE = {15: 2, 17: 4, 27: 1, 29: 4, 36: 3, 39: 2, 55: 11}
"""Predictions that are of an earlier frame's picture, and by how many frames. Row 27's is of a
frame without tracking, row 29's from before a loss, row 39's from before a reset, and row 55's
too old."""


def make_inputs() -> list[GoldenInputs]:
    """A walk whose tracker is lost twice and reset once; some frames lack predictions or sigmas."""
    walk = simulate_walk(WalkParams(duration_s=FRAMES / 2, extent_m=12), seed=11)
    inputs = []
    for row, time_s in enumerate(walk.gt.timestamp_s):
        taken = row - LATE.get(row, 0)
        gt, apr = (track.target_from_source.at(taken) for track in (walk.gt, walk.apr))
        vio, then = (walk.vio.target_from_source.at(one) for one in (row, taken))
        has_apr, is_ok = row >= 2 and row % 6 != 4, is_tracked(row)
        sigma_m = sigma_deg = None
        if has_apr and row % 5:
            # A regressor that knows its errors' sizes roughly would state these.
            errors = np.array([rigid.distance_m(gt, apr), rigid.angle_deg(gt, apr)])
            noise = np.random.default_rng(row).lognormal(0, 0.3, 2)
            sigma_m, sigma_deg = to_numbers((0.5 + errors) * noise)
        inputs.append(
            GoldenInputs(
                timestamp_s=float(np.float32(time_s)),
                apr_world_from_cam=_flat(apr) if has_apr else None,
                apr_sigma_position_m=sigma_m,
                apr_sigma_orientation_deg=sigma_deg,
                has_apr=int(has_apr),
                vio_from_cam=_flat(vio) if is_ok else None,
                tracking_ok=int(is_ok),
                tracking_reset=int(row == 38),
                image_timestamp_s=float(np.float32(walk.gt.timestamp_s[taken])),
                image_vio_from_cam=_flat(then) if is_tracked(taken) else None,
            )
        )
    return inputs


def is_tracked(row: int) -> bool:
    """Whether the tracker knows its pose."""
    return row not in (24, 25, 26, 47)


def answer(method: str, frames: list[GoldenInputs]) -> list[GoldenOutputs]:
    """A method's answers in NumPy."""
    chosen = METHODS[method]
    session = Session(chosen, chosen.params_type())
    state = begin(session, (), np.zeros(()))
    answers = []
    for inputs in frames:
        state, estimate = step(session, state, *_read(inputs))
        answers.append(to_outputs(estimate))
    return answers


def _read(inputs: GoldenInputs) -> tuple[FrameInput, Picture]:
    apr, vio, then = map(
        _pose, (inputs.apr_world_from_cam, inputs.vio_from_cam, inputs.image_vio_from_cam)
    )
    sigma_m, sigma_deg = (
        np.asarray(np.nan if sigma is None else sigma)
        for sigma in (inputs.apr_sigma_position_m, inputs.apr_sigma_orientation_deg)
    )
    frame = FrameInput(
        np.asarray(inputs.timestamp_s),
        apr,
        np.asarray(inputs.has_apr == 1),
        vio,
        np.asarray(inputs.tracking_ok == 1),
        np.asarray(inputs.tracking_reset == 1),
        sigma_m,
        np.deg2rad(sigma_deg),
    )
    has_pose = np.asarray(inputs.image_vio_from_cam is not None)
    return frame, Picture(np.asarray(inputs.image_timestamp_s), then, has_pose)


def _pose(flat: Any) -> Rigid3:
    return Rigid3.identity() if flat is None else Rigid3(np.array(flat[:3]), np.array(flat[3:]))


def to_outputs(estimate: Estimate) -> GoldenOutputs:
    """An estimate under the contract's names."""
    sigmas = {name: getattr(estimate, name) for name in SIGMAS}
    eased, state = cast("Eased", estimate.eased), estimate.localization_state
    return GoldenOutputs(
        status=int(estimate.status),
        confirmed_run=int(estimate.confirmed_run),
        world_from_cam=_flat(estimate.world_from_cam),
        world_from_vio=_flat(estimate.world_from_vio),
        display_from_vio=_flat(eased.display_from_vio),
        display_left_m=to_numbers(np.reshape(eased.left_m, -1)),
        display_left_deg=to_numbers(np.reshape(eased.left_deg, -1)),
        display_placed_anew=int(eased.is_placed_anew),
        localization_state=UNSET if state is None else int(state),
        **{k: to_numbers(np.reshape(v, -1)) for k, v in sigmas.items() if v is not None},
    )


def _flat(pose: Rigid3) -> tuple[float, ...]:
    return to_numbers(np.concatenate([*pose]))


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
