"""`vioapr demo`: a walk localized from its pictures, without any data of one's own."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from vioapr.cli.console import is_watched, say
from vioapr.cli.localize import localize_
from vioapr.recipes.demo import unpack_demo


def demo(out: Path = Path("vioapr-demo"), open_report: bool = True) -> None:
    """Localize a walk through a courtyard from its pictures, and open the report.

    Pictures, tracker and a localizer for the place come with the package; docs/guide/demo.md says
    how they were made. Compared are the raw regressor, VIO alone, the paper's method and consensus.
    The files are like a user's own: try the command that is printed on them, or `vioapr bench`.

    Args:
        out: Folder to copy scene and localizer to, and to write fused.csv and the report to.
        open_report: Show the report in a browser, if there is one.

    Example:
        vioapr demo
    """
    given = unpack_demo(out)
    say(
        f"vioapr localize --model {given.model} --recording {given.recording} "
        f"--out {given.out} --report {given.report}"
    )
    localize_(given.model, given.out, given.recording, report=given.report)
    if open_report and is_watched():
        webbrowser.open((given.report / "index.html").resolve().as_uri())
