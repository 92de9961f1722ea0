import json

import pytest

from vioapr.errors import FormatError
from vioapr.work.steps import Steps, write_atomically


def run(folder, inputs, log):
    steps = Steps(folder)
    for name, value in inputs.items():
        steps.run(name, value, lambda is_resumed, name=name: log.append((name, is_resumed)) or name)
    return steps


def test_finished_steps_are_not_repeated(tmp_path):
    log = []
    run(tmp_path, {"a": 1, "b": 2}, log)
    steps = run(tmp_path, {"a": 1, "b": 2}, log)
    assert log == [("a", False), ("b", False)]
    assert steps.reused == ["a", "b"]


def test_results_are_kept(tmp_path):
    for _ in range(2):
        assert Steps(tmp_path).run("a", 1, lambda _: {"x": [1.5, None]}) == {"x": [1.5, None]}


def test_a_change_repeats_a_step_and_all_after_it(tmp_path):
    log = []
    run(tmp_path, {"a": 1, "b": 2, "c": 3}, log)
    log.clear()
    run(tmp_path, {"a": 1, "b": 20, "c": 3}, log)
    assert log == [("b", False), ("c", False)]


def test_an_interrupted_step_is_resumed(tmp_path):
    def fail(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Steps(tmp_path).run("a", 1, fail)
    log = []
    run(tmp_path, {"a": 1}, log)
    assert log == [("a", True)]
    with pytest.raises(KeyboardInterrupt):
        Steps(tmp_path).run("a", 2, fail)
    run(tmp_path, {"a": 3}, log)
    assert log[-1] == ("a", False)  # what was left is of other inputs


def test_what_follows_a_repeated_step_is_repeated(tmp_path):
    log = []
    run(tmp_path, {"a": 1, "b": 2}, log)
    (tmp_path / "a.step.json").unlink()
    log.clear()
    run(tmp_path, {"a": 1, "b": 2}, log)
    assert log == [("a", False), ("b", False)]


@pytest.mark.parametrize("content", ["", "{", "[]", '{"key": 1}'])
def test_a_broken_marker_is_as_none(tmp_path, content):
    log = []
    run(tmp_path, {"a": 1}, log)
    (tmp_path / "a.step.json").write_text(content)
    run(tmp_path, {"a": 1}, log)
    assert log == [("a", False)] * 2


def test_files_are_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "file"
    write_atomically(path, b"old")
    write_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    with pytest.raises(FormatError, match="cannot be written"):
        write_atomically(tmp_path / "no" / "file", b"")


def test_seconds_are_remembered(tmp_path):
    first = run(tmp_path, {"a": 1}, []).seconds
    assert run(tmp_path, {"a": 1}, []).seconds == first
    assert json.loads((tmp_path / "a.step.json").read_text())["is_done"]
