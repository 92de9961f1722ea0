"""The runtime needs onnxruntime only: proved where nothing else is installed."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def clean_python(tmp_path_factory):
    """A new environment with the package, built as a user gets it, and its extra `runtime`."""
    folder = tmp_path_factory.mktemp("clean") / "venv"
    # This environment's pip installs into it, and compiles nothing that is not imported.
    create = [sys.executable, "-m", "venv", "--without-pip", folder]
    subprocess.run(create, check=True, timeout=120)
    python = folder / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    install += ["--no-compile", f"{REPOSITORY}[runtime]"]
    done = subprocess.run(install, capture_output=True, text=True, timeout=600)
    if done.returncode and "No matching distribution" in done.stderr:
        pytest.skip(f"packages cannot be installed here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return python


def run(python, *arguments, folder):
    return subprocess.run(
        [python, *arguments], capture_output=True, text=True, timeout=300, cwd=folder
    )


def test_the_demo_runs_without_pytorch(clean_python, tmp_path):
    torch = "import importlib.util as u, sys; sys.exit(u.find_spec('torch') is not None)"
    assert run(clean_python, "-c", torch, folder=tmp_path).returncode == 0
    done = run(clean_python, "-m", "vioapr", "demo", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "chain" in done.stdout
    assert (tmp_path / "vioapr-demo" / "report" / "index.html").exists()
    says_what_is_missing = run(
        clean_python, "-m", "vioapr", "train", "vioapr-demo/courtyard", folder=tmp_path
    )
    assert says_what_is_missing.returncode == 2
    assert "pip install 'vioapr[train]'" in says_what_is_missing.stderr
