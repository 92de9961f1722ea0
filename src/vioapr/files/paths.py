"""Paths as people give them: the package's own functions take `Path`, its public face takes all."""

from __future__ import annotations

import os

AnyPath = str | os.PathLike[str]
"""A path as text, or an object of one."""
