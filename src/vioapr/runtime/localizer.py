"""Running an exported localizer with onnxruntime alone: no PyTorch is needed.

A client in another language does the same; docs/contract.md says what.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vioapr.errors import MissingExtraError, ParameterError
from vioapr.fusion.types import Status
from vioapr.geometry.rigid import Rigid3
from vioapr.schemas import contract as contracts
from vioapr.schemas.contract import Contract, ContractError
from vioapr.trajectory import UNIT_TOLERANCE

_NO_POSE = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)
_NO_IMAGE = np.zeros((1, 1, 3), dtype=np.uint8)


class Located(NamedTuple):
    """A frame's answer.

    Attributes:
        status: Where the pose comes from.
        world_from_cam: The pose; NaN while unlocalized.
        world_from_vio: Where the tracking world lies in the map; NaN while unknown.
        confirmed_run: See `vioapr.fusion.types.Estimate`.
        sigma_position_m: Per axis, or None where the method has none.
        sigma_orientation_deg: Likewise.
        sigma_position_axes_m: Shape (3,), along the world's axes, or None.
        apr_world_from_cam: The regressor's own pose; NaN for a frame without image.
        apr_sigma_position_m: The regressor's own uncertainty per axis; NaN likewise.
        apr_sigma_orientation_deg: Likewise.
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


def open_session(path: Path, threads: int | None = None) -> tuple[Any, Contract]:
    """Load any file that `vioapr export` wrote.

    Args:
        path: The file.
        threads: For every operator; None for all cores.

    Returns:
        onnxruntime's session and the contract.

    Raises:
        ContractError: It is none, is truncated, or of a later version.
        MissingExtraError: onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError:
        raise MissingExtraError("running a localizer", "onnxruntime", "runtime") from None
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no file of this name"
        raise ContractError(f"{path}: expected a localizer (.onnx), found {found}")
    options = session_options(threads)
    try:
        content = path.read_bytes()
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except OSError as error:
        raise ContractError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # onnxruntime has no common class of its errors
        raise ContractError(
            f"{path}: expected an ONNX file, found one that is truncated, damaged or something "
            f"else ({_first_line(error)})"
        ) from None
    metadata = session.get_modelmeta().custom_metadata_map
    contract = contracts.parse(metadata.get(contracts.METADATA_KEY), str(path))
    _check_session(session, contract, path)
    return session, contract


def session_options(threads: int | None) -> Any:
    """Onnxruntime's options for one of several sessions of a process."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    options.intra_op_num_threads = threads or 0
    # Between frames, idle workers would take the processor from other sessions, and the battery.
    options.add_session_config_entry("session.force_spinning_stop", "1")
    return options


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0][:160] if lines else type(error).__name__


def _check_session(session: Any, contract: Contract, path: Path) -> None:
    for kind, specs, found in (
        ("inputs", contract.inputs, session.get_inputs()),
        ("outputs", contract.outputs, session.get_outputs()),
    ):
        expected, names = [spec.name for spec in specs], [value.name for value in found]
        if expected != names:
            raise ContractError(
                f"{path}: expected the contract's {kind} {', '.join(expected)}, found "
                f"{', '.join(names)}"
            )


class OnnxLocalizer:
    """An exported localizer, fed frame by frame.

    Example:
        >>> localizer = OnnxLocalizer(Path("localizer.onnx"))
        >>> located = localizer.update(0.0, image, vio_from_cam)
        >>> if located.status != Status.UNLOCALIZED:
        ...     place_content(located.world_from_vio)

    Attributes:
        contract: Of the file.
        params: The numbers of the method, by name.
    """

    def __init__(
        self,
        path: Path,
        params: dict[str, float] | None = None,
        threads: int | None = None,
    ) -> None:
        """Load a file and start without any knowledge.

        Args:
            path: What `vioapr export` wrote.
            params: Numbers of the method that are not to have their defaults.
            threads: See `open_session`.

        Raises:
            ContractError: The file is not a whole localizer.
            ParameterError: A number that the file does not have, or cannot have.
        """
        self._session, self.contract = open_session(path, threads)
        if self.contract.part != "localizer":
            raise ContractError(
                f"{path}: expected a whole localizer, found the part {self.contract.part!r} of a "
                "split one: export without --split"
            )
        self.params = _check_params(self.contract, params or {})
        self.reset()

    def reset(self) -> None:
        """Forget everything, as before the first frame."""
        self._state = np.zeros(self.contract.state_size, dtype=np.float32)
        self._start_s: float | None = None
        self._last_s = -np.inf

    @property
    def state(self) -> NDArray[np.float32]:
        """What is remembered, to be stored and set again: shape (state_size,)."""
        return self._state.copy()

    @state.setter
    def state(self, state: ArrayLike) -> None:
        self._state = check_state(self.contract, np.asarray(state))

    def update(
        self,
        timestamp_s: float,
        image: NDArray[np.uint8] | None,
        vio_from_cam: Rigid3 | None,
        *,
        tracking_reset: bool = False,
    ) -> Located:
        """Take in a frame.

        Args:
            timestamp_s: Of the image, s, on any clock, later than the last frame's.
            image: Shape (height, width, 3), uint8, RGB, or None for a frame without.
            vio_from_cam: The tracker's pose (y-up world, OpenCV camera), or None if it is lost.
            tracking_reset: Whether the tracker's world is a new one from this frame on.

        Raises:
            ContractError: An input that the contract does not allow.
        """
        if not np.isfinite(timestamp_s) or timestamp_s <= self._last_s:
            raise ContractError(
                f"timestamp_s: expected a finite time after the last frame's ({self._last_s:.6f} "
                f"s), got {timestamp_s}"
            )
        feed = {
            "image": _NO_IMAGE if image is None else _check_image(image),
            "has_image": _flag(image is not None),
            "vio_from_cam": _NO_POSE if vio_from_cam is None else _check_pose(vio_from_cam),
            "timestamp_s": self._since_start(timestamp_s),
            "tracking_ok": _flag(vio_from_cam is not None),
            "tracking_reset": _flag(tracking_reset),
            "state": self._state,
        }
        if self.params:
            feed["params"] = np.array([*self.params.values()], dtype=np.float32)
        names = self.contract.output_names
        outputs = dict(zip(names, self._session.run(names, feed), strict=True))
        self._state = outputs["next_state"]
        self._last_s = float(timestamp_s)
        return _read(outputs)

    def _since_start(self, timestamp_s: float) -> NDArray[np.float32]:
        """In single precision, which is too coarse for seconds since 1970."""
        if self._start_s is None:
            self._start_s = float(timestamp_s)
        return np.array([timestamp_s - self._start_s], dtype=np.float32)


def check_state(contract: Contract, state: NDArray) -> NDArray[np.float32]:
    """A state of this very file, or zeros.

    Raises:
        ContractError: It is of another model, or not finite.
    """
    if state.shape != (contract.state_size,):
        raise ContractError(
            f"state: expected shape ({contract.state_size},), got {state.shape}: is it of "
            "another model?"
        )
    if not np.isfinite(state).all():
        raise ContractError("state: expected finite numbers, got NaN or inf")
    if state[0] != contract.state_tag and state.any():
        raise ContractError(
            f"state: expected the tag {contract.state_tag} of this model in element 0, got "
            f"{state[0]:.0f}: it is of another model"
        )
    return state.astype(np.float32)


def _check_params(contract: Contract, given: dict[str, float]) -> dict[str, float]:
    known = {spec.name: spec for spec in contract.params}
    if unknown := sorted(set(given) - set(known)):
        raise ParameterError(
            f"{unknown[0]}: expected one of the file's parameters "
            f"({', '.join(known) or 'it has none'})"
        )
    values = {name: float(given.get(name, spec.default)) for name, spec in known.items()}
    for name, value in values.items():
        least, most = known[name].least, known[name].most
        if not least <= value <= (np.inf if most is None else most):
            upper = "" if most is None else f" to {most:g}"
            raise ParameterError(f"{name}: expected a number from {least:g}{upper}, got {value}")
    return values


def _flag(value: bool) -> NDArray[np.float32]:
    return np.array([value], dtype=np.float32)


def _check_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    array = np.asarray(image)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
        raise ContractError(
            "image: expected RGB of shape (height, width, 3) and type uint8, got "
            f"{array.shape} {array.dtype}"
        )
    return np.ascontiguousarray(array)


def _check_pose(vio_from_cam: Rigid3) -> NDArray[np.float32]:
    flat = np.concatenate([np.asarray(part, dtype=np.float64) for part in vio_from_cam], axis=-1)
    if flat.shape != (7,) or not np.isfinite(flat).all():
        raise ContractError(
            "vio_from_cam: expected one pose of finite numbers (None where the tracker is lost), "
            f"got {flat.tolist()}"
        )
    length = float(np.linalg.norm(flat[3:]))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise ContractError(f"vio_from_cam: expected a unit quaternion, got one of norm {length:g}")
    return flat.astype(np.float32)


def _read(outputs: dict[str, NDArray]) -> Located:
    status = Status(int(outputs["status"][0]))
    pose = outputs["world_from_cam"]
    if np.isfinite(pose).all() == (status == Status.UNLOCALIZED):
        raise ContractError(
            f"the file answered with status {status.label} and the pose {pose.tolist()}, which "
            "its contract forbids: export it anew"
        )
    axes = outputs.get("sigma_position_axes_m")
    return Located(
        status,
        _rigid(pose),
        _rigid(outputs["world_from_vio"]),
        int(outputs["confirmed_run"][0]),
        _number(outputs.get("sigma_position_m")),
        _number(outputs.get("sigma_orientation_deg")),
        None if axes is None else axes.astype(np.float64),
        _rigid(outputs["apr_world_from_cam"]),
        float(outputs["apr_sigma_position_m"][0]),
        float(outputs["apr_sigma_orientation_deg"][0]),
    )


def _number(array: NDArray | None) -> float | None:
    return None if array is None else float(array[0])


def _rigid(flat: NDArray) -> Rigid3:
    pose = flat.astype(np.float64)
    return Rigid3(pose[:3], pose[3:])
