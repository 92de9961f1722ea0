"""A tiny courtyard in the published data sets' layouts."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.recipes.published import write_cambridge, write_marvin, write_sevenscenes

from vioapr.scene.scene import Scene
from vioapr.simulation.courtyard.plan import CourtyardParams
from vioapr.simulation.courtyard.simulate import simulate

TINY = CourtyardParams(
    train=1, test=2, duration_s=4.0, rate_hz=4.0, width_px=64, height_px=48, people=0,
    texture_px_per_m=8.0,
)  # fmt: skip
IMAGES = 16
"""Of each recording."""


@pytest.fixture(scope="session")
def courtyard(rendering, tmp_path_factory) -> Scene:
    return simulate(tmp_path_factory.mktemp("courtyard") / "scene", TINY, seed=3, workers=1)


@pytest.fixture(scope="session")
def marvin_dir(courtyard, tmp_path_factory) -> Path:
    """Two scenes of the six, and a folder that is none."""
    folder = tmp_path_factory.mktemp("marvin")
    for name in ("Square", "Church", "Garden"):
        write_marvin(courtyard, folder / name)
    return folder


@pytest.fixture(scope="session")
def sevenscenes_dir(courtyard, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("7scenes")
    write_sevenscenes(courtyard, folder / "chess")
    return folder


@pytest.fixture(scope="session")
def cambridge_dir(courtyard, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("cambridge")
    write_cambridge(courtyard, folder / "KingsCollege")
    return folder


@pytest.fixture(scope="module")
def out_dir(tmp_path_factory):
    """A folder for checkpoints, which are large: removed at once."""
    folder = tmp_path_factory.mktemp("out")
    yield folder
    shutil.rmtree(folder)
