"""What a client of an exported file has to know, as JSON in the file's metadata.

docs/contract.md says the same in words. This module needs neither PyTorch nor onnx.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from vioapr.errors import VioAprError
from vioapr.fusion.types import Status

FORMAT, VERSION = "vioapr localizer", 1
METADATA_KEY = "vioapr"

CONVENTIONS = {
    "pose": "7 numbers: x, y, z, qx, qy, qz, qw; p_target = R(q) p_source + (x, y, z)",
    "quaternion": "Hamilton, order x y z w, unit; q and -q are the same rotation",
    "world": "the map: right-handed, z up, metres",
    "vio": "the tracker's world: right-handed, y up, metres",
    "cam": "x right, y down, z forward (OpenCV)",
    "image": "RGB, rows from the top, as the sensor gives it: not turned upright",
    "flag": "1 is yes, 0 is no",
    "timestamp_s": "seconds since any moment near the start of the session, below 16384",
    "state": "zeros before the first frame; then the last next_state, unchanged",
    "nan": "an unknown pose, position or uncertainty is NaN in all its numbers",
}


class ContractError(VioAprError):
    """A file, or what is fed to it, is not what the contract says."""


@dataclass(frozen=True)
class TensorSpec:
    """An input or output.

    Attributes:
        name: In the file.
        dtype: `uint8`, `float32` or `int32`.
        shape: Numbers, or names of sizes that are free.
        meaning: In words, with unit.
    """

    name: str
    dtype: str
    shape: tuple[int | str, ...]
    meaning: str


@dataclass(frozen=True)
class ParamSpec:
    """A number of the input `params`.

    Attributes:
        name: With unit.
        default: What to pass unless told otherwise.
        least: Smallest allowed value.
        most: Largest allowed value, or None.
    """

    name: str
    default: float
    least: float
    most: float | None = None


@dataclass(frozen=True)
class Contract:
    """All of it.

    Attributes:
        part: `localizer` (the whole), or `apr` or `fusion` of a split pair.
        inputs: In the file's order.
        outputs: In the file's order.
        precision: Of the regressor's weights: fp32, fp16w, int8w or int8-qdq.
        method: Of fusion; None for part `apr`.
        params: The numbers of the input `params`, in order; without any there is no such input.
        fixed_params: The method's other parameters, fixed at export.
        state_size: Elements of the state.
        state_tag: Element 0 of every state that this file wrote.
        state_layout: Name, shape and place of every array in the state, for the curious.
        image: What is done to images: `resize`, `crop`, in pixels.
        regressor: `model` and `scenes`.
        made_by: Program and version.
    """

    part: str
    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    precision: str = "fp32"
    method: str | None = None
    params: tuple[ParamSpec, ...] = ()
    fixed_params: dict[str, Any] = field(default_factory=dict)
    state_size: int = 0
    state_tag: int = 0
    state_layout: tuple[dict[str, Any], ...] = ()
    image: dict[str, Any] = field(default_factory=dict)
    regressor: dict[str, Any] = field(default_factory=dict)
    made_by: str = ""

    def to_json(self) -> str:
        """For the file's metadata."""
        document = {
            "format": FORMAT,
            "version": VERSION,
            "conventions": CONVENTIONS,
            "statuses": {str(int(status)): status.label for status in Status},
            **asdict(self),
        }
        return json.dumps(document, indent=1, allow_nan=False)

    @property
    def output_names(self) -> tuple[str, ...]:
        """In the file's order."""
        return tuple(spec.name for spec in self.outputs)


def parse(text: str | None, where: str) -> Contract:
    """Read a contract.

    Args:
        text: JSON, or None where a file has none.
        where: The file's name, for messages.

    Raises:
        ContractError: There is none, it is of a later version, or it is broken.
    """
    if text is None:
        raise ContractError(
            f"{where}: expected a localizer that `vioapr export` wrote, found an ONNX file "
            f"without the metadata {METADATA_KEY!r}"
        )
    try:
        document = json.loads(text)
        is_ours = document["format"] == FORMAT
        version = document["version"]
    except (ValueError, KeyError, TypeError):
        raise ContractError(f"{where}: expected a contract in JSON, found something else") from None
    if not is_ours or not isinstance(version, int) or version < 1:
        raise ContractError(f"{where}: expected format {FORMAT!r}, found another")
    if version > VERSION:
        raise ContractError(
            f"{where}: its contract has version {version}, and this program knows up to "
            f"{VERSION}: update vioapr, or export the file anew"
        )
    try:
        return _from_document(document)
    except (KeyError, TypeError, ValueError) as error:
        raise ContractError(f"{where}: its contract is broken: {error!r}") from None


def _from_document(document: dict[str, Any]) -> Contract:
    known = {name: document[name] for name in Contract.__dataclass_fields__ if name in document}
    for name in ("inputs", "outputs"):
        known[name] = tuple(_tensor(entry) for entry in document[name])
    known["params"] = tuple(_known(ParamSpec, entry) for entry in document.get("params", ()))
    known["state_layout"] = tuple(document.get("state_layout", ()))
    return Contract(**known)


def _tensor(entry: dict[str, Any]) -> TensorSpec:
    return _known(TensorSpec, entry | {"shape": tuple(entry["shape"])})


def _known(kind: type, entry: dict[str, Any]) -> Any:
    """Keys that a later version added are passed over."""
    return kind(**{name: entry[name] for name in kind.__dataclass_fields__ if name in entry})
