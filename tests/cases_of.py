"""The folders of small wrong inputs with right answers, beside the shared data."""

import os
from pathlib import Path

import pytest


def case_folder(name: str, group: str = "formats") -> Path:
    """The folder of a case, e.g. "01-comma-tum"; skips the test where it is absent."""
    data = os.environ.get("VIOAPR_DATA")
    folder = Path(data).parent / "cases" / group / name if data else None
    if folder is None or not folder.is_dir():
        pytest.skip(f"the case {name} is not on this machine (VIOAPR_DATA's neighbour cases/)")
    return folder
