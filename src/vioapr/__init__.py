"""Where a phone is in a real place: absolute poses made robust by visual-inertial odometry.

The names below are what a user's script needs. They are imported when they are first used, so
that `import vioapr` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from vioapr._version import __version__

if TYPE_CHECKING:
    from vioapr.errors import VioAprError as VioAprError
    from vioapr.fusion.localizer import Localizer as Localizer
    from vioapr.fusion.types import Estimate as Estimate
    from vioapr.fusion.types import Status as Status
    from vioapr.geometry.rigid import Rigid3 as Rigid3
    from vioapr.trajectory import Trajectory as Trajectory

_HOME = {
    "Estimate": "vioapr.fusion.types",
    "Localizer": "vioapr.fusion.localizer",
    "Rigid3": "vioapr.geometry.rigid",
    "Status": "vioapr.fusion.types",
    "Trajectory": "vioapr.trajectory",
    "VioAprError": "vioapr.errors",
}
"""The module of every public name."""

__all__ = [*_HOME, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
