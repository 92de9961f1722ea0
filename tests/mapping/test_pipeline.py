import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from PIL import Image
from tests.room import QUICK, SMALL

from vioapr.errors import FormatError, LockedError, MappingError
from vioapr.formats.base import ReadOptions
from vioapr.formats.colmap_binary import read as read_model
from vioapr.geometry import quaternion, rigid
from vioapr.geometry.averaging import mean_quaternion
from vioapr.geometry.rigid import Rigid3
from vioapr.mapping.params import MappingParams
from vioapr.mapping.pipeline import map_scene
from vioapr.report.map_report import write_map_report
from vioapr.scene.frames import Tracking
from vioapr.scene.recording import FRAMES_FILE
from vioapr.schemas.base import decode, to_plain
from vioapr.schemas.map_summary import MapSummary
from vioapr.simulation.rooms import ROOM_CAMERA, add_recording, textured_room, walk_arc
from vioapr.simulation.trackers import track_without_drift, tracking_world
from vioapr.work.locks import locked_folder

pytestmark = pytest.mark.slow

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def true_from_map(scene, truth):
    """By orientations and the median position: a fit of positions on so short arcs would be turned
    by half a degree by their last image, which few others see."""
    found = {id_: scene.gt(id_) for id_ in truth}
    maps, truths = (
        Rigid3(*(np.concatenate(parts) for parts in zip(*poses, strict=True)))
        for poses in ([gt.target_from_source for gt in side.values()] for side in (found, truth))
    )
    turns = quaternion.multiply(truths.quat_xyzw, quaternion.inverse(maps.quat_xyzw))
    turn = mean_quaternion(turns, np.ones(len(turns)))
    offsets = truths.translation_m - quaternion.rotate(turn, maps.translation_m)
    return Rigid3(np.median(offsets, axis=0), turn), found


def test_the_map_is_metric_level_and_exact(mapped_room):
    """VIO's scales are 1 % too large and too small: their mean is right."""
    scene, summary, truth = mapped_room
    placed, found = true_from_map(scene, truth)
    for id_, gt in found.items():
        assert len(gt) == len(truth[id_])
        poses = placed @ gt.target_from_source
        off_m = rigid.distance_m(poses, truth[id_].target_from_source)
        assert np.median(off_m) < 0.01
        assert np.median(rigid.angle_deg(poses, truth[id_].target_from_source)) < 0.2
    up = quaternion.rotate(placed.quat_xyzw, np.array([0.0, 0.0, 1.0]))
    assert np.degrees(np.arccos(up[2])) < 0.15
    assert [s.relative for s in summary.world.scales] == pytest.approx([1.01, 0.99], abs=0.008)
    assert scene.world.is_metric
    assert scene.world.is_gravity_aligned
    assert scene.world.origin is None


def test_test_images_are_not_in_the_map(mapped_room):
    scene, summary, _ = mapped_room
    model = read_model(scene.map_folder, ReadOptions(sequence="a/images"))
    assert len(model) == 8
    assert summary.model.images == 16
    assert summary.recordings["t"].registered == 4
    path = scene.map_folder / "map.json"
    assert decode(path, path.read_text(), MapSummary) == summary
    assert json.loads(path.read_text()) == to_plain(summary)


def test_ground_truth_is_in_the_models_world(mapped_room):
    scene, _, _ = mapped_room
    model = read_model(scene.map_folder, ReadOptions(sequence="b/images"))
    gt = scene.gt("b")
    np.testing.assert_allclose(model.position_m, gt.position_m, atol=1e-5)


def test_the_world_has_the_first_recordings_heading_and_origin(mapped_room):
    scene, _, _ = mapped_room
    vio = scene.recording("a").frames.vio_from_cam.translation_m
    x, y, z = vio.T
    np.testing.assert_allclose(scene.gt("a").position_m, np.column_stack([x, -z, y]), atol=0.06)


def test_the_report_shows_it(mapped_room, copy_of):
    scene, summary, _ = mapped_room
    ticks = []
    page = write_map_report(copy_of(scene), summary, lambda: ticks.append(1))
    text = page.read_text()
    for words in ("20 of 20 registered", "VIO against the map", "All images are registered"):
        assert words in text
    assert text.count("data:image/") == len(ticks) == 4
    vio = json.loads((page.parent / "vio.json").read_text())
    assert {track["walk"] for track in vio["tracks"]} == {"a", "b", "t"}
    assert all(track["ate_m"] < 0.03 for track in vio["tracks"])


def test_nothing_finished_is_done_again(mapped_room, copy_of):
    scene = copy_of(mapped_room[0])
    again = map_scene(scene, QUICK)
    steps = ["features", "matches", "near", "pruning", "model", "world", "test"]
    assert again.reused_steps == steps
    assert again.model == mapped_room[1].model
    other = map_scene(scene, MappingParams(**{**vars(QUICK), "mapper": "global"}))
    assert other.reused_steps == ["features", "matches", "near", "pruning"]
    assert other.recordings["a"].registered == 8


@pytest.mark.parametrize(
    ("title", "count", "reused"),
    [
        ("finding features", 5, []),
        ("matching images", 5, ["features"]),
        ("mapping (vio)", 3, ["features", "matches", "near", "pruning"]),
    ],
)
def test_a_killed_run_resumes(room, mapped_room, copy_of, title, count, reused):
    """Killed with no chance to tidy up; an earlier map stays. What came before is done."""
    scene = copy_of(room[0])
    shutil.copytree(mapped_room[0].folder / ".mapping", scene.folder / ".mapping")
    for marker in (scene.folder / ".mapping").glob("*.step.json"):
        if marker.name.removesuffix(".step.json") not in reused:
            marker.unlink()
    (scene.folder / "map").mkdir()
    (scene.folder / "map" / "old").write_text("earlier result")
    script = textwrap.dedent(
        f"""
        import os, sys
        from contextlib import contextmanager
        sys.path[:0] = {sys.path!r}
        from tests.room import QUICK
        from vioapr.mapping.pipeline import map_scene
        from vioapr.scene.scene import Scene

        @contextmanager
        def progress(title, total):
            count = 0
            def tick():
                nonlocal count
                count += 1
                if title == {title!r} and count == {count}:
                    os.kill(os.getpid(), 9)
            yield tick

        map_scene(Scene.open({str(scene.folder)!r}), QUICK, progress)
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    assert (scene.folder / "map" / "old").read_text() == "earlier result"
    summary = map_scene(scene, QUICK)
    assert summary.reused_steps == reused
    assert [facts.registered for facts in summary.recordings.values()] == [8, 8, 4]
    assert (scene.folder / "map" / "old").read_text() == "earlier result"  # a file of the user's


def test_recordings_that_share_no_view(small_room, copy_of):
    rng = np.random.default_rng(5)
    scene = copy_of(small_room[0])
    other = walk_arc(SMALL, 0, 8, 1.2, 1.5)
    vio = track_without_drift(rng, other.target_from_source, tracking_world(10))
    scene = add_recording(scene, "elsewhere", "train", other, vio, textured_room(99), ROOM_CAMERA)
    with pytest.raises(
        MappingError, match=r"share no view: a, b \| elsewhere\. Record a walk"
    ) as caught:
        map_scene(scene, QUICK)
    assert "from the place of a or b to that of elsewhere" in str(caught.value)
    assert "of images of a or b and elsewhere none sees the same things" in str(caught.value)
    assert not (scene.folder / "map").exists()
    summary = map_scene(scene, MappingParams(**{**vars(QUICK), "allow_partial": True}))
    lost = summary.recordings["elsewhere"]
    assert (lost.registered, len(lost.unregistered)) == (0, SMALL)
    assert scene.gt("elsewhere") is None
    assert summary.recordings["b"].registered == SMALL


def test_images_that_cannot_be_read_are_named(room, copy_of):
    scene = copy_of(room[0])
    folder = scene.recording_folder("a") / "images"
    (folder / "0003.jpg").unlink()
    (folder / "0005.jpg").write_bytes((folder / "0005.jpg").read_bytes()[:2000])
    Image.new("L", (320, 240), 128).save(folder / "0000.jpg")
    summary = map_scene(scene, QUICK)
    facts = summary.recordings["a"]
    assert (facts.images, facts.registered) == (8, 5)
    assert "no file of this name" in facts.unusable["a/images/0003.jpg"]
    assert "truncated" in facts.unusable["a/images/0005.jpg"]
    assert "no features" in facts.unusable["a/images/0000.jpg"]  # an even grey
    assert facts.unregistered == []


def spoil_tracking(scene, id_):
    """Tracking lost throughout."""
    path = scene.recording_folder(id_) / FRAMES_FILE
    head, *lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    lost = [[r[0], r[1], Tracking.LOST.label, *[""] * 7, *r[10:]] for r in rows]
    path.write_text("\n".join([head, *(",".join(r) for r in lost)]) + "\n")


def test_tracking_lost_throughout(small_room, copy_of):
    scene = copy_of(small_room[0])
    spoil_tracking(scene, "a")
    summary = map_scene(scene, QUICK)  # b still knows scale and up
    assert summary.recordings["a"].registered == SMALL
    assert [s.recording for s in summary.world.scales] == ["b"]
    before = (scene.map_folder / "map.json").read_bytes()
    spoil_tracking(scene, "b")
    with pytest.raises(MappingError, match="scale and up are not known"):
        map_scene(scene, QUICK)
    assert (scene.map_folder / "map.json").read_bytes() == before


def test_a_scene_is_mapped_by_one_process_at_a_time(mapped_room, copy_of):
    scene = copy_of(mapped_room[0])
    with (
        locked_folder(scene.folder / ".mapping"),
        pytest.raises(LockedError, match=rf"in use by process {os.getpid()} .* wait until"),
    ):
        map_scene(scene, QUICK)


def test_an_empty_split_and_recordings_without_images(room, copy_of, tmp_path):
    scene = copy_of(room[0])
    for id_ in ("a", "b"):
        scene = scene.with_recording(id_, "test")
    with pytest.raises(MappingError, match=r"expected training recordings in splits.train"):
        map_scene(scene, QUICK)
    scene = scene.with_recording("a", "train")
    for image in (scene.recording_folder("a") / "images").iterdir():
        image.unlink()
    with pytest.raises(FormatError, match="expected images, got none that can be read"):
        map_scene(scene, QUICK)


@pytest.mark.parametrize("limit_kb", [40, 400])
def test_a_full_disk_spares_what_was_there(small_room, copy_of, limit_kb):
    """Files that cannot grow beyond a limit stand in for a full disk."""
    scene = copy_of(small_room[0])
    (scene.folder / "map").mkdir()
    (scene.folder / "map" / "old").write_text("earlier result")
    script = textwrap.dedent(
        f"""
        import resource, sys
        sys.path[:0] = {sys.path!r}
        from tests.room import QUICK
        from vioapr.errors import VioAprError
        from vioapr.mapping.pipeline import map_scene
        from vioapr.scene.scene import Scene
        resource.setrlimit(resource.RLIMIT_FSIZE, ({limit_kb} * 1024,) * 2)
        try:
            map_scene(Scene.open({str(scene.folder)!r}), QUICK)
        except VioAprError as error:
            print("clear message:", error)
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert b"clear message" in done.stdout, done.stderr.decode()
    assert (scene.folder / "map" / "old").read_text() == "earlier result"
    summary = map_scene(scene, QUICK)
    assert summary.recordings["t"].registered == SMALL // 2
