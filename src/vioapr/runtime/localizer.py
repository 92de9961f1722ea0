"""Running an exported localizer with onnxruntime alone: no PyTorch is needed.

A client in another language does the same; docs/reference/contract.md says how.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.errors import ContractError
from vioapr.files.paths import AnyPath
from vioapr.fusion.types import LocalizationState, Status
from vioapr.geometry.rigid import Rigid3
from vioapr.runtime.session import open_session, require_localizer
from vioapr.trajectory import UNIT_TOLERANCE

_NO_POSE = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)
_NO_IMAGE = np.zeros((1, 1, 3), dtype=np.uint8)


class Located(NamedTuple):
    """The answer to a frame.

    Attributes:
        status: Where the pose comes from.
        world_from_cam: The pose; NaN while unlocalized.
        world_from_vio: Where the tracking world lies in the map; NaN while unknown.
        confirmed_run: See `vioapr.fusion.types.Estimate`.
        sigma_position_m: Per axis, or None where the method has none.
        sigma_orientation_deg: Per axis, or None where the method has none.
        sigma_position_axes_m: Shape (3,), along the world's axes, or None.
        apr_world_from_cam: The regressor's own pose; NaN for a frame without image.
        apr_sigma_position_m: The regressor's own, per axis; NaN for a frame without image.
        apr_sigma_orientation_deg: The regressor's own, per axis; NaN for a frame without image.
        localization_state: What to tell people, or None where the method has none.
        confidence: Probability that the pose is the right one, or None.
        display_from_vio: `world_from_vio` for content that is not to jump; None in files of
            version 1.
    """

    status: Status
    world_from_cam: Rigid3
    world_from_vio: Rigid3
    confirmed_run: int
    sigma_position_m: float | None
    sigma_orientation_deg: float | None
    sigma_position_axes_m: NDArray[np.float64] | None
    apr_world_from_cam: Rigid3
    apr_sigma_position_m: float
    apr_sigma_orientation_deg: float
    localization_state: LocalizationState | None = None
    confidence: float | None = None
    display_from_vio: Rigid3 | None = None

    @classmethod
    def from_outputs(cls, outputs: dict[str, NDArray]) -> Located:
        """Read the outputs of a file.

        Raises:
            ContractError: There is a pose without a status that says so, or the other way round.
        """
        status = Status(int(outputs["status"][0]))
        if np.isfinite(outputs["world_from_cam"]).all() == (status == Status.UNLOCALIZED):
            raise ContractError(
                f"the file answered with status {status.label} and the pose "
                f"{outputs['world_from_cam'].tolist()}, which its contract forbids: export it again"
            )
        numbers = {name: float(values[0]) for name, values in outputs.items() if len(values) == 1}
        axes_m = outputs.get("sigma_position_axes_m")
        state, display = numbers.get("localization_state"), outputs.get("display_from_vio")
        return cls(
            status,
            unflatten_pose(outputs["world_from_cam"]),
            unflatten_pose(outputs["world_from_vio"]),
            int(outputs["confirmed_run"][0]),
            numbers.get("sigma_position_m"),
            numbers.get("sigma_orientation_deg"),
            None if axes_m is None else axes_m.astype(np.float64),
            unflatten_pose(outputs["apr_world_from_cam"]),
            numbers["apr_sigma_position_m"],
            numbers["apr_sigma_orientation_deg"],
            None if state is None else LocalizationState(int(state)),
            numbers.get("confidence"),
            None if display is None else unflatten_pose(display),
        )


def flatten_pose(pose: Rigid3) -> NDArray[np.float32]:
    """Write a pose as the contract does: x y z qx qy qz qw, shape (7,)."""
    return np.concatenate([*pose], axis=-1).astype(np.float32)


def unflatten_pose(flat: NDArray[np.floating]) -> Rigid3:
    """Read a pose from x y z qx qy qz qw, shape (7,)."""
    position_m, quat_xyzw = np.split(flat.astype(np.float64), [3])
    return Rigid3(position_m, quat_xyzw)


class OnnxLocalizer:
    """An exported localizer, fed frame by frame.

    Example:
        >>> localizer = OnnxLocalizer("localizer.onnx")
        >>> located = localizer.update(0.0, image, vio_from_cam)
        >>> if located.status != Status.UNLOCALIZED:
        ...     place_content(located.world_from_vio)

    Attributes:
        contract: Of the file.
        params: The numbers of the method, by name.
    """

    def __init__(
        self,
        path: AnyPath,
        params: dict[str, float] | None = None,
        threads: int | None = None,
    ) -> None:
        """Load a file and start without any knowledge.

        Args:
            path: A file that `vioapr export` wrote.
            params: Numbers of the method that are not to have their defaults.
            threads: For every operator; None for all cores.

        Raises:
            FileError: The file cannot be read, or is none; see `open_session`.
            ContractError: The file is not a whole localizer.
            ParameterError: A number that the file does not have, or cannot have.
        """
        path = Path(path)
        self._session, self.contract = open_session(path, threads)
        require_localizer(self.contract, path)
        self.params = self.contract.fill_params(params or {})
        self.reset()

    def reset(self) -> None:
        """Forget everything, as before the first frame."""
        self._state = np.zeros(self.contract.state_size, dtype=np.float32)
        self._start_s: float | None = None
        self._last_s = -np.inf

    @property
    def state(self) -> NDArray[np.float32]:
        """The memory, to be stored and set again: shape (state_size,).

        Setting it raises a ContractError if it is not finite or of another model.
        """
        return self._state.copy()

    @state.setter
    def state(self, state: ArrayLike) -> None:
        array, size, tag = np.asarray(state), self.contract.state_size, self.contract.state_tag
        if array.shape != (size,):
            raise ContractError(
                f"state: expected shape ({size},), got {array.shape}: is it of another model?"
            )
        if not np.isfinite(array).all():
            raise ContractError("state: expected finite numbers, got NaN or inf")
        if array[0] != tag and array.any():
            raise ContractError(
                f"state: expected the tag {tag} of this model in element 0, got {array[0]:.0f}: "
                "it is of another model"
            )
        self._state = array.astype(np.float32)

    def update(
        self,
        timestamp_s: float,
        image: NDArray[np.uint8] | None,
        vio_from_cam: Rigid3 | None,
        *,
        tracking_reset: bool = False,
        image_timestamp_s: float | None = None,
        image_vio_from_cam: Rigid3 | None = None,
    ) -> Located:
        """Take in a frame.

        Args:
            timestamp_s: Of the frame, s, on any clock, later than the last one's.
            image: Shape (height, width, 3), uint8, RGB, or None for a frame without.
            vio_from_cam: The tracker's pose (y-up world, OpenCV camera), or None if it is lost.
            tracking_reset: Whether the tracker's world is a new one since this frame.
            image_timestamp_s: When the image was taken, if that was earlier; None if now.
            image_vio_from_cam: The tracker's pose then.

        Raises:
            ContractError: An input that the contract does not allow.
        """
        if not np.isfinite(timestamp_s) or timestamp_s <= self._last_s:
            raise ContractError(
                f"timestamp_s: expected a finite time after the last frame's ({self._last_s:.6f} "
                f"s), got {timestamp_s}"
            )
        if image is not None:
            require_image(image)
        if vio_from_cam is not None:
            require_pose(vio_from_cam)
        if (image_timestamp_s is None) != (image_vio_from_cam is None):
            raise ContractError("`image_timestamp_s` and `image_vio_from_cam` go together")
        if image_vio_from_cam is not None:
            require_pose(image_vio_from_cam, "image_vio_from_cam")
        if self._start_s is None:
            self._start_s = float(timestamp_s)
        taken_s = timestamp_s if image_timestamp_s is None else image_timestamp_s
        taken_at = vio_from_cam if image_vio_from_cam is None else image_vio_from_cam
        flags = {
            "has_image": image is not None,
            "tracking_ok": vio_from_cam is not None,
            "tracking_reset": tracking_reset,
        }
        feed = {
            "image": _NO_IMAGE if image is None else np.ascontiguousarray(image),
            "vio_from_cam": _NO_POSE if vio_from_cam is None else flatten_pose(vio_from_cam),
            # Single precision is too coarse for seconds since 1970.
            "timestamp_s": np.array([timestamp_s - self._start_s], dtype=np.float32),
            "image_timestamp_s": np.array([taken_s - self._start_s], dtype=np.float32),
            "image_vio_from_cam": _NO_POSE if taken_at is None else flatten_pose(taken_at),
            "state": self._state,
            **{name: np.array([flag], dtype=np.float32) for name, flag in flags.items()},
        }
        if self.params:
            feed["params"] = np.array([*self.params.values()], dtype=np.float32)
        feed = {spec.name: feed[spec.name] for spec in self.contract.inputs}
        if image_timestamp_s is not None and "image_timestamp_s" not in feed:
            raise ContractError(
                "image_timestamp_s: this file is of contract version 1, which takes no images of "
                "earlier frames: export it again"
            )
        names = self.contract.output_names
        outputs = dict(zip(names, self._session.run(names, feed), strict=True))
        self._state = outputs["next_state"]
        self._last_s = float(timestamp_s)
        return Located.from_outputs(outputs)


def require_image(image: ArrayLike) -> None:
    """See that an image is one that a localizer takes.

    Raises:
        ContractError: It is not RGB in uint8, or has no pixels.
    """
    array = np.asarray(image)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
        raise ContractError(
            "image: expected RGB of shape (height, width, 3) and type uint8, got "
            f"{array.shape} {array.dtype}"
        )


def require_pose(vio_from_cam: Rigid3, name: str = "vio_from_cam") -> None:
    """See that a tracker's pose is one that a localizer takes.

    Raises:
        ContractError: It is not one pose, not finite, or its quaternion not a unit one.
    """
    flat = np.concatenate([np.asarray(part, dtype=np.float64) for part in vio_from_cam], axis=-1)
    if flat.shape != (7,) or not np.isfinite(flat).all():
        raise ContractError(
            f"{name}: expected one pose of finite numbers (None where the tracker is lost), "
            f"got {flat.tolist()}"
        )
    length = float(np.linalg.norm(flat[3:]))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise ContractError(f"{name}: expected a unit quaternion, got one of norm {length:g}")
