"""Fixtures and backends that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tests.localizers import exporter_of, model_of  # noqa: F401  (fixtures)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real data, named by VIOAPR_DATA."""
    folder = os.environ.get("VIOAPR_DATA")
    if not folder:
        pytest.skip("real data needed: set VIOAPR_DATA to its folder")
    if not Path(folder).is_dir():
        pytest.skip(f"real data needed: VIOAPR_DATA names {folder}, which is not a folder")
    return Path(folder)


@pytest.fixture(scope="session")
def bench_dir(data_dir: Path) -> Path:
    """The prepared fusion benchmark."""
    return data_dir / "bench"


@pytest.fixture(params=["numpy", "torch", "array_api_strict"])
def xp(request: pytest.FixtureRequest):
    """An Array API namespace."""
    return pytest.importorskip(
        {"torch": "array_api_compat.torch"}.get(request.param, request.param),
        reason=f"{request.param} is not installed",
    )


@pytest.fixture
def one_thread():
    """PyTorch keeps to one thread: tests run beside others."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def rendering() -> None:
    """For tests that render: skipped, with the reason, where that is not possible."""
    from vioapr.errors import VioAprError
    from vioapr.simulation.courtyard.context import create_context

    try:
        create_context().release()
    except VioAprError as error:
        pytest.skip(str(error))
