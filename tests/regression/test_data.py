"""Which frames are learned from."""

from dataclasses import replace

import numpy as np
import pytest
from tests.regression.toy import make_scene

from vioapr.errors import FileMissingError, TrainingError
from vioapr.regression import cache
from vioapr.regression.data import load_samples, posed_frames, split_frames


@pytest.fixture
def scene(tmp_path):
    return make_scene(tmp_path / "box", train=3, test=2, frames=6)


def test_frames_have_their_own_poses(scene):
    frames = posed_frames(scene, "train-2")
    gt = scene.gt("train-2")
    assert [path.name for path in frames.paths] == [f"{row:03d}.png" for row in range(6)]
    np.testing.assert_allclose(frames.position_m, gt.position_m)
    np.testing.assert_allclose(frames.camera, np.tile([40 / 48, 40 / 36, 0.5, 0.5], (6, 1)))


def test_frames_without_ground_truth_are_left_out(scene):
    gt = scene.gt("train-1")
    scene.write_gt("train-1", gt.at_rows(np.array([0, 2, 5])))
    frames = posed_frames(scene, "train-1")
    assert [path.name for path in frames.paths] == ["000.png", "002.png", "005.png"]
    np.testing.assert_allclose(frames.position_m, gt.position_m[[0, 2, 5]])


def test_no_test_image_is_ever_read(scene, monkeypatch):
    """Training must not leak test recordings, nor those held out for validation."""
    read = []
    original = cache.read_image
    monkeypatch.setattr(cache, "read_image", lambda p, r: read.append(p) or original(p, r))
    frames = split_frames([scene], "train")
    samples = load_samples([scene], [f for f in frames if f.recording != "train-3"], 36)
    assert {path.parent.parent.name for path in read} == {"train-1", "train-2"}
    assert len(samples) == 12
    test_places = np.concatenate([scene.gt(id_).position_m for id_ in ("test-1", "test-2")])
    gaps = np.abs(samples.position_m[:, None] - test_places).max(axis=-1)
    assert gaps.min() > 1e-6


def test_samples_know_their_image(scene, tmp_path):
    other = make_scene(tmp_path / "other", train=1, frames=4, name="Other")
    scenes = [scene, other]
    samples = load_samples(scenes, split_frames(scenes, "train"), 36)
    assert samples.scene.tolist() == [0] * 18 + [1] * 4
    image = samples.read(np.array([7]))[0]
    path = scene.recording_folder("train-2") / "images/001.png"
    assert np.array_equal(image, cache.read_image(path, 36))


def test_fingerprint_changes_with_poses(scene):
    frames = split_frames([scene], "train")
    before = load_samples([scene], frames, 36).fingerprint
    assert load_samples([scene], frames, 36).fingerprint == before
    moved = replace(frames[0], position_m=frames[0].position_m + 1e-6)
    assert load_samples([scene], [moved, *frames[1:]], 36).fingerprint != before


def test_no_training_images(scene):
    for id_ in scene.splits["train"]:
        scene.gt_path(id_).unlink()
    with pytest.raises(FileMissingError, match="expected ground truth, found none: run vioapr map"):
        split_frames([scene], "train")
    empty = scene
    for id_ in scene.splits["train"]:
        empty = empty.with_recording(id_, None)
    with pytest.raises(TrainingError, match="expected images with ground truth in the split"):
        split_frames([empty], "train")


def test_unknown_recordings(scene):
    with pytest.raises(TrainingError, match=r"'test-1': expected one of the split 'train'"):
        split_frames([scene], "train", ["test-1"])
