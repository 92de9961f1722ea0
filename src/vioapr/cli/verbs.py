"""The table of verbs: where each is and what it does, so that help needs to import none of them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple


class Verb(NamedTuple):
    """A verb of the command line.

    Attributes:
        module: The module within `vioapr.cli` that has its function.
        function: The function's name: its parameters are the verb's flags.
        summary: What it does, short enough for a line of 80 columns.
    """

    module: str
    function: str
    summary: str

    def load(self) -> Callable[..., None]:
        """Import the verb's function, with everything that it needs."""
        return getattr(import_module(f"vioapr.cli.{self.module}"), self.function)


GROUPS: dict[str, dict[str, Verb]] = {
    "Trajectory files": {
        "inspect": Verb("inspect", "inspect", "Say what a trajectory file is and what looks wrong"),
        "convert": Verb("convert", "convert", "Convert a trajectory file to another format"),
    },
    "Fusion and evaluation": {
        "fuse": Verb("fuse", "fuse", "Fuse a walk's predicted poses with its tracked ones"),
        "evaluate": Verb(
            "evaluate", "evaluate", "Compare fused walks with ground truth: tables, figures"
        ),
        "vio-quality": Verb(
            "vio_quality", "vio_quality", "Compare a tracker with ground truth: drift, divergence"
        ),
    },
    "Scenes and maps": {
        "import": Verb("import_", "import_", "Import a capture or data set into a scene"),
        "scene check": Verb("scene", "scene_check", "Verify every file, line and image of a scene"),
        "scene info": Verb(
            "scene", "scene_info", "Print what scenes hold: images, extents, walking speeds"
        ),
        "map": Verb("map_scene", "map_", "Make a metric, gravity-aligned map and ground truth"),
    },
    "Pose regressors": {
        "train": Verb("train", "train", "Train a pose regressor on recordings of scenes"),
        "predict": Verb("predict", "predict", "Predict the poses of a scene's images"),
    },
    "One file for phones": {
        "export": Verb("export", "export", "Write regressor and fusion as one ONNX file"),
        "localize": Verb("localize", "localize_", "Localize a recorded walk with an exported file"),
        "bench": Verb("bench", "bench_", "Measure an exported file: latency, memory, size, energy"),
    },
    "Without data of your own": {
        "demo": Verb("demo", "demo", "Localize a walk from its pictures and open the report"),
        "simulate courtyard": Verb(
            "simulate", "simulate_courtyard", "Render a courtyard and walks through it, as a scene"
        ),
        "simulate walks": Verb(
            "simulate", "simulate_walks", "Simulate walks without images: truth, VIO, predictions"
        ),
    },
    "Published results": {
        "reproduce marvin": Verb(
            "reproduce", "reproduce_marvin", "The paper's Tables 2-5 beside the printed figures"
        ),
        "reproduce 7scenes": Verb(
            "reproduce", "reproduce_7scenes", "Raw medians on 7-Scenes beside published ones"
        ),
        "reproduce cambridge": Verb(
            "reproduce", "reproduce_cambridge", "Raw medians on Cambridge beside published ones"
        ),
    },
}
"""The verbs by what they are for, in the order of the help."""

VERBS: dict[str, Verb] = {name: verb for group in GROUPS.values() for name, verb in group.items()}


def describe_verbs(prefix: str = "") -> str:
    """List the verbs by group, a line each.

    Args:
        prefix: First word of the verbs to list; by default all are.
    """
    column = max(map(len, VERBS)) + 4
    parts = []
    for title, verbs in GROUPS.items():
        listed = [
            f"  {name}".ljust(column) + verb.summary
            for name, verb in verbs.items()
            if prefix in ("", name.split()[0])
        ]
        if listed:
            parts.append("\n".join([f"{title}:", *listed]))
    return "\n\n".join(parts)
