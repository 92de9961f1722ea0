"""A simulated scene, written out as the published data sets are."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from vioapr.formats import cambridge, marvin, sevenscenes
from vioapr.scene.recording import IMAGES_FOLDER
from vioapr.scene.scene import Scene
from vioapr.trajectory import Trajectory


def joined(parts: list[tuple[list[str], Trajectory]]) -> Trajectory:
    """Poses of several recordings by image name, without times."""
    names = [name for part, _ in parts for name in part]
    positions = np.concatenate([track.position_m for _, track in parts])
    quats = np.concatenate([track.quat_xyzw for _, track in parts])
    rows = np.arange(len(names), dtype=float)
    target = parts[0][1].target
    return Trajectory(rows, positions, quats, tuple(names), is_timed=False, target=target)


def write_marvin(scene: Scene, folder: Path) -> Path:
    """`train.txt`, `test.txt`, `ARKit.txt`, and a folder of images for every recording."""
    folder.mkdir(parents=True)
    tracked = []
    for split in ("train", "test"):
        posed = []
        for id_ in scene.splits[split]:
            frames = scene.recording(id_).frames
            names = np.array([f"{id_}/{name}" for name in frames.image])
            posed.append((names.tolist(), scene.gt(id_)))
            tracked.append((names[frames.has_pose].tolist(), frames.to_trajectory()))
            shutil.copytree(scene.recording_folder(id_) / IMAGES_FOLDER, folder / id_)
        marvin.FORMAT.write(folder / f"{split}.txt", joined(posed))
    marvin.VIO_FORMAT.write(folder / "ARKit.txt", joined(tracked))
    return folder


def write_sevenscenes(scene: Scene, folder: Path) -> Path:
    """`seq-XX` with a pose file an image, `TrainSplit.txt` and `TestSplit.txt`."""
    number = 0
    for split, file in (("train", "TrainSplit.txt"), ("test", "TestSplit.txt")):
        lines = []
        for id_ in scene.splits[split]:
            number += 1
            _write_sequence(scene, id_, folder / f"seq-{number:02d}")
            lines.append(f"sequence{number}\n")
        (folder / file).write_text("".join(lines))
    return folder


def _write_sequence(scene: Scene, id_: str, folder: Path) -> None:
    images = scene.recording(id_).frames.image
    names = [f"frame-{row:06d}.color.png" for row in range(len(images))]
    sevenscenes.write(folder, joined([(names, scene.gt(id_))]))
    for image, name in zip(images, names, strict=True):
        shutil.copy(scene.recording_folder(id_) / IMAGES_FOLDER / image, folder / name)


def write_cambridge(scene: Scene, folder: Path) -> Path:
    """`dataset_train.txt`, `dataset_test.txt`, and `seqN` with the images."""
    folder.mkdir(parents=True)
    number = 0
    for split in ("train", "test"):
        posed = []
        for id_ in scene.splits[split]:
            number += 1
            images = scene.recording(id_).frames.image
            posed.append(([f"seq{number}/{name}" for name in images], scene.gt(id_)))
            shutil.copytree(scene.recording_folder(id_) / IMAGES_FOLDER, folder / f"seq{number}")
        cambridge.FORMAT.write(folder / f"dataset_{split}.txt", joined(posed))
    return folder
