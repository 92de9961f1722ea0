"""Running the command line inside the tests' process."""

from __future__ import annotations

import pytest

from vioapr.cli import main
from vioapr.cli.console import start_verb
from vioapr.scene.walks import write_walk
from vioapr.simulation.walks import WalkParams, simulate_walk


@pytest.fixture(autouse=True)
def _messages_on_standard_output():
    """Undoes what a verb that is called as a function did to the console."""
    yield
    start_verb()


@pytest.fixture
def run(capsys):
    """Runs `vioapr ARGUMENTS`; returns exit code, standard output and standard error."""

    def call(*arguments):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = stop.code or 0
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture
def fails(run):
    """Runs `vioapr ARGUMENTS`, which must fail with one line and code 2; returns the line."""

    def call(*arguments):
        code, _, err = run(*arguments)
        assert code == 2, err
        lines = err.strip().splitlines()
        assert len(lines) == 1, err
        assert lines[0].startswith("error: ")
        return lines[0].removeprefix("error: ")

    return call


@pytest.fixture
def walk_dir(tmp_path):
    """A folder Set/walk with a walk's files."""
    walk = simulate_walk(WalkParams(duration_s=30), seed=4)
    folder = tmp_path / "Set" / "walk"
    write_walk(folder, gt=walk.gt, vios={"sim": walk.vio}, aprs={"net": walk.apr})
    return folder
