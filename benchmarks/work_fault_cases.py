"""The verbs that `work_faults.py` harms: toy scenes, commands, and what must survive."""

from __future__ import annotations

import functools
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from vioapr.formats import sevenscenes
from vioapr.recipes.demo import unpack_demo
from vioapr.regression.checkpoint import load_tensors, save_regressor
from vioapr.regression.networks import build
from vioapr.scene.scene import Scene
from vioapr.scene.walks import write_walk
from vioapr.schemas.base import decode
from vioapr.schemas.map_summary import MapSummary
from vioapr.schemas.regressor import RegressorHeader, RegressorSpec, StateHeader
from vioapr.simulation.rooms import make_box_scene, make_room_scene, stand_about
from vioapr.simulation.walks import WalkParams, simulate_walk
from vioapr.work.steps import read_marker

Content = dict[str, bytes]
EARLIER = b"an earlier result"

MAP_FLAGS = (
    "--max-features=400", "--sequential=4", "--spatial=2", "--loops=4", "--threads=1",
)  # fmt: skip
TRAIN_FLAGS = (
    "--model=mobile", "--resize=36", "--crop=32", "--batch-size=8", "--lr=1e-3", "--epochs=6",
    "--checkpoint-minutes=0",
)  # fmt: skip


@dataclass
class Places:
    """A trial's folder.

    Attributes:
        folder: It, with copies of what the verb needs.
        before: All files in it before the verb ran.
        wanted: The result of a run without fault.
    """

    folder: Path
    before: Content = field(default_factory=dict)
    wanted: Content = field(default_factory=dict)


@dataclass(frozen=True)
class Mistake:
    """A command that is pointed at files that are not its own.

    Attributes:
        name: For people.
        words: Makes the place, and gives the command.
        left: What is on disk then.
        says: What the verb says if it succeeds all the same; "" if it must refuse.
    """

    name: str
    words: Callable[[Places], list[object]]
    left: str = "all as before"
    says: str = ""

    @property
    def succeeds(self) -> bool:
        """Whether the verb finds another way."""
        return bool(self.says)


@dataclass(frozen=True)
class Case:
    """A verb to be harmed.

    Attributes:
        verb: Its name.
        prepare: Makes what it needs in a folder.
        words: The command.
        result: What it makes, to be compared.
        finished: What is finished, so that it must not be done again.
        left: What is on disk after a fault.
        again_words: The command to go on with, where it is another.
        is_killed: Whether it is killed at random moments.
        is_locked: Whether a folder takes one at a time.
        spare_kb: Space that is too little for it.
        mistakes: Of people.
    """

    verb: str
    prepare: Callable[[Path], None]
    words: Callable[[Places], list[object]]
    result: Callable[[Places], Content]
    left: str
    finished: Callable[[Places], set[object]] = lambda places: set()
    again_words: Callable[[Places], list[object]] | None = None
    is_killed: bool = False
    is_locked: bool = False
    spare_kb: int = 8
    mistakes: tuple[Mistake, ...] = ()

    def again(self, places: Places) -> list[object]:
        """The command to go on with."""
        return (self.again_words or self.words)(places)

    def expected(self, places: Places) -> Content:
        """The result of a run without fault."""
        return places.wanted

    def is_kept(self, places: Places) -> bool:
        """Whether all files from before are there as they were, or whole and new."""
        now, new = visible_files(places.folder), self.result(places)
        return all(
            now.get(path) == content or (path in new and new[path] == places.wanted.get(path))
            for path, content in places.before.items()
        )


@contextmanager
def make_places(
    case: Case, wanted: Content | None = None, root: Path | None = None
) -> Iterator[Places]:
    """A folder for a trial, with copies of what the case needs."""
    with tempfile.TemporaryDirectory(dir=root) as name:
        folder = Path(name) / "trial"
        shutil.copytree(prototype(case.verb, case.prepare), folder)
        yield Places(folder, visible_files(folder), wanted or {})


@functools.cache
def prototype(verb: str, prepare: Callable[[Path], None]) -> Path:
    """What a case needs, made once."""
    folder = Path(tempfile.mkdtemp(prefix="vioapr-faults-")) / verb
    folder.mkdir()
    prepare(folder)
    return folder


def visible_files(folder: Path) -> Content:
    """All files but those whose names, or whose folders' names, begin with a dot."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    shown = (path for path in paths if not any(part.startswith(".") for part in path.parts))
    return {path.as_posix(): (folder / path).read_bytes() for path in shown}


def files_at(*patterns: str) -> Callable[[Places], Content]:
    """A result that is files."""

    def result(places: Places) -> Content:
        chosen = {
            path.relative_to(places.folder).as_posix()
            for pattern in patterns
            for path in places.folder.glob(pattern)
        }
        return {name: text for name, text in visible_files(places.folder).items() if name in chosen}

    return result


def prepare_map(folder: Path) -> None:
    """A room, and a file of the user's where the map goes."""
    make_room_scene(folder / "scene")
    (folder / "scene" / "map").mkdir()
    (folder / "scene" / "map" / "notes.txt").write_bytes(EARLIER)


def finished_steps(places: Places) -> set[object]:
    """Steps of mapping: after a whole run, those that it found done."""
    path = places.folder / "scene" / "map" / "map.json"
    if path.exists():
        return set(decode(path, path.read_text(), MapSummary).reused_steps)
    markers = (places.folder / "scene" / ".mapping").glob("*.step.json")
    return {path.name.split(".")[0] for path in markers if (m := read_marker(path)) and m.is_done}


def prepare_train(folder: Path) -> None:
    """A box with two walks."""
    make_box_scene(folder / "scene", train=1, test=1, frames=40)


def trained(places: Places) -> Content:
    """The weights."""
    path = places.folder / "run" / "regressor.safetensors"
    if not path.exists():
        return {}
    tensors = load_tensors(path, RegressorHeader)[0]
    return {name: value.numpy().tobytes() for name, value in tensors.items()}


def finished_training_steps(places: Places) -> set[object]:
    """Numbers of the training's steps whose state is kept; reading it fails if it is torn."""
    path = places.folder / "run" / "state.safetensors"
    if not path.exists():
        return set()
    header = load_tensors(path, StateHeader)[1]
    steps = 5 * len(header.epochs) + (header.begun.steps if header.begun else 0)
    return set(range(steps))


def train_again(places: Places) -> list[object]:
    """With --resume, if there is a state."""
    has_state = (places.folder / "run" / "state.safetensors").exists()
    return ["train", "scene", *TRAIN_FLAGS, "--out", "run", *(["--resume"] if has_state else [])]


def prepare_import(folder: Path) -> None:
    """Three sequences in the layout of 7-Scenes."""
    rng = np.random.default_rng(0)
    for number in (1, 2, 3):
        sequence = folder / "source" / f"seq-{number:02d}"
        sevenscenes.write(sequence, stand_about(60, number))
        for row in range(60):
            pixels = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(sequence / f"frame-{row:06d}.color.png")
    (folder / "source" / "TrainSplit.txt").write_text("sequence1\nsequence2\n")
    (folder / "source" / "TestSplit.txt").write_text("sequence3\n")


def imported_recordings(places: Places) -> set[object]:
    """Recordings that are whole, told by their very files: none may be made again."""
    tables = (places.folder / "scene" / "recordings").glob("[!.]*/frames.csv")
    return {(path.parent.name, path.stat().st_ino, path.stat().st_mtime_ns) for path in tables}


def prepare_localize(folder: Path) -> None:
    """The demo's localizer, the first 80 frames of its walk, and an earlier result."""
    demo = unpack_demo(folder / "demo")
    table = demo.recording / "frames.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:81]))
    shutil.rmtree(demo.recording.parents[1] / "gt")
    (folder / "fused.csv").write_bytes(EARLIER)


def prepare_predict(folder: Path) -> None:
    """A box with three test walks, and two untrained regressors."""
    make_box_scene(folder / "scene", train=1, test=3, frames=60)
    spec = RegressorSpec("mobile", ("Box",), "6d", 64, 64)
    for seed, name in enumerate(("model", "other")):
        torch.manual_seed(seed)
        save_regressor(folder / f"{name}.safetensors", build(spec), spec)


def predicted_recordings(places: Places) -> set[object]:
    """Recordings whose predictions are whole, told by their very files."""
    tables = (places.folder / "walks").glob("*/apr_mobile.sigma.csv")
    return {(path.parent.name, path.stat().st_ino, path.stat().st_mtime_ns) for path in tables}


def prepare_export(folder: Path) -> None:
    """An untrained regressor, and an earlier result."""
    prepare_predict(folder)
    shutil.rmtree(folder / "scene")
    (folder / "localizer.onnx").write_bytes(EARLIER)


def prepare_files(folder: Path) -> None:
    """A simulated walk, and files of the user's in the way."""
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    write_walk(folder / "walk", gt=walk.gt, vios={"sim": walk.vio}, aprs={"net": walk.apr})
    (folder / "fused.csv").write_bytes(EARLIER)
    (folder / "site").mkdir()
    (folder / "site" / "index.html").write_bytes(EARLIER)
    (folder / "demo").mkdir()
    (folder / "demo" / "localizer.onnx").write_bytes(EARLIER)


FUSE = ["fuse", "--apr", "walk/apr_net.tum", "--vio", "walk/vio_sim.tum", "--method", "vio-apr"]


def fuse_onto_a_link(places: Places) -> list[object]:
    """Onto a hard link of its input."""
    (places.folder / "linked").hardlink_to(places.folder / "walk" / "vio_sim.tum")
    places.before = visible_files(places.folder)
    return [*FUSE, "--out", "linked", "--overwrite"]


def map_over_foreign_gt(*flags: str) -> Callable[[Places], list[object]]:
    """With ground truth from a simulator in the scene."""

    def words(places: Places) -> list[object]:
        scene = Scene.open(places.folder / "scene")
        scene.write_gt("a", stand_about(8, 1), "simulator")
        return ["map", "scene", *MAP_FLAGS, *flags]

    return words


def train_over_a_run(places: Places) -> list[object]:
    """Into a folder with another run's regressor."""
    (places.folder / "run").mkdir()
    (places.folder / "run" / "regressor.safetensors").write_bytes(EARLIER)
    return ["train", "scene", *TRAIN_FLAGS, "--out", "run"]


def predict_over_another_model(places: Places) -> list[object]:
    """With the same name as another model's predictions."""
    import vioapr.cli

    words = ["predict", "scene", "--model", "model.safetensors", "--out", "walks"]
    paths = [str(places.folder / word) for word in ("scene", "model.safetensors", "walks")]
    code = vioapr.cli.main(["predict", paths[0], "--model", paths[1], "--out", paths[2]])
    assert code == 0
    words[3] = "other.safetensors"
    return words


CASES = (
    Case(
        "map", prepare_map, lambda places: ["map", "scene", *MAP_FLAGS],
        files_at("scene/gt/*.tum", "scene/map/*.bin", "scene/map/notes.txt"),
        "finished steps in .mapping/, the map and ground truth from before, files of the user",
        finished_steps, is_killed=True, is_locked=True, spare_kb=400,
        mistakes=(
            Mistake("ground truth of a simulator", map_over_foreign_gt(),
                    "gt/ and scene.toml as before; the map's ground truth in map/gt/",
                    "the ground truth in gt/ of a is not mapping's and was kept"),
            Mistake("the same, --replace-gt", map_over_foreign_gt("--replace-gt"),
                    "the map's ground truth in gt/; what was there in gt.backup-1/",
                    "the ground truth that was replaced is in gt.backup-1/"),
        ),
    ),
    Case(
        "train", prepare_train, lambda places: ["train", "scene", *TRAIN_FLAGS, "--out", "run"],
        trained, "the state of the last checkpoint, the best regressor of whole epochs",
        finished_training_steps, train_again, is_killed=True, is_locked=True, spare_kb=9000,
        mistakes=(Mistake("another run's regressor in the folder", train_over_a_run),),
    ),
    Case(
        "import", prepare_import,
        lambda places: ["import", "7scenes", "source", "--out", "scene", "--place", "indoor"],
        files_at("scene/scene.toml", "scene/gt/*", "scene/recordings/*/*.*",
                 "scene/recordings/*/images/*"),
        "whole recordings", imported_recordings, is_killed=True, is_locked=True, spare_kb=600,
    ),
    Case(
        "localize", prepare_localize,
        lambda places: ["localize", "--model", "demo/localizer.onnx", "--recording",
                        "demo/courtyard/recordings/test-01", "--out", "fused.csv", "--overwrite"],
        files_at("fused.csv"), "the earlier result, whole", is_killed=True, spare_kb=4,
    ),
    Case(
        "predict", prepare_predict,
        lambda places: ["predict", "scene", "--model", "model.safetensors", "--out", "walks"],
        files_at("walks/*/*.*"), "predictions of finished recordings", predicted_recordings,
        is_locked=True, spare_kb=24,
        mistakes=(Mistake("predictions of another model", predict_over_another_model),),
    ),
    Case(
        "export", prepare_export,
        lambda places: ["export", "model.safetensors", "--out", "localizer.onnx", "--overwrite"],
        files_at("localizer.onnx"), "the earlier result, whole", spare_kb=1000,
    ),
)  # fmt: skip

FILE_CASES = (
    Case("fuse", prepare_files, lambda places: FUSE, files_at("fused.csv"), "", mistakes=(
        Mistake("--out is an input", lambda places: [
            *FUSE, "--out", "walk/apr_net.tum", "--overwrite"]),
        Mistake("--out is a hard link of an input", fuse_onto_a_link),
        Mistake("--out exists", lambda places: [*FUSE, "--out", "fused.csv"]),
        Mistake("--out and --tum are one file", lambda places: [
            *FUSE, "--out", "new", "--tum", "new"]),
    )),
    Case("convert", prepare_files, lambda places: [], files_at("fused.csv"), "", mistakes=(
        Mistake("OUT is IN", lambda places: [
            "convert", "walk/gt.tum", "walk/gt.tum", "--overwrite"]),
    )),
    Case("evaluate", prepare_files, lambda places: [], files_at("fused.csv"), "", mistakes=(
        Mistake("--csv is an input", lambda places: [
            "evaluate", "walk", "--csv", "walk/gt.tum", "--overwrite"]),
        Mistake("a page of the user's in the report's folder", lambda places: [
            "evaluate", "walk", "--report", "site"]),
    )),
    Case("demo", prepare_files, lambda places: [], files_at("fused.csv"), "", mistakes=(
        Mistake("a file of the user's in its folder", lambda places: ["demo", "--out", "demo"]),
    )),
)  # fmt: skip
"""Verbs that are only pointed at files."""
