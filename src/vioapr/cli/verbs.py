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
    "Files of a walk": {
        "inspect": Verb("inspect", "inspect", "Say what a trajectory file is, and what is wrong"),
        "convert": Verb("convert", "convert", "Convert a trajectory file to another format"),
        "fuse": Verb("fuse", "fuse", "Fuse a walk's predicted poses with its tracked ones"),
        "evaluate": Verb("evaluate", "evaluate", "Compare fused walks with ground truth"),
        "calibrate": Verb(
            "calibrate", "calibrate", "Measure tracker and regressor for method chain"
        ),
        "vio-quality": Verb("vio_quality", "vio_quality", "Measure a tracker's drift"),
    },
    "A place": {
        "import": Verb("import_", "import_", "Import a capture or data set into a scene"),
        "scene check": Verb("scene", "scene_check", "Verify every file and image of a scene"),
        "scene info": Verb(
            "scene", "scene_info", "Print what scenes hold: images, extents, speeds"
        ),
        "scene anonymize": Verb("scene", "scene_anonymize", "Blur the faces in a scene's images"),
        "map": Verb("map_scene", "map_", "Make a metric, upright map and ground truth"),
    },
    "A localizer of the place": {
        "build": Verb("build", "build", "Check, map, fit, measure and export in one go"),
        "train": Verb("train", "train", "Train a pose regressor on recordings of scenes"),
        "predict": Verb("predict", "predict", "Predict the poses of a scene's images"),
    },
    "An app": {
        "export": Verb("export", "export", "Write regressor and fusion as one ONNX file"),
        "localize": Verb("localize", "localize_", "Localize a recorded walk with an exported file"),
        "serve": Verb("serve", "serve_", "Take a phone's captures, give it localizers"),
        "overlay": Verb("overlay", "overlay", "Draw content of the map into a walk's pictures"),
        "bench": Verb("bench", "bench_", "Measure an exported file: latency, memory, energy"),
    },
    "Without data of your own": {
        "demo": Verb("demo", "demo", "Localize a walk from its pictures, open the report"),
        "simulate courtyard": Verb(
            "simulate", "simulate_courtyard", "Render a courtyard and walks through it: a scene"
        ),
        "simulate walks": Verb("simulate", "simulate_walks", "Simulate walks without images"),
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
"""The verbs by what they are for, in the order of the work."""

VERBS: dict[str, Verb] = {name: verb for group in GROUPS.values() for name, verb in group.items()}

FAMILIES: frozenset[str] = frozenset(name.split()[0] for name in VERBS if " " in name)
"""First words of the verbs of two words."""

USAGE = "usage: vioapr VERB [FLAGS]"
_ABOUT = """Robust absolute poses from a pose regressor and a phone's visual-inertial
odometry: predicted and tracked poses in, a pose for every frame out."""
_MORE = """vioapr VERB --help    explain a verb and its flags (as vioapr help VERB)
vioapr --version      print the version

The file - is standard input or output. Exit codes: 0 done; 2 something that
you can mend, said in one line; 130 interrupted; 1 a fault of ours.
COLUMNS, NO_COLOR and TERM=dumb are respected."""


def describe_verbs() -> str:
    """Compose the help of the whole command line: the verbs by group, a line each."""
    column = max(map(len, VERBS)) + 4
    parts = [
        "\n".join([f"{title}:", *(_line(name, column) for name in verbs)])
        for title, verbs in GROUPS.items()
    ]
    return "\n\n".join([USAGE, _ABOUT, *parts, _MORE])


def describe_family(family: str) -> str:
    """Compose the help of the verbs that begin with a word: theirs alone."""
    names = [name for name in VERBS if name.split()[0] == family]
    column = max(map(len, names)) + 4
    usage = f"usage: vioapr {family} {{{','.join(name.split()[1] for name in names)}}} [FLAGS]"
    lines = "\n".join(_line(name, column) for name in names)
    return f"{usage}\n\n{lines}\n\nvioapr {family} VERB --help explains a verb and its flags."


def _line(name: str, column: int) -> str:
    return f"  {name}".ljust(column) + VERBS[name].summary
