"""Where a phone is in a real place: absolute poses made robust by visual-inertial odometry.

The names below are what a user's script needs; `docs/reference/api.md` describes them. They are
imported when they are first used, so that `import vioapr` is quick.

    from vioapr import evaluate, fuse, read_trajectory

    fused = fuse(read_trajectory("apr.tum"), read_trajectory("vio.csv"))
    print(evaluate(fused, read_trajectory("gt.tum")).summary)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from vioapr._version import __version__

if TYPE_CHECKING:
    from vioapr.errors import AssociationError as AssociationError
    from vioapr.errors import FileError as FileError
    from vioapr.errors import FormatError as FormatError
    from vioapr.errors import MissingExtraError as MissingExtraError
    from vioapr.errors import ParameterError as ParameterError
    from vioapr.errors import VioAprError as VioAprError
    from vioapr.evaluation.accuracy import Accuracy as Accuracy
    from vioapr.evaluation.accuracy import evaluate as evaluate
    from vioapr.formats.conversion import convert_file as convert_file
    from vioapr.formats.inspection import inspect_file as inspect_file
    from vioapr.formats.registry import read_trajectory as read_trajectory
    from vioapr.formats.registry import write_trajectory as write_trajectory
    from vioapr.fusion.calibrated import find_pair as find_pair
    from vioapr.fusion.calibrated import params_from_calibration as params_from_calibration
    from vioapr.fusion.calibrated import read_calibration as read_calibration
    from vioapr.fusion.easing import EasingParams as EasingParams
    from vioapr.fusion.fuse import fuse as fuse
    from vioapr.fusion.fused_walk import FusedWalk as FusedWalk
    from vioapr.fusion.localizer import Localizer as Localizer
    from vioapr.fusion.methods import METHODS as METHODS
    from vioapr.fusion.types import Estimate as Estimate
    from vioapr.fusion.types import LocalizationState as LocalizationState
    from vioapr.fusion.types import Status as Status
    from vioapr.geometry.rigid import Rigid3 as Rigid3
    from vioapr.runtime.localizer import OnnxLocalizer as OnnxLocalizer
    from vioapr.scene.recording import Recording as Recording
    from vioapr.scene.scene import Scene as Scene
    from vioapr.scene.walks import WalkFiles as WalkFiles
    from vioapr.scene.walks import find_walks as find_walks
    from vioapr.scene.writer import RecordingWriter as RecordingWriter
    from vioapr.trajectory import Trajectory as Trajectory

_HOME = {
    "Accuracy": "vioapr.evaluation.accuracy",
    "AssociationError": "vioapr.errors",
    "EasingParams": "vioapr.fusion.easing",
    "Estimate": "vioapr.fusion.types",
    "FileError": "vioapr.errors",
    "FormatError": "vioapr.errors",
    "FusedWalk": "vioapr.fusion.fused_walk",
    "LocalizationState": "vioapr.fusion.types",
    "Localizer": "vioapr.fusion.localizer",
    "METHODS": "vioapr.fusion.methods",
    "MissingExtraError": "vioapr.errors",
    "OnnxLocalizer": "vioapr.runtime.localizer",
    "ParameterError": "vioapr.errors",
    "Recording": "vioapr.scene.recording",
    "RecordingWriter": "vioapr.scene.writer",
    "Rigid3": "vioapr.geometry.rigid",
    "Scene": "vioapr.scene.scene",
    "Status": "vioapr.fusion.types",
    "Trajectory": "vioapr.trajectory",
    "VioAprError": "vioapr.errors",
    "WalkFiles": "vioapr.scene.walks",
    "convert_file": "vioapr.formats.conversion",
    "evaluate": "vioapr.evaluation.accuracy",
    "find_pair": "vioapr.fusion.calibrated",
    "find_walks": "vioapr.scene.walks",
    "fuse": "vioapr.fusion.fuse",
    "inspect_file": "vioapr.formats.inspection",
    "params_from_calibration": "vioapr.fusion.calibrated",
    "read_calibration": "vioapr.fusion.calibrated",
    "read_trajectory": "vioapr.formats.registry",
    "write_trajectory": "vioapr.formats.registry",
}
"""The module of every public name."""

__all__ = [*_HOME, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
