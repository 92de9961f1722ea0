import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from vioapr.errors import FormatError, MappingError, ParameterError
from vioapr.work.child import run_in_child


def count_to(number, *, tick, step=1):
    print("must not disturb the messages")
    os.write(1, b"nor must this, past Python")
    for _ in range(0, number, step):
        tick()
    return {"pid": os.getpid(), "number": number}


def complain(kind, *arguments, tick):
    raise kind(*arguments)


def die(*, tick):
    os.write(2, b"terminate called\n  what():  the disk is full\n")
    os.kill(os.getpid(), signal.SIGABRT)


def fail(*, tick):
    raise RuntimeError("a bug")


def work_for_long(note, *, tick):
    note.write_text(str(os.getpid()))
    tick()
    time.sleep(60)


def is_alive(pid):
    """Whether a process runs; one that ended and was not waited for does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state not in "ZX"


def wait_until(condition):
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_results_and_progress_come_back(capfd):
    ticks = []
    answer = run_in_child(count_to, 10, step=2, tick=lambda: ticks.append(1))
    assert answer["number"] == 10
    assert answer["pid"] != os.getpid()
    assert len(ticks) == 5
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [ParameterError("expected this, got that"), FormatError("a.txt", "not so", 3)]
)
def test_errors_come_back_as_they_are(error):
    given = (
        (error.path, error.problem, error.line) if isinstance(error, FormatError) else error.args
    )
    with pytest.raises(type(error)) as caught:
        run_in_child(complain, type(error), *given, tick=int)
    assert str(caught.value) == str(error)
    assert vars(caught.value) == vars(error)


@pytest.mark.slow
@pytest.mark.parametrize(("function", "reason"), [(die, "the disk is full"), (fail, "a bug")])
def test_a_death_gives_a_reason(function, reason):
    with pytest.raises(MappingError, match=f"process ended: .*{reason}.*run again to resume"):
        run_in_child(function, tick=int)


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_an_interruption_ends_the_child(tmp_path):
    def interrupt():
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run_in_child(work_for_long, tmp_path / "pid", tick=interrupt)
    assert time.monotonic() - start < 30
    assert not is_alive(int((tmp_path / "pid").read_text()))


SCRIPT = """
from pathlib import Path
from tests.work.test_child import count_to, work_for_long
from vioapr.work.child import run_in_child
print("once")
run_in_child({call}, tick=int)
"""


def start_script(folder, call):
    """A process of a script that does not guard what it does by its name."""
    script = folder / "script.py"
    script.write_text(SCRIPT.format(call=call))
    path = os.pathsep.join(p or str(Path.cwd()) for p in sys.path)
    return subprocess.Popen(
        [sys.executable, script],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.slow
def test_a_script_needs_no_guard(tmp_path):
    output, _ = start_script(tmp_path, "count_to, 3").communicate(timeout=60)
    assert output == "once\n"


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone tells children of a death")
def test_children_die_with_their_parent(tmp_path):
    note = tmp_path / "pid"
    parent = start_script(tmp_path, f"work_for_long, Path({str(note)!r})")
    with parent:
        wait_until(lambda: note.exists() and note.read_text())
        parent.kill()
    wait_until(lambda: not is_alive(int(note.read_text())))
