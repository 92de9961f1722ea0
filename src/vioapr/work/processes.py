"""Which of several processes that work together this one is."""

from __future__ import annotations

import os


def is_first_process() -> bool:
    """Whether this process is the one of all that train together that writes and speaks."""
    return all(os.environ.get(name, "0") == "0" for name in ("LOCAL_RANK", "NODE_RANK"))
