"""Whatever is in a scene's files, reading and checking end in an answer or a FileError."""

import shutil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.scene.scenes import make_scene

from vioapr.errors import FileError
from vioapr.scene.check import check_scene
from vioapr.scene.recording import Recording
from vioapr.scene.scene import Scene
from vioapr.scene.summary import summarize_scene

pytestmark = pytest.mark.slow

FILES = ["scene.toml", "recordings/walk-1/recording.json", "recordings/walk-1/frames.csv",
         "recordings/walk-1/heading.csv", "recordings/walk-1/images/frame-2.jpg",
         "gt/walk-1.tum"]  # fmt: skip
ODD = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b",",
    b"\n",
    b"\r",
    b"\0",
    b"\xff\xfe",
    b'"',
    b"{",
    b"[",
    b"",
]

pieces = st.one_of(st.sampled_from(ODD), st.binary(max_size=8))


@pytest.fixture
def original(tmp_path):
    scene = make_scene(tmp_path / "original", 4)
    heading = scene.folder / "recordings/walk-1/heading.csv"
    heading.write_text("timestamp_s,heading_deg,sigma_deg\n0,10,\n1,20,5\n")
    return scene.folder


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(file=st.sampled_from(FILES), at=st.floats(0, 1), cut=st.integers(0, 12), piece=pieces)
def test_damage_anywhere(original, file, at, cut, piece):
    damaged = original.with_name("damaged")
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(original, damaged)
    content = (damaged / file).read_bytes()
    start = int(at * len(content))
    (damaged / file).write_bytes(content[:start] + piece + content[start + cut :])
    problems = None
    try:
        problems = check_scene(damaged, decode=True).errors
        summarize_scene(Scene.open(damaged))
    except FileError:
        pass
    try:
        recording = Recording.open(damaged / "recordings/walk-1")
        _ = recording.frames, recording.heading
    except FileError:
        # What cannot be read is found by the check.
        assert problems is None or problems
