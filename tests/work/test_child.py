import os
import signal

import pytest

from vioapr.errors import MappingError, ParameterError
from vioapr.work.child import run_isolated


def count_to(number, *, tick, step=1):
    print("must not disturb the messages")
    for _ in range(0, number, step):
        tick()
    return {"pid": os.getpid(), "number": number}


def complain(*, tick):
    raise ParameterError("expected this, got that")


def die(*, tick):
    os.write(2, b"terminate called\n  what():  the disk is full\n")
    os.kill(os.getpid(), signal.SIGABRT)


def fail(*, tick):
    raise RuntimeError("a bug")


def test_results_and_progress_come_back():
    ticks = []
    answer = run_isolated(count_to, 10, step=2, tick=lambda: ticks.append(1))
    assert answer["number"] == 10
    assert answer["pid"] != os.getpid()
    assert len(ticks) == 5


def test_errors_come_back_as_they_are():
    with pytest.raises(MappingError, match="^expected this, got that$"):
        run_isolated(complain, tick=int)


@pytest.mark.parametrize(("function", "reason"), [(die, "the disk is full"), (fail, "a bug")])
def test_a_death_gives_a_reason(function, reason):
    with pytest.raises(MappingError, match=f"process ended: .*{reason}.*run again to resume"):
        run_isolated(function, tick=int)
