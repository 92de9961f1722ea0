"""Do PyTorch, onnxruntime and the NumPy localizer answer alike?

    python benchmarks/localizer_equality.py [--frames 1000] [--json PATH]

A simulated walk is told to the exported localizer through pictures that show the predicted poses
(tests/export/networks.py), so that every frame goes through the whole graph: pixels, resizing,
network, fusion. Some frames have no image, some no tracking, some a new tracking world. The NumPy
localizer runs in double precision and is fed with the graph's own predictions: one walk frame by
frame (`Localizer`), and many walks in one batch.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from common import describe_machine, publish, write_json
from rich.table import Table

from vioapr.export.exporter import Exporter
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.methods import METHODS
from vioapr.fusion.offline import run_steps
from vioapr.fusion.types import FrameInput, Status
from vioapr.geometry import rigid
from vioapr.geometry.rigid import Rigid3
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.simulation.walks import SimulatedWalk, WalkParams, simulate_walk

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.export.networks import DecodingNetwork, TinySpec, picture_of

EXTENT_M = 40.0
BATCH = 8
"""Equal walks in the NumPy batch."""
_SIZES = ((48, 64), (120, 160), (480, 640), (192, 256))


@dataclass(frozen=True)
class Config:
    """Size of the job."""

    frames: int = 1000
    """Frames of the walk."""
    json: Path | None = None
    """Where to write the results."""
    update_docs: bool = False
    """Put the table into docs/results/localizer.md."""


def compare(method: str, frames: int) -> dict[str, Any]:
    """Largest differences over a walk."""
    chosen = METHODS[method]
    network = DecodingNetwork(TinySpec()).eval()
    exporter = Exporter(network, TinySpec(), chosen, chosen.params_type())
    walk = simulate_walk(WalkParams(duration_s=frames / 2, extent_m=EXTENT_M), seed=0)
    events = draw_events(frames)
    exported = run_file(exporter.export().content, walk, events)
    eager = run_eager(exporter, walk, events)
    inputs = numpy_inputs(walk, events, exported)
    streamed = run_numpy(method, inputs)
    batched = run_batch(method, inputs)
    counts = {s.label: int((exported["status"] == s).sum()) for s in Status}
    others = {"eager PyTorch": eager, "NumPy, streaming": streamed, "NumPy, batched": batched}
    return {
        "statuses": {label: count for label, count in counts.items() if count},
        "extent_m": EXTENT_M,
        "against": {name: differences(exported, other) for name, other in others.items()},
    }


def draw_events(frames: int) -> dict[str, np.ndarray]:
    """Which frames have an image, are tracked, and begin a new tracking world."""
    rng = np.random.default_rng(1)
    return {
        "has_image": rng.random(frames) > 0.15,
        "tracking_ok": rng.random(frames) > 0.01,
        "tracking_reset": rng.random(frames) < 0.004,
    }


def images(walk: SimulatedWalk):
    """A picture a frame."""
    for row in range(len(walk.apr)):
        pose = np.concatenate([walk.apr.position_m[row], walk.apr.quat_xyzw[row]])
        yield picture_of(pose, *_SIZES[row % len(_SIZES)])


def run_file(content: bytes, walk: SimulatedWalk, events: dict[str, np.ndarray]) -> dict:
    """The exported file in onnxruntime."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "localizer.onnx")
        path.write_bytes(content)
        localizer = OnnxLocalizer(path)
    answers = []
    for row, image in enumerate(images(walk)):
        pose = walk.vio.target_from_source.at(row) if events["tracking_ok"][row] else None
        answers.append(
            localizer.update(
                float(walk.gt.timestamp_s[row] - walk.gt.timestamp_s[0]),
                image if events["has_image"][row] else None,
                pose,
                tracking_reset=bool(events["tracking_reset"][row]),
            )
        )
    return {
        "status": np.array([int(one.status) for one in answers]),
        "pose": rigid.stack([one.world_from_cam for one in answers]),
        "apr": rigid.stack([one.apr_world_from_cam for one in answers]),
        "apr_sigma_m": np.array([one.apr_sigma_position_m for one in answers]),
        "apr_sigma_deg": np.array([one.apr_sigma_orientation_deg for one in answers]),
    }


def run_eager(exporter: Exporter, walk: SimulatedWalk, events: dict[str, np.ndarray]) -> dict:
    """The same graph in PyTorch."""
    graph, params = exporter.eager, exporter.fusion.params
    values = [float(getattr(params, name)) for name in exporter.fusion.param_names]
    extra = torch.tensor(values) if values else None
    state = torch.zeros(exporter.fusion.layout.size)
    statuses, poses = [], []
    for row, image in enumerate(images(walk)):
        flags = {name: torch.tensor([float(flag[row])]) for name, flag in events.items()}
        pose = np.concatenate([walk.vio.position_m[row], walk.vio.quat_xyzw[row]])
        seconds = walk.gt.timestamp_s[row] - walk.gt.timestamp_s[0]
        inputs = flags | {
            "vio_from_cam": torch.from_numpy(pose.astype(np.float32)),
            "timestamp_s": torch.tensor([seconds], dtype=torch.float32),
            "state": state,
        }
        inputs |= {f"image_{name}": inputs[name] for name in ("timestamp_s", "vio_from_cam")}
        with torch.no_grad():
            outputs = graph(image=torch.from_numpy(image), **inputs, params=extra)
        state = outputs["next_state"]
        statuses.append(int(outputs["status"][0]))
        poses.append(outputs["world_from_cam"].double().numpy())
    flat = np.array(poses)
    return {"status": np.array(statuses), "pose": Rigid3(flat[:, :3], flat[:, 3:])}


def numpy_inputs(walk: SimulatedWalk, events: dict[str, np.ndarray], found: dict) -> FrameInput:
    """What the graph took in, with its own predictions."""
    apr = found["apr"]
    has_apr = np.isfinite(apr.translation_m[:, 0])
    identity = Rigid3.identity(has_apr.shape)
    vio = Rigid3(
        *(part.astype(np.float32).astype(np.float64) for part in walk.vio.target_from_source)
    )
    return FrameInput(
        walk.gt.timestamp_s - walk.gt.timestamp_s[0],
        rigid.choose(has_apr, apr, identity),
        has_apr,
        vio,
        events["tracking_ok"],
        events["tracking_reset"],
        found["apr_sigma_m"],
        np.deg2rad(found["apr_sigma_deg"]),
    )


def run_numpy(method: str, inputs: FrameInput) -> dict:
    """Frame by frame, as a program would."""
    localizer = Localizer(method)
    answers = []
    for row in range(len(inputs.timestamp_s)):
        frame = inputs.at(row)
        answers.append(
            localizer.update(
                float(frame.timestamp_s),
                frame.apr_world_from_cam if frame.has_apr else None,
                frame.vio_from_cam,
                bool(frame.tracking_ok),
                tracking_reset=bool(frame.tracking_reset),
                apr_sigma_m=float(frame.apr_sigma_m),
                apr_sigma_deg=float(np.rad2deg(frame.apr_sigma_rad)),
            )
        )
    return {
        "status": np.array([int(one.status) for one in answers]),
        "pose": rigid.stack([one.world_from_cam for one in answers]),
    }


def run_batch(method: str, inputs: FrameInput) -> dict:
    """Many copies at once; the last one's answers."""
    chosen = METHODS[method]

    def repeat(values: np.ndarray) -> np.ndarray:
        return np.repeat(values[:, None], BATCH, axis=1)

    batch = FrameInput(
        *(Rigid3(*map(repeat, v)) if isinstance(v, Rigid3) else repeat(v) for v in inputs)
    )
    estimate = run_steps(chosen, chosen.params_type(), batch)
    return {"status": estimate.status[:, -1], "pose": estimate.world_from_cam.at((slice(None), -1))}


def differences(left: dict, right: dict) -> dict[str, float]:
    """Of statuses, and of the poses where there are any."""
    known = (left["status"] != 0) & (right["status"] != 0)
    moved = np.linalg.norm(left["pose"].translation_m - right["pose"].translation_m, axis=1)
    turned = rigid.angle_deg(left["pose"], right["pose"])
    return {
        "differing_statuses": int((left["status"] != right["status"]).sum()),
        "frames_with_pose": int(known.sum()),
        "max_m": float(moved[known].max()),
        "median_m": float(np.median(moved[known])),
        "max_of_extent": float(moved[known].max() / EXTENT_M),
        "max_deg": float(turned[known].max()),
    }


def main(config: Config) -> None:
    """Compare both methods and print a table."""
    torch.set_num_threads(1)
    results = {name: compare(name, config.frames) for name in ("vio-apr", "chain")}
    table = Table(title=f"onnxruntime against others, {config.frames} frames")
    for column in ("method", "against", "statuses differ", "max m", "of the extent", "max deg"):
        table.add_column(column, justify="right")
    for name, result in results.items():
        for other, found in result["against"].items():
            table.add_row(
                name,
                other,
                str(found["differing_statuses"]),
                f"{found['max_m']:.1e}",
                f"{found['max_of_extent']:.1e}",
                f"{found['max_deg']:.1e}",
            )
    publish(table, "localizer.md", "equality", update_docs=config.update_docs)
    for name, result in results.items():
        print(name, result["statuses"])
    if config.json is not None:
        machine = describe_machine(["numpy", "torch", "onnxruntime"])
        write_json(config.json, {"machine": machine, "frames": config.frames, "methods": results})


if __name__ == "__main__":
    main(tyro.cli(Config, description=__doc__))
