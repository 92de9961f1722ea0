"""One localizer of a build: fit → predict → calibrate → evaluate → export."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from vioapr.evaluation.tables import to_records
from vioapr.evaluation.view_coverage import measure_coverage
from vioapr.files.atomic import write_atomically
from vioapr.fusion.calibrated import find_pair, params_from_calibration, read_calibration
from vioapr.fusion.chain.method import METHOD as CHAIN
from vioapr.recipes.build.fitting import fit
from vioapr.recipes.build.inputs import views_of_split
from vioapr.recipes.build.judging import (
    Calibrated,
    calibrate_tests,
    evaluate_tests,
    is_worth_it,
    load_tests,
    measure_support,
    predict_tests,
)
from vioapr.recipes.build.params import BuildParams
from vioapr.recipes.build.running import Runner
from vioapr.report.build_report import EVALUATION_FOLDER
from vioapr.report.evaluation_report import count_report_ticks, write_report
from vioapr.scene.scene import Scene
from vioapr.schemas.base import Record
from vioapr.schemas.build import AccuracyRecord, BuiltLocalizer, SupportRecord
from vioapr.schemas.calibration import LeftOut
from vioapr.schemas.results import GroupRecord
from vioapr.work.progress import Progress

T = TypeVar("T")


class Evaluated(Record, frozen=True):
    """The result of the step that evaluates.

    Attributes:
        accuracy: Tables.
        support: Errors by the number of training images from near.
    """

    accuracy: tuple[AccuracyRecord, ...] = ()
    support: tuple[SupportRecord, ...] = ()


@dataclass(eq=False)
class LocalizerSteps:
    """The steps from a scene with ground truth to the file that phones run.

    Attributes:
        scene: With ground truth.
        params: What is built.
        model: The regressor, as `vioapr train` calls it.
        runner: Runs the steps.
    """

    scene: Scene
    params: BuildParams
    model: str
    runner: Runner

    @property
    def name(self) -> str:
        """The regressor's name in names of files."""
        return self.model.replace(":", "-")

    @property
    def progress(self) -> Progress:
        """Shows how far a step has come."""
        return self.runner.progress

    @property
    def regressor(self) -> Path:
        """The folder of the fitted regressor."""
        return self.runner.own / "models" / self.name

    @property
    def walks(self) -> Path:
        """The folder of its predictions."""
        return self.runner.own / "walks" / self.name

    @property
    def calibration(self) -> Path:
        """The file of its calibration."""
        return self.runner.own / f"{self.name}.calibration.toml"

    @property
    def file(self) -> Path:
        """The exported localizer."""
        return self.runner.own / f"{self.name}.onnx"

    def run(self, scene_inputs: object) -> BuiltLocalizer:
        """Do all steps that are not done.

        Args:
            scene_inputs: Changes with the scene's images and their poses.
        """
        steps = self.runner.chain(self.name)

        def step(name: str, inputs: object, work: Callable[[bool], T], result_type: type[T]) -> T:
            return self.runner.step(steps, name, inputs, work, result_type, of=self.model)

        step("fit", [scene_inputs, self.params.inputs_of(self.model)], self._fit, str)
        ids = step("predict", [], self._predict, list[str])
        calibrated = step("calibrate", [], lambda _: self._calibrate(ids), Calibrated)
        evaluated = step("evaluate", [], lambda _: self._evaluate(ids), Evaluated)
        size = step("export", [], lambda _: self._export(calibrated.left_out), int)
        return BuiltLocalizer(
            model=self.model,
            file=self.file.name,
            bytes=size,
            accuracy=evaluated.accuracy,
            support=evaluated.support,
            left_out=calibrated.left_out,
            is_calibrated=is_worth_it(calibrated.left_out),
            why_not=calibrated.why_not,
        )

    def _fit(self, is_resumed: bool) -> str:
        fit(
            self.scene, self.params, self.model, self.regressor, self.progress,
            is_resumed=is_resumed,
        )  # fmt: skip
        return self.model

    def _predict(self, is_resumed: bool) -> list[str]:
        if not self.scene.splits.get("test"):
            return []
        return predict_tests(self.scene, self.regressor, self.name, self.walks, self.progress)

    def _calibrate(self, ids: list[str]) -> Calibrated:
        if not ids:
            return Calibrated(why_not="it takes two test walks or more")
        cases = load_tests(self.walks, ids, self.name, self.progress)
        return calibrate_tests(cases, self.calibration, self.progress)

    def _evaluate(self, ids: list[str]) -> Evaluated:
        if not ids:
            return Evaluated()
        cases = load_tests(self.walks, ids, self.name, self.progress)
        groups = evaluate_tests(cases, self.progress)
        with self.progress("drawing figures", count_report_ticks(groups)) as tick:
            folder = self.runner.own / EVALUATION_FOLDER / self.name
            title = f"{self.scene.name}: test recordings, {self.model}"
            write_report(groups, folder, title=title, view="live", tick=tick)
        train = views_of_split(self.scene, "train")
        support = measure_support(groups, train, measure_coverage([*train.values()]).cell_m)
        return Evaluated(tuple(map(to_accuracy, to_records(groups))), tuple(support))

    def _export(self, left_out: LeftOut | None) -> int:
        """Write the file that phones run; returns its size."""
        from vioapr.export.exporter import Exporter
        from vioapr.regression import checkpoint

        params = CHAIN.params_type()
        if is_worth_it(left_out):
            pair = find_pair(read_calibration(self.calibration))
            params = params_from_calibration(pair.setting)
        loaded = checkpoint.load(self.regressor)
        with self.progress("exporting", 1) as tick:
            file = Exporter(loaded.network, loaded.spec, CHAIN, params).export()
            write_atomically(self.file, file.content)
            tick()
        return len(file.content)


def to_accuracy(group: GroupRecord) -> AccuracyRecord:
    """Sum test recordings up, without the figures of every walk."""
    return AccuracyRecord(
        vio=group.vio,
        walks=group.cases,
        raw=group.raw,
        rows=tuple(group.rows),
        reliability=tuple(group.reliability),
    )


def badness(localizer: BuiltLocalizer) -> float:
    """Median error of what is answered on test recordings, over the share that is; lower is better.

    Infinite where nothing is known.
    """
    rows = [
        row
        for one in localizer.accuracy
        for row in one.rows
        if row.method == CHAIN.name and row.subset == "all frames"
    ]
    worst = 0.0
    for row in rows:
        if row.fused.median_m is None or not row.fused.share:
            return float("inf")
        worst = max(worst, row.fused.median_m / row.fused.share)
    return worst if rows else float("inf")
