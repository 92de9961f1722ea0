"""A verb that is stopped says what it kept and how to go on, and ends as its signal says."""

import errno
import os
import signal
import subprocess
import sys

import pytest

from vioapr.cli import fuse as verb
from vioapr.cli.going_on import describe_stop, exit_code_of
from vioapr.errors import DiskFullError
from vioapr.work.stopping import Stopped


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "word"),
    [
        (signal.SIGINT, 130, "interrupted"),
        (signal.SIGTERM, 143, "terminated"),
        (signal.SIGHUP, 129, "terminated"),
    ],
)
def test_a_signal_ends_a_verb_without_traceback_or_rest(walk_dir, tmp_path, number, code, word):
    """While its output is being written."""
    script = (
        "import sys, time; from vioapr.cli import fuse, main\n"
        "from vioapr.files.atomic import replacing\n"
        "def write(path, fused, overwrite):\n"
        "    with replacing(path):\n"
        "        print('writing', flush=True); time.sleep(60)\n"
        "fuse.write_fused_csv = write; sys.exit(main())"
    )
    words = ["fuse", "--apr", walk_dir / "apr_net.tum", "--vio", walk_dir / "vio_sim.tum"]
    out = tmp_path / "out" / "fused.csv"
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", script, *words, "--out", out]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment) as process:
        assert process.stdout is not None
        while "writing" not in process.stdout.readline():
            assert process.poll() is None
        process.send_signal(number)
        _, said = process.communicate(timeout=30)
    assert process.returncode == code
    assert said == f"{word}: no file is half-written: run it again\n"
    assert not list(out.parent.iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["map", "scene"], "finished steps are kept: run it again to go on"),
        (["import", "stray", "x"], "finished recordings are kept"),
        (["train", "scene"], "--resume"),
        (["localize"], "no file is half-written"),
        ([], "run it again"),
    ],
)
def test_every_verb_says_how_to_go_on(words, said):
    for stop in (KeyboardInterrupt(), Stopped(signal.SIGINT)):
        assert describe_stop(stop, words).startswith("interrupted: ")
        assert said in describe_stop(stop, words)
        assert exit_code_of(stop) == 130


def test_what_the_work_knows_is_said_instead():
    stop = Stopped(signal.SIGTERM, "epoch 3 is kept")
    assert describe_stop(stop, ["train"]) == "terminated: epoch 3 is kept"
    assert exit_code_of(stop) == 143


def test_a_full_disk_says_how_to_go_on(fails, walk_dir, tmp_path, monkeypatch):
    def write(path, fused, overwrite):
        raise DiskFullError.of(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    monkeypatch.setattr(verb, "write_fused_csv", write)
    words = ("fuse", "--apr", walk_dir / "apr_net.tum", "--vio", walk_dir / "vio_sim.tum")
    line = fails(*words, "--out", tmp_path / "fused.csv")
    assert line.endswith("No space left on device. Free some space; no file is half-written: "
                         "run it again")  # fmt: skip
