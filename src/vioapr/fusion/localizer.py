"""The streaming face of every fusion method: one call a frame."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from vioapr.errors import ParameterError
from vioapr.formats.matrix_order import are_transposed, explain_last_row, explain_transposed
from vioapr.fusion.methods import DEFAULT_METHOD, get_method
from vioapr.fusion.types import Estimate, FrameInput, Status
from vioapr.geometry.rigid import Rigid3
from vioapr.trajectory import UNIT_TOLERANCE

_IDENTITY = Rigid3.identity()


class Localizer:
    """Fuses predictions and odometry as they arrive, with memory that does not grow.

    Example:
        >>> localizer = Localizer("vio-apr")
        >>> estimate = localizer.update(0.0, apr_world_from_cam, vio_from_cam)
        >>> if estimate.status != Status.UNLOCALIZED:
        ...     place_content(estimate.world_from_vio)
    """

    def __init__(self, method: str = DEFAULT_METHOD, params: Any = None) -> None:
        """Start without any knowledge.

        Args:
            method: Name of a method, e.g. "vio-apr".
            params: The method's parameters (e.g. `VioAprParams`), or None for its defaults.

        Raises:
            ParameterError: Unknown method, or parameters of another method.
        """
        self._method = get_method(method)
        self._params = self._method.params_type() if params is None else params
        if not isinstance(self._params, self._method.params_type):
            raise ParameterError(
                f"expected {self._method.params_type.__name__} for method {method!r}, "
                f"got {type(params).__name__}"
            )
        self.reset()

    def reset(self) -> None:
        """Forget everything, e.g. for another place."""
        self._state = self._method.init(self._params, (), np.zeros(()))
        self._last_timestamp_s = -np.inf

    def update(
        self,
        timestamp_s: float,
        apr_world_from_cam: Rigid3 | ArrayLike | None,
        vio_from_cam: Rigid3 | ArrayLike | None,
        tracking_ok: bool = True,
        *,
        tracking_reset: bool = False,
        apr_sigma_m: float | None = None,
        apr_sigma_deg: float | None = None,
    ) -> Estimate:
        """Take in a frame and say where the camera is.

        Poses are `Rigid3` or 4x4 matrices, in metres, with one choice of camera axes for
        both (OpenCV's, if the map's are).

        Args:
            timestamp_s: Time of the image, seconds, later than the last frame's.
            apr_world_from_cam: The regressor's pose in the map, or None for a frame without.
            vio_from_cam: The tracker's pose in its own world; None if it has none.
            tracking_ok: Whether the tracker trusts its pose. If not, this frame is
                unlocalized and the next tracked frame starts a new segment.
            tracking_reset: Whether the tracker's world is a new one since this frame.
            apr_sigma_m: The standard deviation of the predicted position per axis, in metres,
                that the regressor states; None, NaN or not above 0 where it states none. Only
                its ratio to the usual one matters, and to method `chain` alone.
            apr_sigma_deg: The same of its orientation, degrees.

        Returns:
            The estimate, as known now. Its `status` is a `Status`.

        Raises:
            ParameterError: A pose that is not finite or not rigid, or a time going back.
        """
        if not np.isfinite(timestamp_s):
            raise ParameterError(f"timestamp_s: expected a finite number, got {timestamp_s}")
        if timestamp_s <= self._last_timestamp_s:
            raise ParameterError(
                f"timestamp_s: expected a time after the last frame's "
                f"({self._last_timestamp_s:.6f} s), got {timestamp_s:.6f} s"
            )
        is_tracked = bool(tracking_ok) and vio_from_cam is not None
        frame = FrameInput(
            np.asarray(timestamp_s, dtype=np.float64),
            _to_rigid("apr_world_from_cam", apr_world_from_cam),
            np.asarray(apr_world_from_cam is not None),
            _to_rigid("vio_from_cam", vio_from_cam if is_tracked else None),
            np.asarray(is_tracked),
            np.asarray(bool(tracking_reset)),
            None if apr_sigma_m is None else np.asarray(float(apr_sigma_m)),
            None if apr_sigma_deg is None else np.asarray(np.deg2rad(float(apr_sigma_deg))),
        )
        self._state, estimate = self._method.step(self._params, self._state, frame)
        self._last_timestamp_s = float(timestamp_s)
        return estimate._replace(
            status=Status(int(estimate.status)), confirmed_run=int(estimate.confirmed_run)
        )


def _to_rigid(name: str, value: Rigid3 | ArrayLike | None) -> Rigid3:
    """A user's pose as float64 `Rigid3` of shape (), checked; the identity for None."""
    if value is None:
        return _IDENTITY
    if not isinstance(value, Rigid3):
        matrix = np.asarray(value, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise ParameterError(f"{name}: expected a 4x4 matrix or a Rigid3, got {matrix.shape}")
        if not np.isfinite(matrix).all():
            raise ParameterError(f"{name}: expected finite numbers, got NaN or inf")
        if are_transposed(matrix[None])[0]:
            raise ParameterError(f"{name}: {explain_transposed(matrix)} Give its transpose")
        rotation = matrix[:3, :3]
        determinant = float(np.linalg.det(rotation))
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if error > UNIT_TOLERANCE or determinant < 0:
            raise ParameterError(
                f"{name}: expected a rotation (orthonormal, not mirrored) in the upper left 3x3 "
                f"of the matrix, got determinant {determinant:.4g}"
            )
        if explained := explain_last_row(matrix):
            raise ParameterError(f"{name}: {explained}")
        value = Rigid3.from_matrix(matrix)
    pose = cast("Rigid3", value)
    position_m = np.asarray(pose.translation_m, dtype=np.float64)
    quat = np.asarray(pose.quat_xyzw, dtype=np.float64)
    if position_m.shape != (3,) or quat.shape != (4,):
        raise ParameterError(
            f"{name}: expected one pose, a position of shape (3,) and a quaternion xyzw of "
            f"shape (4,), got {position_m.shape} and {quat.shape}"
        )
    if not (np.isfinite(position_m).all() and np.isfinite(quat).all()):
        raise ParameterError(f"{name}: expected finite numbers, got NaN or inf")
    length = float(np.sqrt(quat @ quat))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise ParameterError(f"{name}: expected a unit quaternion, got one of norm {length:.6g}")
    return Rigid3(position_m, quat / length)
