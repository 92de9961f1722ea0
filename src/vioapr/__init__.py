"""Where a phone is in a real place: absolute poses made robust by visual-inertial odometry."""

from vioapr.errors import VioAprError
from vioapr.fusion.localizer import Localizer
from vioapr.fusion.types import Estimate, Status
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = ["Estimate", "Localizer", "Rigid3", "Status", "Trajectory", "VioAprError", "__version__"]
