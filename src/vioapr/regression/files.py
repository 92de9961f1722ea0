"""Names of the files that training leaves, for whoever looks without PyTorch."""

from __future__ import annotations

from pathlib import Path

REGRESSOR_FILE, STATE_FILE = "regressor.safetensors", "state.safetensors"


def note_of(path: Path) -> Path:
    """The copy of a file's header, for people and for a quick look."""
    return path.with_suffix(".json")
