"""The contract of what is exported: inputs and outputs in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import vioapr
from vioapr.export.graph import MAX_RUN_PAIRS, FusionGraph, Preprocessor
from vioapr.schemas.contract import Contract, ParamSpec, TensorSpec

_POSE, _ONE = (7,), (1,)

_IMAGE = TensorSpec("image", "uint8", ("height", "width", 3), "RGB; any if has_image is 0")
_HAS_IMAGE = TensorSpec("has_image", "float32", _ONE, "flag: this frame has an image")
_APR = TensorSpec("apr_world_from_cam", "float32", _POSE, "the regressor's pose")
_HAS_APR = TensorSpec("has_apr", "float32", _ONE, "flag: this frame has a regressor's pose")

_FRAME = (
    TensorSpec("vio_from_cam", "float32", _POSE, "the tracker's pose; any if tracking_ok is 0"),
    TensorSpec("timestamp_s", "float32", _ONE, "of the image, later than the last frame's"),
    TensorSpec("tracking_ok", "float32", _ONE, "flag: the tracker knows its pose"),
    TensorSpec(
        "tracking_reset", "float32", _ONE, "flag: the tracker's world is a new one from here on"
    ),
)

_APR_OUTPUTS = (
    _APR,
    TensorSpec("apr_sigma_position_m", "float32", _ONE, "the regressor's own, per axis, m"),
    TensorSpec("apr_sigma_orientation_deg", "float32", _ONE, "the regressor's own, deg"),
)

_FUSED = {
    spec.name: spec
    for spec in (
        TensorSpec("world_from_cam", "float32", _POSE, "the fused pose; NaN if status is 0"),
        TensorSpec("world_from_vio", "float32", _POSE, "for content in the map; NaN if unknown"),
        TensorSpec("status", "int32", _ONE, "where the pose comes from: see statuses"),
        TensorSpec(
            "confirmed_run", "int32", _ONE, "n: this and the n - 1 predictions before it are right"
        ),
        TensorSpec("sigma_position_m", "float32", _ONE, "per axis, m"),
        TensorSpec("sigma_orientation_deg", "float32", _ONE, "per axis, deg"),
        TensorSpec("sigma_position_axes_m", "float32", (3,), "along the world's axes, m"),
        TensorSpec("sigma_orientation_axes_deg", "float32", (3,), "about the world's axes, deg"),
    )
}


def describe_apr(preprocess: Preprocessor, facts: Mapping[str, Any]) -> Contract:
    """Of the regressor alone, the first of a split pair."""
    return Contract("apr", (_IMAGE, _HAS_IMAGE), _APR_OUTPUTS, **_image(preprocess), **facts)


def describe_fusion(fusion: FusionGraph, outputs: tuple[str, ...], **facts: Any) -> Contract:
    """Of the fusion step alone, the second of a split pair."""
    inputs = (*_APR_OUTPUTS, _HAS_APR, *_FRAME, *_state_inputs(fusion))
    return Contract("fusion", inputs, _fused(fusion, outputs), **_method(fusion), **facts)


def describe_localizer(
    preprocess: Preprocessor,
    fusion: FusionGraph,
    outputs: tuple[str, ...],
    facts: Mapping[str, Any],
) -> Contract:
    """Of the whole."""
    inputs = (_IMAGE, _HAS_IMAGE, *_FRAME, *_state_inputs(fusion))
    *fused, next_state = _fused(fusion, outputs)
    return Contract(
        "localizer",
        inputs,
        (*fused, *_APR_OUTPUTS, next_state),
        **_image(preprocess),
        **_method(fusion),
        **facts,
    )


def made_by() -> str:
    """Program and version."""
    return f"vioapr {vioapr.__version__}"


def _image(preprocess: Preprocessor) -> dict[str, Any]:
    return {"image": {"resize": preprocess.resize, "crop": preprocess.crop}}


def _state_inputs(fusion: FusionGraph) -> tuple[TensorSpec, ...]:
    state = TensorSpec("state", "float32", (fusion.layout.size,), "the last next_state, or zeros")
    names = fusion.param_names
    if not names:
        return (state,)
    return state, TensorSpec("params", "float32", (len(names),), "numbers of the method: params")


def _fused(fusion: FusionGraph, outputs: tuple[str, ...]) -> tuple[TensorSpec, ...]:
    shape = (fusion.layout.size,)
    next_state = TensorSpec("next_state", "float32", shape, "the state for the next frame")
    return tuple(_FUSED.get(name, next_state) for name in outputs)


def _method(fusion: FusionGraph) -> dict[str, Any]:
    values = asdict(fusion.params)
    run_time = tuple(_param(name, values) for name in fusion.param_names)
    offset, layout = 1, []
    for leaf in fusion.layout.leaves:
        layout.append({"name": leaf.name, "shape": list(leaf.shape), "offset": offset})
        offset += leaf.size
    return {
        "method": fusion.method.name,
        "params": run_time,
        "fixed_params": {k: v for k, v in values.items() if k not in fusion.param_names},
        "state_size": fusion.layout.size,
        "state_tag": fusion.layout.tag,
        "state_layout": tuple(layout),
    }


def _param(name: str, values: Mapping[str, Any]) -> ParamSpec:
    default = float(values[name])
    if name == "run_pairs":
        return ParamSpec(name, default, 1, max(default, MAX_RUN_PAIRS))
    return ParamSpec(name, default, 1 if name == "optimized_frames" else 0)
