"""The streaming face of every fusion method: one call a frame."""

from __future__ import annotations

import json
import logging
import zipfile
from io import BytesIO
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from vioapr.errors import ParameterError
from vioapr.formats.matrix_order import are_transposed, explain_last_row, explain_transposed
from vioapr.fusion.easing import EasingParams
from vioapr.fusion.late import RecentPoses
from vioapr.fusion.methods import DEFAULT_METHOD, get_method
from vioapr.fusion.session import Session, begin, step
from vioapr.fusion.types import Estimate, FrameInput, LocalizationState, Status
from vioapr.geometry.rigid import Rigid3
from vioapr.geometry.tree import tree_leaves, tree_map
from vioapr.trajectory import UNIT_TOLERANCE

_IDENTITY = Rigid3.identity()
_LOG = logging.getLogger(__name__)
_FORMAT, _VERSION = "vioapr localizer memory", 2


class Localizer:
    """Fuses predictions and odometry as they arrive, with memory that does not grow.

    Example:
        >>> localizer = Localizer("vio-apr")
        >>> estimate = localizer.update(0.0, apr_world_from_cam, vio_from_cam)
        >>> if estimate.status != Status.UNLOCALIZED:
        ...     place_content(estimate.world_from_vio)
    """

    def __init__(
        self,
        method: str = DEFAULT_METHOD,
        params: Any = None,
        *,
        easing: EasingParams | None = None,
    ) -> None:
        """Start without any knowledge.

        Args:
            method: Name of a method, e.g. "vio-apr".
            params: The method's parameters (e.g. `VioAprParams`), or None for its defaults.
            easing: How fast content follows corrections; None for the defaults.

        Raises:
            ParameterError: Unknown method, or parameters of another method.
        """
        chosen = get_method(method)
        params = chosen.params_type() if params is None else params
        if not isinstance(params, chosen.params_type):
            raise ParameterError(
                f"expected {chosen.params_type.__name__} for method {method!r}, "
                f"got {type(params).__name__}"
            )
        self._session = Session(chosen, params, easing or EasingParams())
        self.reset()

    def reset(self) -> None:
        """Forget everything, e.g. for another place."""
        self._state = begin(self._session, (), np.zeros(()))
        self._last_timestamp_s = -np.inf
        self._last_vio_from_cam: Rigid3 | None = None
        self._recent = RecentPoses()

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
            tracking_ok: Whether the tracker trusts its pose. If not, `chain` keeps what it knew
                and verifies it afterwards; other methods start again.
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
        apr = None
        if apr_world_from_cam is not None:
            apr = _to_rigid("apr_world_from_cam", apr_world_from_cam)
        vio = None
        if is_tracked and vio_from_cam is not None:
            vio = _to_rigid("vio_from_cam", vio_from_cam)
        sigmas = (apr_sigma_m, apr_sigma_deg)
        estimate = self._step(float(timestamp_s), apr, vio, bool(tracking_reset), *sigmas)
        self._recent.add(float(timestamp_s), vio, tracking_reset=bool(tracking_reset))
        self._last_timestamp_s, self._last_vio_from_cam = float(timestamp_s), vio
        return estimate

    def predict(
        self,
        timestamp_s: float,
        apr_world_from_cam: Rigid3 | ArrayLike,
        *,
        apr_sigma_m: float | None = None,
        apr_sigma_deg: float | None = None,
    ) -> Estimate | None:
        """Take in a prediction that is ready only now, for the picture of an earlier frame.

        For networks that take longer than a frame: call `update` every frame without a
        prediction, and this when one is done, in any order. VIO carries the prediction to the
        newest frame.

        Args:
            timestamp_s: When its picture was taken, on the clock of `update`.
            apr_world_from_cam: The regressor's pose in the map at that time.
            apr_sigma_m: See `update`.
            apr_sigma_deg: See `update`.

        Returns:
            The estimate of the newest frame with it; None where the prediction was dropped, which
            the log says: it is older than 5 s or than the last loss or reset of tracking, newer
            than the newest frame, or the tracker is lost.

        Raises:
            ParameterError: A pose or a time that is not finite, or a pose that is not rigid.
        """
        if not np.isfinite(timestamp_s):
            raise ParameterError(f"timestamp_s: expected a finite number, got {timestamp_s}")
        then = _to_rigid("apr_world_from_cam", apr_world_from_cam)
        now = self._recent.carry(float(timestamp_s), then)
        if now is None:
            _LOG.warning(
                "a prediction for %.3f s is dropped: the tracker's pose of that time is not "
                "known in its world of now (newest frame: %.3f s)",
                timestamp_s,
                self._last_timestamp_s,
            )
            return None
        sigmas = (apr_sigma_m, apr_sigma_deg)
        return self._step(self._last_timestamp_s, now, self._last_vio_from_cam, False, *sigmas)

    def _step(
        self,
        timestamp_s: float,
        apr: Rigid3 | None,
        vio: Rigid3 | None,
        tracking_reset: bool,
        apr_sigma_m: float | None,
        apr_sigma_deg: float | None,
    ) -> Estimate:
        frame = FrameInput(
            np.asarray(timestamp_s, dtype=np.float64),
            _IDENTITY if apr is None else apr,
            np.asarray(apr is not None),
            _IDENTITY if vio is None else vio,
            np.asarray(vio is not None),
            np.asarray(tracking_reset),
            None if apr_sigma_m is None else np.asarray(float(apr_sigma_m)),
            None if apr_sigma_deg is None else np.asarray(np.deg2rad(float(apr_sigma_deg))),
        )
        self._state, estimate = step(self._session, self._state, frame)
        state = estimate.localization_state
        return estimate._replace(
            status=Status(int(estimate.status)),
            confirmed_run=int(estimate.confirmed_run),
            localization_state=None if state is None else LocalizationState(int(state)),
        )

    def save(self) -> bytes:
        """Everything that is known, to go on with later by `restore`.

        Poses of the tracker mean something in its world only. An app that was closed has a new
        one: go on with `update(..., tracking_reset=True)`, which keeps what was learned of the
        regressor and of the tracker.

        Raises:
            ParameterError: The method's memory cannot be saved (pose-graph).
        """
        leaves = list(tree_leaves(self._state))
        if not all(isinstance(leaf, (np.ndarray, np.generic)) for leaf in leaves):
            name = self._session.method.name
            raise ParameterError(f"the memory of method {name!r} cannot be saved")
        head = {
            "format": _FORMAT,
            "version": _VERSION,
            "method": self._session.method.name,
            "params": repr(self._session.params),
            "last_timestamp_s": self._last_timestamp_s,
        }
        file = BytesIO()
        np.savez(file, np.frombuffer(json.dumps(head).encode(), dtype=np.uint8), *leaves)
        return file.getvalue()

    def restore(self, saved: bytes) -> None:
        """Go on from what `save` gave, of a localizer of the same method and parameters.

        Predictions for frames before it are dropped: poses of the tracker are not saved.

        Raises:
            ParameterError: It is of another method, of other parameters or of another version,
                or none of a localizer.
        """
        try:
            with np.load(BytesIO(saved), allow_pickle=False) as file:
                head_bytes, *arrays = (file[f"arr_{index}"] for index in range(len(file.files)))
                head = json.loads(head_bytes.tobytes())
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ParameterError(f"saved: expected what `save` gave, got {error}") from None
        expected = {
            "format": _FORMAT,
            "version": _VERSION,
            "method": self._session.method.name,
            "params": repr(self._session.params),
        }
        for name, value in expected.items():
            if head.get(name) != value:
                raise ParameterError(f"saved: expected {name} {value!r}, got {head.get(name)!r}")
        self.reset()
        shapes = [np.shape(leaf) for leaf in tree_leaves(self._state)]
        if shapes != [array.shape for array in arrays]:
            raise ParameterError("saved: expected the arrays of this version's memory, got others")
        remaining = iter(arrays)
        self._state = tree_map(lambda _: next(remaining), self._state)
        self._last_timestamp_s = float(head["last_timestamp_s"])


def _to_rigid(name: str, value: Rigid3 | ArrayLike) -> Rigid3:
    """A user's pose as float64 `Rigid3` of shape (), checked."""
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
