"""docs/reference/scene.md shows what the readers take."""

import re
from pathlib import Path

import pytest

from vioapr.importers.registry import IMPORTERS
from vioapr.scene import frames, sensors
from vioapr.scene.recording import read_info
from vioapr.scene.scene import Scene
from vioapr.schemas.recording import RecordingInfo
from vioapr.schemas.scene import GeodeticOrigin


@pytest.fixture
def text(request):
    return (request.config.rootpath / "docs" / "reference" / "scene.md").read_text(encoding="utf-8")


def block(text: str, language: str) -> str:
    return re.search(rf"```{language}\n(.*?)```", text, re.DOTALL).group(1)


def test_scene_toml(text, tmp_path: Path):
    (tmp_path / "scene.toml").write_text(block(text, "toml"), encoding="utf-8")
    scene = Scene.open(tmp_path)
    assert scene.name == "Courtyard"
    assert scene.splits["train"] == ("2024-05-03-morning", "2024-05-04-rain")
    assert scene.excluded == {"2024-05-06": "the tracker is diverging"}
    assert scene.world.origin == GeodeticOrigin(22.3364, 114.2655, 31.0)


def test_recording_json(text, tmp_path: Path):
    (tmp_path / "recording.json").write_text(block(text, "json"), encoding="utf-8")
    assert read_info(tmp_path / "recording.json") == RecordingInfo(
        device="iPhone 14 Pro", tracker="ARKit"
    )
    for name in set(RecordingInfo.__struct_fields__) - {"conventions"}:
        assert f"| `{name}` |" in text


def test_headers(text):
    for header in (frames.HEADER, sensors.IMU_HEADER, sensors.GNSS_HEADER, sensors.HEADING_HEADER):
        assert f"\n    {header}\n" in text


def test_every_importer_and_its_flags(text):
    for importer in IMPORTERS.values():
        row = re.search(rf"^\| `{importer.name}` \|.*$", text, re.MULTILINE).group()
        for option in importer.uses:
            assert f"--{option.replace('_', '-')}" in row, importer.name
