"""`vioapr demo`: a walk localized from its pictures, without any data of one's own."""

from __future__ import annotations

import shutil
import webbrowser
from importlib.resources import as_file, files
from pathlib import Path

from vioapr.cli.console import console, error_console
from vioapr.cli.localize import localize_
from vioapr.errors import UnwritableError
from vioapr.scene.scene import Scene

LOCALIZER = "localizer.onnx"
SCENE = "courtyard"


def demo(out: Path = Path("vioapr-demo"), open_report: bool = True) -> None:
    """Localize a walk through a courtyard from its pictures, and open the report.

    Pictures, tracker and a localizer for the place come with the package; docs/demo.md says how
    they were made. Compared are the raw regressor, VIO alone, the paper's method and consensus.
    The files are like a user's own: try the command that is printed on them, or `vioapr bench`.

    Args:
        out: Folder to copy scene and localizer to, and to write fused.csv and the report to.
        open_report: Show the report in a browser, if there is one.
    """
    _copy(out)
    scene = Scene.open(out / SCENE)
    folder = scene.recording_folder(scene.splits["test"][0])
    console.print(
        f"vioapr localize --model {out / LOCALIZER} --recording {folder} "
        f"--out {out / 'fused.csv'} --report {out / 'report'}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    localize_(out / LOCALIZER, out / "fused.csv", folder, report=out / "report")
    if open_report and error_console.is_terminal:
        webbrowser.open((out / "report" / "index.html").resolve().as_uri())


def _copy(out: Path) -> None:
    """Scene and localizer out of the package; what an earlier demo left is replaced."""
    try:
        with as_file(files("vioapr") / "demo") as package:
            shutil.copytree(package, out, dirs_exist_ok=True)
    except OSError as error:
        raise UnwritableError.of(out, error) from None
