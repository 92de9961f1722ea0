"""Jobs: verbs in processes of their own, which outlive the server, and say how they ended."""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

pytest.importorskip("fcntl", reason="jobs need the locks of Linux and macOS")

from vioapr.errors import FileMissingError, LockedError, ParameterError
from vioapr.server.jobs import Jobs
from vioapr.work.held import hold, is_held


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "root").mkdir()
    return tmp_path


@pytest.fixture
def open_jobs(folder):
    """Jobs whose verb `sleep S` sleeps, `fail` fails, and everything else prints its arguments."""
    program = (sys.executable, "-c", VERB)
    return lambda: Jobs(folder / "jobs", folder / "root", program)


VERB = """
import os, sys, time
verb, *rest = sys.argv[1:]
if verb == "sleep":
    print("sleeping", flush=True)
    time.sleep(float(rest[0]))
    print("slept")
elif verb == "progress":
    with open(os.environ["VIOAPR_PROGRESS_FILE"], "w") as file:
        file.write('{"format": "vioapr progress", "version": 1, "title": "t", "done": 3}')
    time.sleep(60)
elif verb == "fail":
    print("error: expected more, got less", file=sys.stderr)
    sys.exit(2)
else:
    print(os.getcwd(), *rest)
"""


def run(jobs, *ids, until=("done", "failed", "stopped", "interrupted"), timeout_s=30.0):
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        jobs.advance()
        states = [jobs.get(id_).job.state for id_ in ids]
        if all(state in until for state in states):
            return states
        time.sleep(0.02)
    raise AssertionError(states)


def test_a_job_runs_in_the_served_folder_and_says_how_it_ended(open_jobs, folder):
    jobs = open_jobs()
    good, bad = jobs.submit("a", ["print", "x", "y"]), jobs.submit("b", ["fail"])
    assert good.state == "queued"
    assert run(jobs, good.id, bad.id) == ["done", "failed"]
    assert jobs.read_log(good.id, 0, 1000).decode() == f"{folder / 'root'} x y\n"
    assert jobs.read_log(good.id, 3, 4) == f"{folder / 'root'}".encode()[3:7]
    ended = jobs.get(bad.id).job
    assert (ended.exit_code, ended.message) == (2, "expected more, got less")
    assert ended.ended_at >= ended.started_at >= ended.created_at
    assert [answer.job.id for answer in jobs.all()] == sorted([good.id, bad.id], reverse=True)
    assert open_jobs().get(bad.id).job == ended


def test_an_end_is_told_once_whoever_saw_it_first(open_jobs):
    jobs = open_jobs()
    job = jobs.submit("a", ["print"])
    assert jobs.advance() == []
    wait_for(lambda: jobs.get(job.id).job.state == "done")
    assert [ended.id for ended in jobs.advance()] == [job.id]
    assert jobs.advance() == []


def test_jobs_of_a_lane_run_one_after_the_other(open_jobs):
    jobs = open_jobs()
    first = jobs.submit("capture", ["sleep", "0.5"], scene="court")
    same = jobs.submit("import", ["print"], scene="court")
    other = jobs.submit("import", ["print"], scene="hall")
    jobs.advance()
    assert jobs.get(same.id).job.state == "queued"
    assert run(jobs, other.id) == ["done"]
    assert jobs.get(first.id).job.state == "running"
    assert run(jobs, first.id, same.id) == ["done", "done"]
    assert jobs.get(same.id).job.started_at >= jobs.get(first.id).job.ended_at


def test_a_job_goes_on_without_the_server_and_the_next_one_finds_its_end(open_jobs):
    jobs = open_jobs()
    job = jobs.submit("a", ["sleep", "1"])
    queued = jobs.submit("a", ["print"])
    jobs.advance()
    run(jobs, job.id, until=("running",))
    later = open_jobs()  # the first one is as good as dead: nobody calls it any more
    assert later.get(job.id).job.state == "running"
    assert run(later, job.id, queued.id) == ["done", "done"]
    assert b"slept" in later.read_log(job.id, 0, 1000)
    assert jobs.get(job.id).job.state == "done"  # so that it lets go of the process


def wait_for(condition, timeout_s=20.0):
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_a_job_whose_processes_died_is_interrupted_and_can_be_run_again(open_jobs):
    jobs = open_jobs()
    job = jobs.submit("a", ["sleep", "60"])
    jobs.advance()
    wait_for(lambda: b"sleeping" in jobs.read_log(job.id, 0, 1000) and jobs.get(job.id).job.pid)
    os.killpg(jobs.get(job.id).job.pid, signal.SIGKILL)
    assert run(jobs, job.id) == ["interrupted"]
    assert "machine" in jobs.get(job.id).job.message
    assert open_jobs().get(job.id).job.state == "interrupted"
    assert jobs.again(job.id).state == "queued"
    jobs.advance()
    run(jobs, job.id, until=("running",))
    jobs.stop(job.id)
    assert run(jobs, job.id) == ["stopped"]


def test_a_job_is_stopped(open_jobs):
    jobs = open_jobs()
    job, queued = jobs.submit("a", ["sleep", "60"]), jobs.submit("a", ["print"])
    jobs.advance()
    assert jobs.stop(queued.id).state == "stopped"
    with pytest.raises(ParameterError, match="expected a job that has ended, got one"):
        jobs.again(job.id)
    wait_for(lambda: b"sleeping" in jobs.read_log(job.id, 0, 1000))
    jobs.stop(job.id)
    assert run(jobs, job.id) == ["stopped"]
    assert jobs.get(job.id).job.exit_code == -signal.SIGTERM


def test_how_far_a_job_has_come(open_jobs):
    jobs = open_jobs()
    job = jobs.submit("a", ["progress"])
    jobs.advance()
    wait_for(lambda: jobs.get(job.id).progress is not None)
    said = jobs.get(job.id).progress
    assert (said.title, said.done, said.total) == ("t", 3, 0)
    jobs.stop(job.id)
    assert run(jobs, job.id) == ["stopped"]
    assert jobs.get(job.id).progress is None


def test_unknown_and_half_made_jobs(open_jobs, folder):
    (folder / "jobs" / "half").mkdir(parents=True)
    jobs = open_jobs()
    assert jobs.all() == []
    for call in (jobs.get, jobs.stop, jobs.again):
        with pytest.raises(FileMissingError):
            call("nothing")
    with pytest.raises(ParameterError):
        jobs.get("../jobs")


def test_a_lock_is_held_until_every_copy_is_closed(tmp_path):
    path = tmp_path / "lock"
    assert not is_held(path)
    file = hold(path)
    copy = os.dup(file)
    os.close(file)
    assert is_held(path)
    with pytest.raises(LockedError):
        hold(path)
    os.close(copy)
    assert not is_held(path)
