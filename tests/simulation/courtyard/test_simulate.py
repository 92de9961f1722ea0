from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vioapr.errors import AlreadyExistsError, MissingExtraError, ParameterError
from vioapr.geometry.frames import z_up_from_y_up
from vioapr.geometry.umeyama import align_umeyama
from vioapr.scene.check import check_scene
from vioapr.scene.frames import Tracking
from vioapr.scene.scene import Scene
from vioapr.simulation.courtyard import context
from vioapr.simulation.courtyard.context import RenderingError, create_context
from vioapr.simulation.courtyard.plan import PRESETS, CourtyardParams, plan_recordings
from vioapr.simulation.courtyard.simulate import simulate

pytestmark = pytest.mark.slow

TINY = CourtyardParams(
    train=2, test=1, duration_s=6.0, rate_hz=2.0, width_px=64, height_px=48, people=2,
    texture_px_per_m=8.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def scene(rendering, tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("simulated") / "scene", TINY, seed=1, workers=1)


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_it_is_a_whole_scene(scene):
    assert not check_scene(scene.folder, decode=True).errors
    opened = Scene.open(scene.folder)
    assert opened.is_outdoor
    assert opened.splits == {"train": ("train-01", "train-02"), "test": ("test-01",)}
    for id_ in opened.recording_ids:
        recording, gt = opened.recording(id_), opened.gt(id_)
        np.testing.assert_allclose(recording.frames.timestamp_s, gt.timestamp_s)
        assert len(gt) == 12
        assert len(recording.imu) == 601
        assert len(recording.gnss) == 6
        assert len(recording.heading) == 60
        assert recording.frames.intrinsics.fx[0] == pytest.approx(0.78 * 64)


def test_tracking_is_lost_in_one_recording_and_jumps_in_another(scene):
    states = {
        id_: {Tracking(s) for s in scene.recording(id_).frames.tracking}
        for id_ in scene.recording_ids
    }
    assert states["train-01"] == {Tracking.NORMAL}
    assert {Tracking.LOST, Tracking.NORMAL} <= states["train-02"]
    assert Tracking.LIMITED in states["test-01"]


def test_the_tracker_follows_ground_truth(scene):
    frames, gt = scene.recording("train-01").frames, scene.gt("train-01")
    z_up = z_up_from_y_up(frames.vio_from_cam)
    aligned = align_umeyama(z_up.translation_m, gt.position_m)
    assert np.linalg.norm(aligned.apply(z_up.translation_m) - gt.position_m, axis=1).max() < 0.3


def test_recordings_differ_in_light(scene):
    means = {}
    for id_ in scene.recording_ids:
        recording = scene.recording(id_)
        pictures = [np.asarray(Image.open(recording.image_path(row))) for row in range(12)]
        means[id_] = np.mean(pictures, axis=(0, 1, 2))
        assert 30 < means[id_].mean() < 200
        assert np.std(pictures) > 15
    notes = {scene.recording(id_).info.notes[0] for id_ in scene.recording_ids}
    assert len(notes) == 3
    balance = {id_: mean[2] / mean[0] for id_, mean in means.items()}
    assert max(balance.values()) > 1.05 * min(balance.values())


def test_the_seed_decides_whatever_the_workers(scene, tmp_path):
    simulate(tmp_path / "again", TINY, seed=1, workers=2)
    again, first = files_of(tmp_path / "again"), files_of(scene.folder)
    assert again.keys() == first.keys()
    assert [name for name in first if first[name] != again[name]] == []


def test_another_seed_is_another_scene(scene, tmp_path):
    one = replace(TINY, train=1, test=0, duration_s=2.0)
    simulate(tmp_path / "other", one, seed=2, workers=1)
    name = "recordings/train-01/images/000001.jpg"
    assert (tmp_path / "other" / name).read_bytes() != (scene.folder / name).read_bytes()


def test_every_frame_ticks(rendering, tmp_path):
    ticks = []
    one = replace(TINY, train=1, test=0, duration_s=2.0)
    simulate(tmp_path / "scene", one, workers=1, tick=lambda: ticks.append(1))
    assert len(ticks) == 4


def test_a_scene_that_exists_is_kept(scene):
    before = files_of(scene.folder)
    with pytest.raises(AlreadyExistsError, match="exists"):
        simulate(scene.folder, TINY, workers=1)
    assert files_of(scene.folder) == before


def test_errors_of_workers_arrive(rendering, tmp_path, monkeypatch):
    """And nothing is left behind."""
    create = Scene.create

    def create_with_a_file_in_the_way(folder, *args, **kwargs):
        scene = create(folder, *args, **kwargs)
        (folder / "recordings").mkdir()
        (folder / "recordings" / "train-02").touch()
        return scene

    monkeypatch.setattr(Scene, "create", create_with_a_file_in_the_way)
    with pytest.raises(Exception, match="train-02"):
        simulate(tmp_path / "scene", TINY, workers=2)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_the_user_is_kept(rendering, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(AlreadyExistsError, match="expected a new or empty folder, found other"):
        simulate(tmp_path, TINY, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_an_interrupted_simulation_leaves_nothing(rendering, tmp_path):
    def interrupt():
        raise KeyboardInterrupt

    one = replace(TINY, train=1, test=0, duration_s=2.0)
    (tmp_path / "scene").mkdir()  # empty folders may be there
    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "scene", one, workers=1, tick=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]
    simulate(tmp_path / "scene", one, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]
    assert (tmp_path / "scene" / "scene.toml").exists()


def test_plans_cover_both_splits():
    plans = plan_recordings(CourtyardParams(train=8, test=3))
    assert [plan.id_ for plan in plans][7:9] == ["train-08", "test-01"]
    assert len({(p.route, p.backwards, p.weather) for p in plans[:6]}) == 6
    assert sum(plan.tracker_events.lost_s is not None for plan in plans) == 1
    single = plan_recordings(CourtyardParams(train=1, test=0))
    assert single[0].tracker_events.lost_s is not None


def test_short_recordings_walk_the_same_way():
    plans = plan_recordings(PRESETS["small"])
    assert {(plan.route, plan.backwards) for plan in plans} == {("around", False)}
    assert len({plan.weather for plan in plans}) == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [("train", 0), ("test", -1), ("duration_s", 0.5), ("rate_hz", float("nan")), ("width_px", 8)],
)
def test_bad_parameters_are_refused(name, value):
    with pytest.raises(ParameterError, match=f"{name}: expected"):
        replace(PRESETS["small"], **{name: value})


def test_bad_seeds_and_workers_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="seed"):
        simulate(tmp_path / "scene", TINY, seed=-1)
    with pytest.raises(ParameterError, match="workers"):
        simulate(tmp_path / "scene", TINY, workers=0)


def test_without_moderngl_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "moderngl", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'vioapr\[render\]'"):
        create_context()


def test_without_egl_the_packages_are_named(monkeypatch, tmp_path):
    moderngl = pytest.importorskip("moderngl")

    def refuse(**_):
        raise Exception("libEGL.so: cannot open shared object file")

    monkeypatch.setattr(moderngl, "create_context", refuse)
    with pytest.raises(RenderingError, match=r"apt-get install libegl1 libgl1 libgl1-mesa-dri"):
        create_context()
    with pytest.raises(RenderingError, match=r"libEGL\.so"):
        simulate(tmp_path / "scene", TINY)
    assert not (tmp_path / "scene").exists()
    assert context.DEBIAN_PACKAGES == ("libegl1", "libgl1", "libgl1-mesa-dri")
