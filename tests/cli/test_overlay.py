"""`vioapr overlay`: which files it takes, what it writes, and what it says of mistakes."""

import numpy as np
import pytest
from PIL import Image

from vioapr.formats import tum
from vioapr.fusion.fused_walk import FusedWalk, write_fused_csv
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.scene.frames import Intrinsics, Tracking
from vioapr.scene.scene import Scene
from vioapr.scene.writer import RecordingWriter
from vioapr.schemas.anchors import Anchor, AnchorsDocument
from vioapr.schemas.base import decode, encode
from vioapr.schemas.recording import RecordingInfo
from vioapr.trajectory import Trajectory

FRAMES = 60
LEVEL_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
TIMES = np.arange(FRAMES) / 5


def straight(shift_m=0.0):
    position_m = np.stack([np.linspace(0, 12, FRAMES), np.zeros(FRAMES), np.full(FRAMES, 1.5)], 1)
    return Rigid3(position_m + np.array([0, shift_m, 0]), np.tile(LEVEL_XYZW, (FRAMES, 1)))


@pytest.fixture
def recording(tmp_path):
    """A straight walk of a scene, with pictures and ground truth."""
    scene = Scene.create(tmp_path / "scene", "Place", is_outdoor=True)
    pixels = np.full((36, 48, 3), 120, np.uint8)
    with RecordingWriter(scene.recording_folder("walk"), RecordingInfo(tracker="ARKit")) as writer:
        for row in range(FRAMES):
            writer.add_frame(
                float(TIMES[row]), f"{row:03}.png", pixels, Tracking.NORMAL, straight().at(row),
                Intrinsics(48, 36, 40, 40, 24, 18),
            )  # fmt: skip
    scene.with_recording("walk", "test").save()
    scene.write_gt("walk", Trajectory(TIMES, *straight()))
    return scene.recording_folder("walk")


@pytest.fixture
def fused(tmp_path):
    status = np.full(FRAMES, int(Status.OPTIMIZED))
    poses = straight(0.2)
    status[:5] = int(Status.UNLOCALIZED)
    poses.translation_m[:5], poses.quat_xyzw[:5] = np.nan, np.nan
    write_fused_csv(tmp_path / "fused.csv", FusedWalk(TIMES, poses, status))
    return tmp_path / "fused.csv"


def columns_of(path, width):
    """How many panels of a width are side by side on a sheet, with 2 px between and 6 px around."""
    with Image.open(path) as sheet:
        count, rest = divmod(sheet.width - 10, width + 2)
    assert rest == 0
    return count


def test_raw_fused_and_truth_are_side_by_side(run, recording, fused, tmp_path):
    tum.write(tmp_path / "apr.tum", Trajectory(TIMES[::5], *straight(1.0).at(slice(0, None, 5))))
    out = tmp_path / "o.png"
    code, text, err = run(
        "overlay", recording, "--poses", fused, "--raw", tmp_path / "apr.tum", "--out", out,
        "--save-anchors", tmp_path / "anchors.json", "--width-px", "96", "--rows", "1",
    )  # fmt: skip
    assert code == 0, err
    assert "1 frame" in text
    assert columns_of(out, 96) == 3
    saved = decode("", (tmp_path / "anchors.json").read_bytes(), AnchorsDocument)
    assert saved.scene == "Place"
    assert f"{len(saved.anchors)} anchor" in text
    code, _, err = run(
        "overlay", recording, "--poses", fused, "--anchors", tmp_path / "anchors.json",
        "--raw", tmp_path / "apr.tum", "--out", tmp_path / "again.png", "--width-px", "96",
        "--rows", "1",
    )  # fmt: skip
    assert code == 0, err
    assert (tmp_path / "again.png").read_bytes() == out.read_bytes()


@pytest.mark.parametrize("place", ["walks/test", "build/walks/net"])
def test_predictions_in_the_scene_are_found(run, fails, recording, fused, tmp_path, place):
    small = "--rows", "1", "--width-px", "64"
    code, text, _ = run(
        "overlay", recording, "--poses", fused, "--out", tmp_path / "two.png", *small
    )
    assert code == 0
    assert "--raw names no predictions" in text
    assert columns_of(tmp_path / "two.png", 64) == 2
    folder = recording.parents[1] / place / "walk"
    folder.mkdir(parents=True)
    tum.write(folder / "apr_net.tum", Trajectory(TIMES, *straight(1.0)))
    flags = "--poses", fused, "--out", tmp_path / "three.png", *small
    assert run("overlay", recording, *flags)[0] == 0
    assert columns_of(tmp_path / "three.png", 64) == 3
    tum.write(folder / "apr_other.tum", Trajectory(TIMES, *straight(1.0)))
    line = fails("overlay", recording, "--poses", fused, "--out", tmp_path / "four.png")
    assert line.startswith("--raw: expected to be told which")
    assert "apr_net.tum" in line


def test_any_trajectory_is_taken_for_poses(run, recording, tmp_path):
    tum.write(tmp_path / "fused.tum", Trajectory(TIMES, *straight(0.2)))
    code, _, err = run(
        "overlay", recording, "--poses", tmp_path / "fused.tum", "--out", tmp_path / "o.gif",
        "--seconds", "1", "--width-px", "64", "--rate-hz", "2.5",
    )  # fmt: skip
    assert code == 0, err
    with Image.open(tmp_path / "o.gif") as film:
        assert film.n_frames == 3


def test_a_walk_without_a_localized_frame_is_refused(fails, recording, tmp_path):
    status = np.full(FRAMES, int(Status.UNLOCALIZED))
    write_fused_csv(tmp_path / "none.csv", FusedWalk(TIMES, Rigid3.unknown((FRAMES,)), status))
    line = fails(
        "overlay", recording, "--poses", tmp_path / "none.csv", "--out", tmp_path / "o.png"
    )
    assert line.endswith("none.csv: expected localized frames, found none")


def test_another_ending_is_refused(fails, recording, fused, tmp_path):
    line = fails("overlay", recording, "--poses", fused, "--out", tmp_path / "o.jpg")
    assert line.startswith("--out: expected a name ending in .png, .gif, .mp4, got ")


def test_broken_anchors_are_refused_with_their_place(fails, recording, fused, tmp_path):
    path = tmp_path / "anchors.json"
    flags = ("--poses", fused, "--anchors", path, "--out", tmp_path / "o.png")
    anchor = '{"position_m": [1, 2, %s], "size_m": %s, "quat_xyzw": [0, 0, %s, 1]}'
    document = '{"format": "vioapr anchors", "version": 1, "anchors": [%s]}'
    path.write_text(document % anchor.replace("position", "place") % (0, 1, 0))
    assert "anchors[0]" in fails("overlay", recording, *flags)
    path.write_text(document % anchor % (0, -1, 0))
    assert "anchors[0].size_m: expected `float` > 0" in fails("overlay", recording, *flags)
    path.write_text(document % anchor % (0, 1, 1))
    assert "expected a unit quaternion quat_xyzw, got one of norm 1.414" in fails(
        "overlay", recording, *flags
    )
    path.write_text(document % anchor % ("NaN", 1, 0))
    assert "expected finite numbers" in fails("overlay", recording, *flags)
    path.write_text(document % "")
    assert "anchors: expected" in fails("overlay", recording, *flags)


def test_a_file_that_is_read_is_not_written(fails, recording, fused, tmp_path):
    path = tmp_path / "anchors.json"
    path.write_text(encode(AnchorsDocument(anchors=(Anchor(position_m=(6, 0, 0)),))))
    line = fails(
        "overlay", recording, "--poses", fused, "--anchors", path, "--save-anchors", path,
        "--out", tmp_path / "o.png",
    )  # fmt: skip
    assert "--anchors or --save-anchors" in line
    (tmp_path / "o.png").write_bytes(b"mine")
    line = fails("overlay", recording, "--poses", fused, "--out", tmp_path / "o.png")
    assert "exists" in line
