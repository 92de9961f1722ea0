"""A served folder with one empty scene, and a client that need not know about sockets."""

from __future__ import annotations

import pytest
from tests.server.captures import TOKEN


@pytest.fixture(autouse=True)
def _web():
    """Skips, with the reason, where the server cannot run."""
    for name in ("starlette", "uvicorn", "trustme", "segno"):
        pytest.importorskip(name, reason="the extra web is not installed")
    pytest.importorskip("httpx2", reason="httpx2, starlette's client for tests, is not installed")


@pytest.fixture
def served(tmp_path):
    from vioapr.scene.scene import Scene
    from vioapr.server.layout import ServedFolder

    (tmp_path / "places").mkdir()
    Scene.create(tmp_path / "places" / "court", "Courtyard", is_outdoor=True)
    return ServedFolder.open(tmp_path / "places")


@pytest.fixture
def open_client(served):
    """Opens a client of a fresh server for the folder; jobs run while it is open in a `with`."""
    from starlette.testclient import TestClient

    from vioapr.server.app import make_app

    def call(**options):
        return TestClient(make_app(served, TOKEN, **options))

    return call


@pytest.fixture
def client(open_client):
    return open_client()
