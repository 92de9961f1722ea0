"""The Python in the guides runs as it is shown, with files of the demo under the names it uses."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from tests.calibrations import pair_of

import vioapr
from vioapr.files.images import read_rgb
from vioapr.fusion.calibrated import write_calibration
from vioapr.recipes.demo import RECORDING, unpack_demo
from vioapr.schemas.calibration import Calibration
from vioapr.simulation.walks import WalkParams, simulate_walk

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs" / "guide").glob("*.md"), ROOT / "README.md"])
FRAMES = 8


def blocks_of(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)


BLOCKS = [
    pytest.param(block, id=f"{page.stem}-{k}")
    for page in PAGES
    for k, block in enumerate(blocks_of(page), 1)
]


def test_the_guides_have_python():
    ids = [block.id for block in BLOCKS]
    assert {"README-1", "phone-1", "python-1", "python-2"} <= set(ids)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder as a user has it: two tracks of a walk, and the demo's scene and localizer."""
    folder = tmp_path_factory.mktemp("guide")
    walk = simulate_walk(WalkParams(duration_s=20), seed=3)
    vioapr.write_trajectory(str(folder / "apr.tum"), walk.apr)
    vioapr.write_trajectory(str(folder / "vio.csv"), walk.vio, "table")
    write_calibration(folder / "calibration.toml", Calibration(pairs=(pair_of(),)))
    demo = unpack_demo(folder)
    (folder / "localizer.onnx").write_bytes(demo.model.read_bytes())
    return folder


@pytest.fixture
def given(folder):
    """What the blocks take from the program around them, and what they were called with."""
    apr = vioapr.read_trajectory(str(folder / "apr.tum"))
    vio = vioapr.read_trajectory(str(folder / "vio.csv"))
    recording = vioapr.Recording.open(str(folder / "courtyard" / "recordings" / RECORDING))
    frames = recording.frames
    shown: list[vioapr.Rigid3] = []
    return {
        "frames": [
            (time_s, apr.target_from_source.at(k), vio.target_from_source.at(k))
            for k, time_s in enumerate(apr.timestamp_s[:200])
        ],
        "camera": [
            (frames.timestamp_s[k], read_rgb(recording.image_path(k)), frames.vio_from_cam.at(k))
            for k in itertools.islice(range(0, len(frames), 5), FRAMES)
        ],
        "timestamp_s": apr.timestamp_s[0],
        "apr_world_from_cam": apr.target_from_source.at(0),
        "vio_from_cam": vio.target_from_source.at(0),
        "anchor_content": shown.append,
        "show_content": shown.append,
        "shown": shown,
    }


@pytest.mark.parametrize("block", BLOCKS)
def test_python_of_the_guides_runs(block, given, folder, monkeypatch, capsys):
    if "OnnxLocalizer" in block:
        pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    monkeypatch.chdir(folder)
    exec(compile(block, "<guide>", "exec"), given)
    assert given["shown"] or capsys.readouterr().out or "for" not in block
    assert all(np.isfinite(pose.translation_m).all() for pose in given["shown"])
