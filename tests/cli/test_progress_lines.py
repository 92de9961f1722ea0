import io

import pytest
from rich.console import Console

from vioapr.cli import console
from vioapr.cli.console import log, progress
from vioapr.cli.progress_lines import ProgressLines, format_duration, format_rate


class Clock:
    """A clock that is set by hand."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


def test_lines_come_after_ten_seconds_and_then_every_thirty():
    lines, clock = [], Clock()
    with ProgressLines("predicting", 1000, lines.append, clock) as watched:
        for _ in range(100):
            clock.now_s += 1
            watched.advance(5)
    assert lines == [
        "predicting: 50 of 1000 (5%), 5/s, 10 s so far, ETA 3 min 10 s",
        "predicting: 200 of 1000 (20%), 5/s, 40 s so far, ETA 2 min 40 s",
        "predicting: 350 of 1000 (35%), 5/s, 1 min 10 s so far, ETA 2 min 10 s",
        "predicting: 500 of 1000 (50%), 5/s, 1 min 40 s so far, ETA 1 min 40 s",
        "predicting: done in 1 min 40 s",
    ]


def test_short_work_says_nothing():
    lines, clock = [], Clock()
    with ProgressLines("reading", 10, lines.append, clock) as watched:
        for _ in range(10):
            clock.now_s += 0.9
            watched.advance()
    assert lines == []


def test_work_of_unknown_length_has_no_share():
    lines, clock = [], Clock()
    with ProgressLines("reading", 0, lines.append, clock) as watched:
        clock.now_s += 20
        watched.advance()
    assert lines[0] == "reading: 1 of 0, 20 s each, 20 s so far, ETA 0 s"


def test_without_a_terminal_lines_go_to_standard_error(capsys, monkeypatch):
    monkeypatch.setattr("vioapr.cli.progress_lines.FIRST_S", 0.0)
    with progress("mapping", 2) as tick:
        tick()
        tick()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("mapping: 1 of 2 (50%), ")
    assert err.endswith("mapping: done in 0 s\n")
    assert "\x1b" not in err
    log("[brackets] stay")
    assert capsys.readouterr().err == "[brackets] stay\n"


@pytest.mark.parametrize(
    ("term", "is_watched"), [("xterm", True), ("dumb", False), ("unknown", False)]
)
def test_a_dumb_terminal_gets_lines(term, is_watched, monkeypatch):
    terminal = Console(file=io.StringIO(), force_terminal=True, _environ={"TERM": term})
    monkeypatch.setattr(console, "error_console", terminal)
    assert console.is_watched() == is_watched


def test_durations_and_rates_are_as_people_say_them():
    assert [format_duration(s) for s in (0.4, 59, 60, 185, 3599.6, 7800)] == [
        "0 s", "59 s", "1 min 00 s", "3 min 05 s", "1 h 00 min", "2 h 10 min",
    ]  # fmt: skip
    assert [format_rate(r) for r in (0, 123.4, 1, 0.25)] == ["0/s", "123/s", "1/s", "4 s each"]
