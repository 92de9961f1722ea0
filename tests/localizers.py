"""Exported files to test with, and what is fed to them; tracing takes seconds: made once."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import pytest
from tests.shared import shared_folder

from vioapr.files.atomic import write_atomically
from vioapr.fusion.methods import METHODS
from vioapr.geometry.rigid import Rigid3
from vioapr.simulation.walks import WalkParams, simulate_walk

EXPORTED = ("vio-apr", "chain")


@pytest.fixture(scope="session")
def exporter_of():
    """The exporter of a method, with a network that reads poses off pictures."""
    for package in ("torch", "onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    from tests.export.networks import DecodingNetwork, TinySpec

    from vioapr.export.exporter import Exporter

    made = {}

    def make(name):
        if name not in made:
            method = METHODS[name]
            network = DecodingNetwork(TinySpec()).eval()
            made[name] = Exporter(network, TinySpec(), method, method.params_type())
        return made[name]

    return make


@pytest.fixture(scope="session")
def model_of(exporter_of, tmp_path_factory):
    """The file of a method's exported localizer, made once for all worker processes."""

    def make(name):
        with shared_folder(tmp_path_factory, name) as folder:
            path = folder / f"{name}.onnx"
            if not path.exists():
                write_atomically(path, exporter_of(name).export().content)
        return path

    return make


def eventful_walk():
    """A simulated walk of 60 frames whose tracker is lost and reset, with faulty poses."""
    return simulate_walk(WalkParams(duration_s=30, extent_m=10), seed=3)


def images(count, seed=0):
    """Pictures of different sizes and brightness."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        height, width = ((48, 64), (64, 48), (30, 90))[index % 3]
        level = 128 + 100 * np.sin(index / 7)
        noise = rng.normal(0, 25, (height, width, 3))
        yield np.clip(level + noise, 0, 255).astype(np.uint8)


def pictures(walk):
    """Pictures that show the walk's predictions, of different sizes."""
    from tests.export.networks import picture_of

    for row, size in zip(range(len(walk.apr)), cycle(((48, 64), (64, 48), (120, 160)))):
        pose = np.concatenate([walk.apr.position_m[row], walk.apr.quat_xyzw[row]])
        yield picture_of(pose, *size)


def vio_pose(walk, row):
    return Rigid3(*(part[row] for part in walk.vio.target_from_source))


def events(row):
    """Of a frame: has an image, is tracked, is reset."""
    return row % 7 != 3, row not in (20, 21, 45), row == 33
