import json

import numpy as np
import pytest

from vioapr.errors import UnwritableError
from vioapr.schemas.base import Record
from vioapr.work.steps import Steps, describe_changes, fingerprint, is_current, mark


class Counts(Record, frozen=True):
    pairs: int
    names: tuple[str, ...]
    length_m: float | None = None


def run(folder, inputs, log):
    steps = Steps(folder)
    for name, value in inputs.items():
        steps.run(
            name, value, lambda is_resumed, name=name: log.append((name, is_resumed)) or name, str
        )
    return steps


def test_finished_steps_are_not_repeated(tmp_path):
    log = []
    run(tmp_path, {"a": 1, "b": 2}, log)
    steps = run(tmp_path, {"a": 1, "b": 2}, log)
    assert log == [("a", False), ("b", False)]
    assert steps.reused == ["a", "b"]


def test_results_are_kept(tmp_path):
    for _ in range(2):
        result = Steps(tmp_path).run("a", 1, lambda _: {"x": [1.5, None]}, dict)
        assert result == {"x": [1.5, None]}


def test_records_are_kept(tmp_path):
    given = Counts(pairs=3, names=("a", "b"), length_m=0.1 + 0.2)
    for _ in range(2):
        assert Steps(tmp_path).run("a", given, lambda _: given, Counts) == given


def test_a_result_of_another_type_is_as_none(tmp_path):
    Steps(tmp_path).run("a", 1, lambda _: {"pairs": 3}, dict)
    found = Steps(tmp_path).run("a", 1, lambda _: Counts(pairs=4, names=()), Counts)
    assert found.pairs == 4


def test_a_result_must_be_of_its_type(tmp_path):
    with pytest.raises(ValueError, match="str"):
        Steps(tmp_path).run("a", 1, lambda _: [1, 2], list[str])  # type: ignore[arg-type]
    log = []
    run(tmp_path, {"a": 1}, log)
    assert log == [("a", True)]  # it was not noted as done


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
        Steps(tmp_path).run("a", 1, fail, str)
    log = []
    run(tmp_path, {"a": 1}, log)
    assert log == [("a", True)]
    with pytest.raises(KeyboardInterrupt):
        Steps(tmp_path).run("a", 2, fail, str)
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


def test_seconds_are_remembered(tmp_path):
    first = run(tmp_path, {"a": 1}, []).seconds
    assert run(tmp_path, {"a": 1}, []).seconds == first
    assert json.loads((tmp_path / "a.step.json").read_text())["is_done"]


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UnwritableError):
        Steps(tmp_path / "file" / "folder")


def test_a_marker_is_of_its_inputs(tmp_path):
    marker = tmp_path / "cache.json"
    assert not is_current(marker, fingerprint("a", 1))
    mark(marker, fingerprint("a", 1))
    assert is_current(marker, fingerprint("a", 1))
    assert not is_current(marker, fingerprint("a", 2))
    marker.write_text("{")
    assert not is_current(marker, fingerprint("a", 1))


def test_fingerprints_tell_values_apart():
    values = (1, "1", [1], {"a": 1}, None, Counts(pairs=1, names=()), np.array([1.5]))
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})


def test_changes_are_named():
    noted = {"epochs": 30, "batch_size": 8, "old": 1}
    assert describe_changes(noted, {"epochs": 30, "batch_size": 8}) == ""
    assert describe_changes(noted, {"epochs": 40, "batch_size": 8}) == "epochs 30 then, 40 now"
    assert describe_changes(noted, {"batch_size": 9, "seed": 1}, {"seed": 1}) == (
        "batch size 8 then, 9 now"
    )
