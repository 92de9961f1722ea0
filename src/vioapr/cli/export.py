"""`vioapr export`: a trained regressor and a fusion method as files for phones."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vioapr.cli.calibrated import calibrated_params, pick_pair, require_chain
from vioapr.cli.console import say
from vioapr.cli.method_params import MethodParams, params_for
from vioapr.cli.torch_extra import require_torch
from vioapr.errors import MissingExtraError, ParameterError
from vioapr.files.atomic import replacing
from vioapr.files.outputs import check_outputs
from vioapr.fusion.calibrated import read_calibration
from vioapr.fusion.methods import DEFAULT_METHOD, get_method
from vioapr.schemas.regressor import REGRESSOR_FILE

Precision = Literal["fp32", "fp16w", "int8w", "int8-qdq"]


def export(
    checkpoint: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CHECKPOINT")],
    out: Path,
    method: str = DEFAULT_METHOD,
    precision: Precision = "fp32",
    split: bool = False,
    calibration: Path | None = None,
    quantize_by: Path | None = None,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    params: tyro.conf.OmitArgPrefixes[MethodParams] = MethodParams(),  # noqa: B008
) -> None:
    """Export the whole localizer as one ONNX file: image and tracker pose in, fused pose out.

    docs/reference/contract.md says how to call it from any language (pip install 'vioapr[export]').

    Args:
        checkpoint: What `vioapr train` wrote.
        out: ONNX file to write; with --split, <name>.apr.onnx, .fusion.onnx and .carry.onnx.
        method: How to fuse: chain or vio-apr (the paper's).
        precision: fp32; fp16w: half-precision weights, for half the size; int8w: weights of 8
            bits, for a quarter; int8-qdq: arithmetic of 8 bits too, faster, not for Unity.
        split: Write regressor, fusion, and fusion of frames without image as three files, e.g.
            for a browser that runs the last at every frame.
        calibration: What `vioapr calibrate` found with this regressor, for method chain: the file
            carries it. A flag wins over what it says.
        quantize_by: For int8-qdq: a scene, of whose training images some are used.
        overwrite: Replace the files to write if they exist; never the checkpoint.
        params: Parameters of the methods. Those that the file takes as input are its defaults.

    Example:
        vioapr export courtyard/models/efficientnet-lite0 --out courtyard.onnx
    """
    if (precision == "int8-qdq") != (quantize_by is not None):
        raise ParameterError("`precision` int8-qdq and `quantize_by` go together")
    chosen, method_params = get_method(method), params_for(method, params)
    known = None
    if calibration is not None:
        require_chain([method])
        known = read_calibration(calibration)
    parts = ("apr", "fusion", "carry")
    paths = [out.with_suffix(f".{part}.onnx") for part in parts] if split else [out]
    read = [checkpoint / REGRESSOR_FILE, checkpoint, calibration]
    check_outputs(paths, read, overwrite=overwrite)
    require_torch("vioapr export")
    try:
        from vioapr.export.exporter import Exporter
        from vioapr.regression import checkpoint as checkpoints
    except ImportError as error:
        raise MissingExtraError("vioapr export", error.name or "onnx", "export") from None
    loaded = checkpoints.load(checkpoint)
    if known is not None:
        pair = pick_pair(known, None, loaded.spec.model.replace(":", "-"))
        method_params = calibrated_params(pair, method_params)
    exporter = Exporter(loaded.network, loaded.spec, chosen, method_params)
    images = None
    if quantize_by is not None:
        from vioapr.export.quantize import training_images

        images = training_images(quantize_by, exporter.preprocess)
    if split:
        made = exporter.export_split(precision, images)
    else:
        made = [exporter.export(precision, images)]
    with ExitStack() as files:  # they are replaced when all are whole
        for path, file in zip(paths, made, strict=True):
            files.enter_context(replacing(path, overwrite=overwrite)).write_bytes(file.content)
    for path, file in zip(paths, made, strict=True):
        say(f"{path}: {len(file.content) / 1e6:.2f} MB")
