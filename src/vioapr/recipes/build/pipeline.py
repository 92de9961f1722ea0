"""The whole build: check → map → localizers, then the page.

Every step is kept when it is done, and a killed one goes on. A step is done again if its inputs
changed, or if one before it in its chain was; `vioapr.work.steps` keeps that. Within a step,
mapping, training and prediction go on where they were.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import vioapr
from vioapr.errors import AlreadyExistsError, FormatError, MissingExtraError
from vioapr.evaluation.view_coverage import SECTORS, Coverage, find_gaps, measure_coverage
from vioapr.files.atomic import write_atomically
from vioapr.files.text import write_text
from vioapr.mapping.params import MappingParams
from vioapr.recipes.build.advice import advise, describe_gap
from vioapr.recipes.build.inputs import (
    fingerprint_gt,
    fingerprint_scene,
    ids_of,
    needs_map,
    views_of_split,
)
from vioapr.recipes.build.localizer import LocalizerSteps, badness
from vioapr.recipes.build.params import BuildParams
from vioapr.recipes.build.running import BUILD_FOLDER, STEPS_FOLDER, Runner
from vioapr.report.build_report import write_build_report
from vioapr.scene.check import check_scene, count_frames
from vioapr.scene.scene import Scene
from vioapr.scene.walks import APR_PREFIX
from vioapr.schemas.base import encode
from vioapr.schemas.build import (
    BuildSummary,
    BuiltLocalizer,
    CheckedScene,
    CoverageRecord,
    GapRecord,
    MappedScene,
)
from vioapr.work.locks import locked_folder
from vioapr.work.progress import Progress

SUMMARY_FILE, LOCALIZER_FILE = "build.json", "localizer.onnx"


def build(
    folder: Path, params: BuildParams, progress: Progress, say: Callable[[str], object]
) -> BuildSummary:
    """Build a localizer of a scene; go on where an earlier call was stopped.

    Args:
        folder: The scene's.
        params: What is built.
        progress: Opened for every part that takes time.
        say: Called with a line on every step.

    Returns:
        What was built; also in `build/build.json` and on the page `build/index.html`.

    Raises:
        FormatError: The scene has faults; the message names the first.
        AlreadyExistsError: `build/` holds something that is not of a build.
        MissingExtraError: A package that some step needs is not installed.
        LockedError: Another process builds the scene.
        VioAprError: A step cannot be done; those before it are kept.
    """
    scene = Scene.open(folder)
    own = folder / BUILD_FOLDER
    is_free = not own.exists() or (own.is_dir() and not any(own.iterdir()))
    if not is_free and not (own / STEPS_FOLDER).is_dir():
        raise AlreadyExistsError(own, "expected a folder of an earlier build, or none: move it")
    require_packages(scene)
    with locked_folder(own / STEPS_FOLDER):
        return _Build(scene, params, Runner(own, progress, say)).run()


def require_packages(scene: Scene) -> None:
    """See that the packages of all steps are there, before hours of work for the last one.

    Raises:
        MissingExtraError: One is not.
        ParameterError: See `needs_map`.
    """
    needed = {"torch": "train", "onnx": "export", "onnxscript": "export"}
    if needs_map(scene):
        needed["pycolmap"] = "mapping"
    for package, extra in needed.items():
        if find_spec(package) is None:
            raise MissingExtraError("vioapr build", package, extra)


@dataclass(eq=False)
class _Build:
    """One build: the steps that every localizer needs, the localizers, and the page."""

    scene: Scene
    params: BuildParams
    runner: Runner

    @property
    def own(self) -> Path:
        """The build's folder."""
        return self.runner.own

    def run(self) -> BuildSummary:
        """Do all steps that are not done; the page is written after every localizer."""
        steps, content = self.runner.chain(), fingerprint_scene(self.scene.folder)
        checked = self.runner.step(steps, "check", content, self._check, CheckedScene)
        mapped = self.runner.step(steps, "map", [], self._map, MappedScene)
        self.scene = Scene.open(self.scene.folder)  # mapping said more of the world
        inputs = [content, fingerprint_gt(self.scene)]
        first, *others = self.params.models
        localizers = [LocalizerSteps(self.scene, self.params, first, self.runner).run(inputs)]
        summary = self._publish(checked, mapped, localizers)
        for model in others:  # meanwhile the first one can be used
            made = LocalizerSteps(self.scene, self.params, model, self.runner).run(inputs)
            localizers.append(made)
            # Where nothing is known of any, what was to be better is taken.
            newest_first = list(reversed(localizers))
            summary = self._publish(checked, mapped, sorted(newest_first, key=badness))
        return summary

    def _check(self, is_resumed: bool) -> CheckedScene:
        folder = self.scene.folder
        with self.runner.progress("checking the scene", count_frames(folder)) as tick:
            report = check_scene(folder, tick=tick)
        if report.errors:
            more = f" (and {len(report.errors) - 1} more)" if report.errors[1:] else ""
            raise FormatError(
                folder, f"{report.errors[0]}{more}: vioapr scene check {folder} lists what is wrong"
            )
        return CheckedScene(
            recordings=report.recordings,
            frames=report.frames,
            images=report.images,
            notes=tuple(str(problem) for problem in report.problems),
        )

    def _map(self, is_resumed: bool) -> MappedScene:
        if not needs_map(self.scene):
            return MappedScene(is_mapped=False)
        from vioapr.mapping.pipeline import map_scene
        from vioapr.report.map_report import FIGURES, write_map_report

        summary = map_scene(self.scene, MappingParams(), self.runner.progress)
        with self.runner.progress("drawing the map", FIGURES) as tick:
            write_map_report(Scene.open(self.scene.folder), summary, tick)
        facts = summary.recordings.values()
        return MappedScene(
            is_mapped=True,
            registered=sum(one.registered for one in facts),
            images=sum(one.images for one in facts),
            points=summary.model.points,
        )

    def _publish(
        self, checked: CheckedScene, mapped: MappedScene, localizers: Sequence[BuiltLocalizer]
    ) -> BuildSummary:
        """Put the best localizer, which is the first, where it is found, and write the page."""
        best = localizers[0]
        write_atomically(self.own / LOCALIZER_FILE, (self.own / best.file).read_bytes())
        train, test = (views_of_split(self.scene, split) for split in ("train", "test"))
        coverage = measure_coverage([*train.values()], [*test.values()])
        record = to_coverage_record(coverage)
        has_compass = self.scene.world.origin is not None
        tests = max((one.walks for one in best.accuracy), default=0)
        summary = BuildSummary(
            scene=self.scene.name,
            vioapr=vioapr.__version__,
            checked=checked,
            mapped=mapped,
            localizers=tuple(localizers),
            coverage=record,
            advice=tuple(advise(mapped, best, record, train=len(train), tests=tests)),
            areas=tuple(describe_gap(gap, has_compass=has_compass) for gap in record.gaps),
            seconds=dict(self.runner.seconds),
        )
        with self.runner.progress("writing the report", 1) as tick:
            write_build_report(
                self.own, summary, coverage, train, test,
                has_compass=has_compass, commands=self._commands(best),
            )  # fmt: skip
            write_text(self.own / SUMMARY_FILE, encode(summary))
            tick()
        return summary

    def _commands(self, best: BuiltLocalizer) -> list[str]:
        """What to do with the localizer, as commands."""
        id_ = ids_of(self.scene)[-1]  # one to test with, if there is any
        model, recording = self.own / LOCALIZER_FILE, self.scene.recording_folder(id_)
        commands = [
            [
                "vioapr",
                "localize",
                "--model",
                model,
                "--recording",
                recording,
                "--out",
                "fused.csv",
            ],
            ["vioapr", "overlay", recording, "--poses", "fused.csv", "--out", "overlay.png"],
        ]
        name = best.model.replace(":", "-")
        raw = self.own / "walks" / name / id_ / f"{APR_PREFIX}{name}.tum"
        if raw.exists():
            commands[1] += ["--raw", raw]
        return [shlex.join(map(str, words)) for words in commands]


def to_coverage_record(coverage: Coverage) -> CoverageRecord:
    """Sum coverage up for programs and people."""
    return CoverageRecord(
        cell_m=coverage.cell_m,
        cells=len(coverage.cell),
        all_round=coverage.all_round,
        one_way=coverage.one_way,
        one_walk=coverage.one_walk,
        gaps=tuple(
            GapRecord(
                position_m=(float(gap.position_m[0]), float(gap.position_m[1])),
                radius_m=gap.radius_m,
                headings_deg=tuple(sector * 360 / SECTORS for sector in gap.sectors),
                asked=gap.asked,
            )
            for gap in find_gaps(coverage)
        ),
    )
