"""Progress in a file, for who started the work."""

import json

from vioapr.cli.console import progress
from vioapr.work import noted_progress


def test_stages_and_steps_are_noted(tmp_path, monkeypatch):
    path = tmp_path / "progress.json"
    monkeypatch.setenv(noted_progress.VARIABLE, str(path))
    monkeypatch.setattr(noted_progress, "_EVERY_S", 0.0)
    monkeypatch.setattr(noted_progress, "_stages", 0)
    with progress("reading", 10) as advance:
        advance()
        advance(3)
        said = json.loads(path.read_text())
    assert said == {
        "format": "vioapr progress", "version": 1, "title": "reading", "done": 4, "total": 10,
        "stages": 1,
    }  # fmt: skip
    with progress("writing", 0):
        assert json.loads(path.read_text())["stages"] == 2


def test_nothing_is_noted_unless_asked_for(tmp_path, monkeypatch):
    monkeypatch.delenv(noted_progress.VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    with progress("reading", 10) as advance:
        advance()
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_cannot_be_written_does_not_end_the_work(tmp_path, monkeypatch):
    monkeypatch.setenv(noted_progress.VARIABLE, str(tmp_path / "file" / "x"))
    (tmp_path / "file").write_text("")
    with progress("reading", 10) as advance:
        advance()
