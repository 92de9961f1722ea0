"""The public face: what `import vioapr` offers."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vioapr
from vioapr import FileError, Status, Trajectory
from vioapr.simulation.walks import WalkParams, simulate_walk

NAMES = [name for name in vioapr.__all__ if not name.startswith("__")]


def test_names_are_in_order():
    assert sorted(NAMES) == NAMES
    assert set(vioapr.__all__) <= set(dir(vioapr))


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_documented(name):
    thing = getattr(vioapr, name)
    if inspect.isclass(thing) or inspect.isroutine(thing):
        assert thing.__name__ == name
        assert len(inspect.getdoc(thing) or "") > 20


def test_type_checkers_see_every_name():
    source = inspect.getsource(vioapr)
    for name in NAMES:
        assert f" import {name} as {name}\n" in source
    assert Path(vioapr.__file__).with_name("py.typed").exists()


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="module 'vioapr' has no attribute 'fly'"):
        vioapr.fly  # noqa: B018


@pytest.mark.slow
def test_names_do_not_need_optional_packages():
    code = (
        "import sys\n"
        "sys.modules |= dict.fromkeys(['torch', 'onnxruntime', 'pycolmap', 'gtsam'])\n"
        "from vioapr import *"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_a_walk_is_fused_and_evaluated_in_two_calls():
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    fused = vioapr.fuse(walk.apr, walk.vio)
    accuracy = vioapr.evaluate(fused, walk.gt)
    raw = vioapr.evaluate(walk.apr, walk.gt)
    assert accuracy.summary.median_m < raw.summary.median_m
    assert len(accuracy.timestamp_s) == len(accuracy.errors.position_m) == len(walk.gt)
    assert raw.summary.share == 1
    assert vioapr.evaluate(walk.gt, walk.gt).summary.p95_m == 0


def test_unlocalized_frames_are_no_errors_but_lower_the_share():
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    fused = vioapr.fuse(walk.apr, walk.vio, "vio-apr", view="live")
    lost = fused.status == Status.UNLOCALIZED
    assert lost.any()
    assert vioapr.evaluate(fused, walk.gt).summary.share == pytest.approx(1 - lost.mean())


def test_only_frames_with_ground_truth_are_evaluated():
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    part = Trajectory(walk.gt.timestamp_s[5:9], walk.gt.position_m[5:9], walk.gt.quat_xyzw[5:9])
    accuracy = vioapr.evaluate(walk.apr, part)
    assert accuracy.timestamp_s.tolist() == part.timestamp_s.tolist()
    late = Trajectory(part.timestamp_s + 1e4, part.position_m, part.quat_xyzw)
    with pytest.raises(vioapr.AssociationError, match="no frame has ground truth within 0.01 s"):
        vioapr.evaluate(walk.apr, late)


def test_offline_fusion_uses_the_future():
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    online = vioapr.evaluate(vioapr.fuse(walk.apr, walk.vio), walk.gt)
    offline = vioapr.evaluate(vioapr.fuse(walk.apr, walk.vio, offline=True), walk.gt)
    assert offline.summary.median_m < online.summary.median_m


def test_what_cannot_be_fused(tmp_path):
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    with pytest.raises(vioapr.ParameterError, match="unknown method 'fly'"):
        vioapr.fuse(walk.apr, walk.vio, "fly")
    with pytest.raises(vioapr.ParameterError, match="params: expected VioAprParams for method"):
        vioapr.fuse(walk.apr, walk.vio, "vio-apr", params={"n": 2})
    with pytest.raises(vioapr.ParameterError, match="can use the future: chain; vio-apr cannot"):
        vioapr.fuse(walk.apr, walk.vio, "vio-apr", offline=True)


def test_trajectories_are_written_in_the_format_of_their_name(tmp_path):
    gt = simulate_walk(WalkParams(duration_s=5), seed=4).gt
    for name in ("gt.tum", "gt.kitti"):
        vioapr.write_trajectory(tmp_path / name, gt)
        assert vioapr.inspect_file(tmp_path / name).candidates[0].name == name[3:]
        read = vioapr.read_trajectory(tmp_path / name)
        assert read.position_m == pytest.approx(gt.position_m)
    vioapr.write_trajectory(tmp_path / "gt.txt", gt, "tum")
    with pytest.raises(vioapr.ParameterError, match="choose one with `format_name`"):
        vioapr.write_trajectory(tmp_path / "other.txt", gt)


def signatures():
    """All that is called by its public name: functions, methods, and classes that are no record."""
    for name in NAMES:
        thing = getattr(vioapr, name)
        if inspect.isroutine(thing):
            yield name, thing
        elif inspect.isclass(thing):
            for method, function in inspect.getmembers(thing, callable):
                if not method.startswith("_") or (method == "__init__" and not is_record(thing)):
                    yield f"{name}.{method}", function


def is_record(thing: type) -> bool:
    return hasattr(thing, "__dataclass_fields__") or hasattr(thing, "__struct_fields__")


@pytest.mark.parametrize(("name", "function"), list(signatures()))
def test_paths_may_be_text(name, function):
    try:
        parameters = inspect.signature(function).parameters
    except ValueError:
        pytest.skip("made by C, without a signature")
    for parameter in parameters.values():
        assert not re.search(r"\bPath\b", str(parameter.annotation)), f"{name}: {parameter}"


def test_paths_as_text_are_read_and_written(tmp_path):
    walk = simulate_walk(WalkParams(duration_s=5), seed=4)
    path, copy = str(tmp_path / "a.tum"), str(tmp_path / "b.csv")
    vioapr.write_trajectory(path, walk.gt)
    assert len(vioapr.read_trajectory(path)) == len(walk.gt)
    assert vioapr.inspect_file(path).candidates[0].name == "tum"
    assert vioapr.convert_file(path, copy).target_format == "euroc"
    with pytest.raises(FileError, match="nothing"):
        vioapr.find_walks(str(tmp_path / "nothing"))
    scene = vioapr.Scene.create(str(tmp_path / "scene"), "Court", is_outdoor=True)
    assert vioapr.Scene.open(str(tmp_path / "scene")).folder == scene.folder
    for function in (vioapr.OnnxLocalizer, vioapr.Recording.open, vioapr.Scene.open):
        with pytest.raises(FileError, match="nothing"):
            function(str(tmp_path / "nothing"))
