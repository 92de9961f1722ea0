"""`vioapr build`: from a scene to a localizer in one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import explain, log, progress, say
from vioapr.cli.torch_extra import require_torch
from vioapr.recipes.build.params import BuildParams


def build(
    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")],
    params: tyro.conf.OmitArgPrefixes[tyro.conf.FlagCreatePairsOff[BuildParams]] = BuildParams(),  # noqa: B008
) -> None:
    """Build a localizer of a scene: check, map, fit, predict, calibrate, evaluate, export.

    Leaves SCENE/build/localizer.onnx, which `vioapr localize` and phones run, and the page
    SCENE/build/index.html: how accurate it is on the test recordings, how far its stated
    uncertainties can be believed, and what to record next. Stopped at any moment, the same command
    goes on; steps whose inputs have not changed are not repeated. Recordings with ground truth of
    their own are not mapped.

    Args:
        scene: The scene's folder.
        params: What is built.

    Example:
        vioapr build courtyard
    """
    require_torch("vioapr build")
    from vioapr.recipes.build.pipeline import BUILD_FOLDER, LOCALIZER_FILE
    from vioapr.recipes.build.pipeline import build as run_build
    from vioapr.report.build_report import PAGE_FILE, describe_result

    summary = run_build(scene, params, progress, log)
    folder, localizer = scene / BUILD_FOLDER, summary.localizers[0]
    say(f"{folder / LOCALIZER_FILE}: {localizer.bytes / 1e6:.2f} MB")
    explain(describe_result(localizer))
    if summary.advice or summary.areas:
        say("what to record next:")
        for sentence in (*summary.advice, *summary.areas):
            explain(f"- {sentence}")
    say(f"report: {(folder / PAGE_FILE).resolve()}")
