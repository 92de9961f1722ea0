"""A page beside a regressor: what it is, how good, what for, and whose weights it holds."""

from __future__ import annotations

from pathlib import Path

from vioapr.plurals import count_of
from vioapr.schemas.regressor import (
    FittedIndex,
    FittedMap,
    PointsShape,
    RegressorSpec,
    RetrievalShape,
    Trained,
)

CARD_FILE = "MODEL_CARD.md"

_LEFT_OUT = {
    "recordings": "each recording left out in turn",
    "parts": "each fifth of the only recording left out in turn",
    "validation": "the validation recordings",
}

_LIMITS = """\
- It knows the places that it was shown, by the light and weather that it was shown; its stated
  uncertainty grows with what is unlike them, but says nothing certain about other places.
- One image alone is never proof: `vioapr export` puts fusion with odometry behind it.
"""
_FIELD_OF_VIEW = (
    "- It takes pictures of the field of view that it was shown: crops of another shape cost "
    "accuracy."
)
_CAMERA = (
    "- It takes pictures of the camera that it was shown: with another lens, format or zoom, poses "
    "are wrong, and it does not notice."
)


def describe_index(spec: RegressorSpec, index: FittedIndex) -> list[str]:
    """Say what an index holds and what its choice of views left out, a sentence each."""
    shape = spec.retrieval
    assert isinstance(shape, RetrievalShape)
    size_mb = 4 * shape.views * (shape.components + 7) / 1e6
    if shape.views < index.candidates:
        share = 100 * shape.views / index.candidates
        held = (
            f"index: {shape.views} of {index.candidates} images that were looked at "
            f"({share:.0f} %), {size_mb:.2f} MB; the others are like one of these"
        )
    else:
        held = f"index: all of {count_of(shape.views, 'image')}, {size_mb:.2f} MB"
    return [
        held,
        f"median error {index.position_m:.3f} m, {index.orientation_deg:.2f} deg, measured with "
        f"{_LEFT_OUT[index.left_out]}",
    ]


def describe_map(spec: RegressorSpec, fitted: FittedMap) -> list[str]:
    """Say what a map of points holds and how often it answers, a sentence each."""
    shape = spec.points
    assert isinstance(shape, PointsShape)
    size_mb = shape.views * shape.points * 76 / 1e6
    held = (
        f"map: {count_of(fitted.points, 'point')} in {count_of(fitted.views, 'view')}, "
        f"{size_mb:.1f} MB"
    )
    measured = f"measured with {_LEFT_OUT[fitted.left_out]}"
    if fitted.position_m is None or fitted.orientation_deg is None:
        return [held, f"sure of no image ({measured}): it answers as retrieval does"]
    return [
        held,
        f"sure of {100 * fitted.sure:.0f} % of images, there median error "
        f"{fitted.position_m:.3f} m, {fitted.orientation_deg:.2f} deg, {measured}",
    ]


def describe_fitted(spec: RegressorSpec, trained: Trained) -> list[str]:
    """Say what was fitted, and how far off it is, a sentence each; none for trained networks."""
    lines, seconds = [], 0.0
    if trained.index is not None:
        lines, seconds = describe_index(spec, trained.index), trained.index.seconds
    if trained.map is not None:
        lines, seconds = describe_map(spec, trained.map), trained.map.seconds
    return [*lines, f"fitted in {seconds:.0f} s"] if lines else []


def model_card(spec: RegressorSpec, trained: Trained) -> str:
    """Write the page, Markdown."""
    lines = [
        f"# {spec.model}, {', '.join(spec.scenes)}",
        "",
        "An absolute pose regressor: from one image to the camera's pose, with its uncertainty.",
        "",
        f"- takes: RGB, squeezed to {spec.resize} x {spec.resize} pixels, the middle "
        f"{spec.crop} x {spec.crop} of them",
    ]
    if trained.images is not None:
        lines.append(f"- made from: {count_of(trained.images, 'image')} with ground truth")
    lines += [f"- {line}" for line in describe_fitted(spec, trained)]
    last = trained.last_epoch
    if last is not None and last.validation_position_m is not None:
        lines.append(
            f"- median error {last.validation_position_m:.3f} m, "
            f"{last.validation_orientation_deg:.2f} deg on the validation recordings, which also "
            "chose the epoch"
        )
    seen = _FIELD_OF_VIEW if trained.map is None else _CAMERA
    lines += ["", "## Limits", "", f"{_LIMITS}{seen}", ""]
    if trained.weights is not None:
        lines += ["## Notice", "", f"{trained.weights}", ""]
    return "\n".join(lines)


def card_of(path: Path) -> Path:
    """The path of the page beside a regressor's file."""
    return path.with_name(CARD_FILE)
