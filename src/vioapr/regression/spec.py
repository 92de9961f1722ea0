"""What a regressor is: all that one must know to build its network and feed it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from vioapr.errors import ParameterError

IMAGE_MEAN, IMAGE_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's, RGB, of values from 0 to 1: what pretrained weights expect."""


@dataclass(frozen=True)
class RegressorSpec:
    """Stored beside the weights; with them it is a whole regressor.

    Attributes:
        model: Name of the network.
        scenes: Names of the scenes it knows, in the order of their numbers.
        rotation: Name of the rotation's code.
        resize: Images are resized to resize x resize pixels, whatever their shape.
        crop: Of which the middle crop x crop pixels are looked at.
        dropout: While training; None for the model's own.
        orientation_layers: Of MS-Transformer's second transformer.
    """

    model: str
    scenes: tuple[str, ...]
    rotation: str = "log-quat"
    resize: int = 256
    crop: int = 224
    dropout: float | None = None
    orientation_layers: int = 6

    def __post_init__(self) -> None:
        if not self.scenes:
            raise ParameterError("scenes: expected at least one, got none")
        if not 32 <= self.crop <= self.resize <= 4096:
            raise ParameterError(
                f"expected 32 <= crop <= resize <= 4096 pixels, "
                f"got crop {self.crop} and resize {self.resize}"
            )
        if self.dropout is not None and not 0 <= self.dropout < 1:
            raise ParameterError(f"dropout: expected 0 to below 1, got {self.dropout}")
        if not 1 <= self.orientation_layers <= 12:
            raise ParameterError(
                f"orientation layers: expected 1 to 12, got {self.orientation_layers}"
            )

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return dataclasses.asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> RegressorSpec:
        """Inverse of `to_json`.

        Raises:
            ParameterError: Something is missing, unknown or out of range.
        """
        try:
            return RegressorSpec(**{**values, "scenes": tuple(values["scenes"])})
        except (KeyError, TypeError) as error:
            raise ParameterError(f"expected the specification of a regressor: {error}") from None
