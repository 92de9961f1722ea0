"""Being stopped can be put off to where work may end, but not twice."""

import os
import signal
import threading

import pytest

from vioapr.work.stopping import SIGNALS, Stopped, raise_on_signals, stop_put_off


@pytest.fixture
def handlers():
    """Handlers of signals are as before after the test."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.usefixtures("handlers")
def test_signals_raise(number):
    raise_on_signals()
    with pytest.raises(Stopped) as caught:
        os.kill(os.getpid(), number)
    assert caught.value.signal_number == number
    assert isinstance(caught.value, KeyboardInterrupt)


@pytest.mark.usefixtures("handlers")
def test_ignored_signals_stay_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    raise_on_signals()
    os.kill(os.getpid(), signal.SIGHUP)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("handlers")
def test_a_stop_is_put_off_once(number):
    raise_on_signals()
    with stop_put_off() as pending:
        assert pending.signal_number is None
        os.kill(os.getpid(), number)
        assert pending.signal_number == number
        with pytest.raises(Stopped):
            os.kill(os.getpid(), number)
    with pytest.raises(Stopped):  # as before
        os.kill(os.getpid(), number)


def test_other_threads_are_left_alone():
    found = []

    def work():
        with stop_put_off() as pending:
            found.append(pending.signal_number)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [None]
