"""The contract of an exported file: what its clients have to know, as JSON in its metadata.

docs/reference/contract.md says the same in words.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import msgspec

from vioapr.errors import FileError, FormatError, ParameterError
from vioapr.schemas.base import Document, Record, decode, encode

METADATA_KEY = "vioapr"
"""Where the contract stands in the metadata of an ONNX file."""

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

Count = Annotated[int, msgspec.Meta(ge=0)]


class TensorSpec(Record, frozen=True):
    """An input or output.

    Attributes:
        name: In the file.
        dtype: `uint8`, `float32` or `int32`.
        shape: Numbers, or names of sizes that are free.
        meaning: In words, with unit.
    """

    name: str
    dtype: str
    shape: tuple[Count | str, ...]
    meaning: str = ""


class ParamSpec(Record, frozen=True):
    """A number of the input `params`.

    Attributes:
        name: With unit.
        default: The value to pass unless told otherwise.
        least: Smallest allowed value.
        most: Largest allowed value, or None.
    """

    name: str
    default: float
    least: float
    most: float | None = None


class StateArray(Record, frozen=True):
    """An array in the flat state.

    Attributes:
        name: Path of field names, e.g. `reference.vio_from_cam.quat_xyzw`.
        shape: Without the batch axis.
        offset: Element of the state where it begins.
    """

    name: str
    shape: tuple[Count, ...]
    offset: Count


class Preprocessing(Record, frozen=True, omit_defaults=True):
    """Preprocessing of images; 0 in files that take none.

    Attributes:
        resize: Side of the square that an image is resized to, pixels.
        crop: Side of the square that is cut out of its middle, pixels.
    """

    resize: Count = 0
    crop: Count = 0


class Regressor(Record, frozen=True):
    """The network that predicts poses.

    Attributes:
        model: Its name.
        scenes: Names of the scenes that it knows.
        camera: The one camera whose images it takes: fx, fy, cx, cy over the image's width and
            height; missing if it takes any.
    """

    model: str = ""
    scenes: tuple[str, ...] = ()
    camera: tuple[float, float, float, float] | msgspec.UnsetType = msgspec.UNSET


class Contract(Document, frozen=True, kw_only=True):
    """Inputs, outputs, state and parameters of an exported file.

    Attributes:
        conventions: Frames, units and encodings, by keyword.
        statuses: Names of the numbers that the output `status` can have.
        localization_states: Names of the numbers that `localization_state` can have.
        easing: Limits of the corrections of `display_from_vio`: `least_m_s`, `least_deg_s`, and
            `share_per_s` of what is left.
        part: `localizer` (the whole), or `apr`, `fusion` or `carry` of a split set.
        inputs: In the file's order.
        outputs: In the file's order.
        precision: Of the regressor's weights: fp32, fp16w, int8w or int8-qdq.
        method: Of fusion; None for part `apr`.
        params: The numbers of the input `params`, in order; without any there is no such input.
        fixed_params: The method's other parameters, fixed at export.
        state_size: Elements of the state.
        state_tag: Element 0 of every state that this file wrote.
        state_layout: Every array in the state, in order.
        image: Preprocessing of images.
        regressor: The network.
        made_by: Program and version.
    """

    FORMAT: ClassVar[str] = "vioapr localizer"
    VERSION: ClassVar[int] = 2

    conventions: dict[str, str] = msgspec.field(default_factory=lambda: dict(CONVENTIONS))
    statuses: dict[str, str] = msgspec.field(default_factory=dict)
    localization_states: dict[str, str] = msgspec.field(default_factory=dict)
    easing: dict[str, float] = msgspec.field(default_factory=dict)
    part: Literal["localizer", "apr", "fusion", "carry"]
    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    precision: str = "fp32"
    method: str | None = None
    params: tuple[ParamSpec, ...] = ()
    fixed_params: dict[str, bool | int | float | str | None] = msgspec.field(default_factory=dict)
    state_size: Count = 0
    state_tag: Count = 0
    state_layout: tuple[StateArray, ...] = ()
    image: Preprocessing = Preprocessing()
    regressor: Regressor = Regressor()
    made_by: str = ""

    def to_json(self) -> str:
        """The text in the file's metadata."""
        return encode(self, indent=1).rstrip()

    @property
    def output_names(self) -> tuple[str, ...]:
        """In the file's order."""
        return tuple(spec.name for spec in self.outputs)

    def fill_params(self, given: Mapping[str, float]) -> dict[str, float]:
        """The numbers of the input `params`, in order: the given ones, and defaults.

        Raises:
            ParameterError: A number that the file does not have, or cannot have.
        """
        known = {spec.name: spec for spec in self.params}
        if unknown := sorted(set(given) - set(known)):
            raise ParameterError(
                f"{unknown[0]}: expected one of the file's parameters "
                f"({', '.join(known) or 'it has none'})"
            )
        values = {name: float(given.get(name, spec.default)) for name, spec in known.items()}
        for name, value in values.items():
            least, most = known[name].least, known[name].most
            if not least <= value <= (math.inf if most is None else most):
                upper = "" if most is None else f" to {most:g}"
                raise ParameterError(
                    f"{name}: expected a number from {least:g}{upper}, got {value}"
                )
        return values


def parse(text: str | None, where: str) -> Contract:
    """Read a contract.

    Args:
        text: JSON, or None where a file has none.
        where: The file's name, for messages.

    Raises:
        FormatError: There is none, or it is malformed.
        VersionError: It is of a later version.
    """
    if text is None:
        raise FormatError(
            where,
            "expected a localizer that `vioapr export` wrote, found an ONNX file without the "
            f"metadata {METADATA_KEY!r}",
        )
    try:
        return decode(where, text, Contract)
    except FileError as error:
        raise type(error)(where, f"its contract: {error.problem}") from None
