import os
import signal
import socket
import subprocess
import sys

import pytest

from vioapr.errors import LockedError, UnwritableError
from vioapr.work.locks import LOCK_FILE, locked_folder

HOLD = """
import sys
from pathlib import Path
from vioapr.work.locks import locked_folder
with locked_folder(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def other(tmp_path):
    """Another process that holds the lock of `tmp_path`."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    pipe = subprocess.PIPE
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_live_process_is_named(tmp_path, other):
    with pytest.raises(LockedError) as caught, locked_folder(tmp_path):
        pass
    message = str(caught.value)
    assert f"{tmp_path}: in use by process {other.pid} on {socket.gethostname()} (-c" in message
    assert "wait until it has ended, or end it" in message


def test_it_is_free_when_the_process_has_gone_on(tmp_path, other):
    other.communicate("")
    with locked_folder(tmp_path):
        assert f'"pid": {os.getpid()}' in (tmp_path / LOCK_FILE).read_text()


def test_a_dead_process_holds_nothing(tmp_path, other):
    os.kill(other.pid, signal.SIGKILL)
    other.wait()
    assert f'"pid": {other.pid}' in (tmp_path / LOCK_FILE).read_text()
    with locked_folder(tmp_path):
        pass


def test_within_a_process_too(tmp_path):
    with locked_folder(tmp_path / "new"):
        again = locked_folder(tmp_path / "new")
        with pytest.raises(LockedError, match=f"process {os.getpid()} "), again:
            pass
    with locked_folder(tmp_path / "new"):
        pass


@pytest.mark.parametrize("content", ["", "{", '{"pid": "x"}', "\xff"])
def test_a_broken_file_is_as_good(tmp_path, content):
    with locked_folder(tmp_path):
        (tmp_path / LOCK_FILE).write_text(content, encoding="latin-1")
        again = locked_folder(tmp_path)
        with pytest.raises(LockedError, match="in use by another process"), again:
            pass


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UnwritableError), locked_folder(tmp_path / "file" / "folder"):
        pass
