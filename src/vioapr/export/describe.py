"""The contracts of exported files: their inputs and outputs in words."""

from __future__ import annotations

from dataclasses import asdict
from itertools import accumulate

import msgspec

import vioapr
from vioapr.export.graph import MAX_RUN_PAIRS, FusionGraph
from vioapr.export.preprocess import Preprocessor
from vioapr.fusion.easing import EasingParams
from vioapr.fusion.types import LocalizationState, Status
from vioapr.schemas.contract import (
    Contract,
    ParamSpec,
    Preprocessing,
    Regressor,
    StateArray,
    TensorSpec,
)

_POSE, _ONE = (7,), (1,)

_IMAGE_INPUTS = (
    TensorSpec("image", "uint8", ("height", "width", 3), "RGB; any if has_image is 0"),
    TensorSpec("has_image", "float32", _ONE, "flag: this frame has an image"),
)
_HAS_APR = TensorSpec("has_apr", "float32", _ONE, "flag: this frame has a regressor's pose")

_FRAME_INPUTS = (
    TensorSpec("vio_from_cam", "float32", _POSE, "the tracker's pose; any if tracking_ok is 0"),
    TensorSpec("timestamp_s", "float32", _ONE, "of the frame, later than the last one's"),
    TensorSpec("tracking_ok", "float32", _ONE, "flag: the tracker knows its pose"),
    TensorSpec(
        "tracking_reset", "float32", _ONE, "flag: the tracker's world is a new one from here on"
    ),
)

_PICTURE_INPUTS = (
    TensorSpec(
        "image_timestamp_s", "float32", _ONE, "when the image was taken; timestamp_s if now"
    ),
    TensorSpec(
        "image_vio_from_cam", "float32", _POSE, "the tracker's pose then; vio_from_cam if now"
    ),
)

_APR_OUTPUTS = (
    TensorSpec("apr_world_from_cam", "float32", _POSE, "the regressor's pose"),
    TensorSpec("apr_sigma_position_m", "float32", _ONE, "the regressor's own, per axis, m"),
    TensorSpec("apr_sigma_orientation_deg", "float32", _ONE, "the regressor's own, deg"),
)

_FUSED_OUTPUTS = {
    spec.name: spec
    for spec in (
        TensorSpec("world_from_cam", "float32", _POSE, "the fused pose; NaN if status is 0"),
        TensorSpec("world_from_vio", "float32", _POSE, "for content in the map; NaN if unknown"),
        TensorSpec("status", "int32", _ONE, "where the pose comes from: see statuses"),
        TensorSpec(
            "confirmed_run", "int32", _ONE, "n: this and the n - 1 predictions before it are right"
        ),
        TensorSpec("display_from_vio", "float32", _POSE, "world_from_vio, without jumps"),
        TensorSpec("display_left_m", "float32", _ONE, "how far content is from its place, m"),
        TensorSpec("display_left_deg", "float32", _ONE, "by which angle it is turned, deg"),
        TensorSpec("display_placed_anew", "int32", _ONE, "1: put in place without easing"),
        TensorSpec("sigma_position_m", "float32", _ONE, "per axis, m"),
        TensorSpec("sigma_orientation_deg", "float32", _ONE, "per axis, deg"),
        TensorSpec("sigma_position_axes_m", "float32", (3,), "along the world's axes, m"),
        TensorSpec("sigma_orientation_axes_deg", "float32", (3,), "about the world's axes, deg"),
        TensorSpec("localization_state", "int32", _ONE, "what to tell people: see states"),
        TensorSpec("confidence", "float32", _ONE, "probability that the pose is the right one"),
    )
}


def describe_apr(preprocess: Preprocessor, regressor: Regressor, precision: str) -> Contract:
    """Describe the regressor alone, the first of a split set."""
    return Contract(
        part="apr",
        inputs=_IMAGE_INPUTS,
        outputs=_APR_OUTPUTS,
        statuses={str(int(status)): status.label for status in Status},
        precision=precision,
        image=Preprocessing(preprocess.resize, preprocess.crop),
        regressor=regressor,
        made_by=f"vioapr {vioapr.__version__}",
    )


def describe_fusion(
    fusion: FusionGraph, output_names: tuple[str, ...], regressor: Regressor, precision: str
) -> Contract:
    """Describe the fusion step alone, the second of a split set.

    Args:
        fusion: The step.
        output_names: In its order; the last is `next_state`.
        regressor: Whose predictions it takes.
        precision: Of the regressor.
    """
    layout = fusion.layout
    state = TensorSpec("state", "float32", (layout.size,), "the last next_state, or zeros")
    inputs = (*_APR_OUTPUTS, _HAS_APR, *_FRAME_INPUTS, *_PICTURE_INPUTS, state)
    if names := fusion.param_names:
        meaning = "numbers of the method: params"
        inputs += (TensorSpec("params", "float32", (len(names),), meaning),)
    next_state = TensorSpec("next_state", "float32", (layout.size,), "the state for the next frame")
    fixed, params = asdict(fusion.params), []
    for name in names:
        default, is_count = float(fixed.pop(name)), name in ("run_pairs", "optimized_frames")
        most = max(default, MAX_RUN_PAIRS) if name == "run_pairs" else None
        params.append(ParamSpec(name, default, 1 if is_count else 0, most))
    offsets = accumulate((leaf.size for leaf in layout.leaves), initial=1)
    return Contract(
        part="fusion",
        inputs=inputs,
        outputs=(*(_FUSED_OUTPUTS[name] for name in output_names[:-1]), next_state),
        statuses={str(int(status)): status.label for status in Status},
        localization_states={str(int(one)): one.label for one in LocalizationState},
        easing=asdict(EasingParams()),
        precision=precision,
        method=fusion.method.name,
        params=tuple(params),
        fixed_params=fixed,
        state_size=layout.size,
        state_tag=layout.tag,
        state_layout=tuple(
            StateArray(leaf.name, leaf.shape, offset)
            for leaf, offset in zip(layout.leaves, offsets, strict=False)
        ),
        regressor=regressor,
        made_by=f"vioapr {vioapr.__version__}",
    )


def describe_carry(fusion: Contract) -> Contract:
    """Describe the step of frames without prediction, the third of a split set."""
    left_out = {spec.name for spec in (*_APR_OUTPUTS, _HAS_APR, *_PICTURE_INPUTS)}
    return msgspec.structs.replace(
        fusion,
        part="carry",
        inputs=tuple(spec for spec in fusion.inputs if spec.name not in left_out),
    )


def describe_localizer(apr: Contract, fusion: Contract) -> Contract:
    """Describe the whole: the regressor's outputs are no inputs any more."""
    frame_and_state = fusion.inputs[len(_APR_OUTPUTS) + 1 :]
    *fused, next_state = fusion.outputs
    return msgspec.structs.replace(
        fusion,
        part="localizer",
        inputs=(*apr.inputs, *frame_and_state),
        outputs=(*fused, *apr.outputs, next_state),
        image=apr.image,
    )
