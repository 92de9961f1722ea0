"""`vioapr demo`: a walk localized from its pictures, without any data of one's own."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import is_watched, say
from vioapr.cli.evaluate import check_report
from vioapr.cli.localize import localize_
from vioapr.recipes.demo import demo_in, unpack_demo
from vioapr.work.results import ResultFolder


def demo(
    out: Path = Path("vioapr-demo"),
    open_report: bool = True,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Localize a walk through a courtyard from its pictures, and open the report.

    Pictures, tracker and a localizer for the place come with the package; docs/guide/demo.md says
    how they were made. Compared are the raw regressor, VIO alone, the paper's method and chain.
    The files are like a user's own: try the command that is printed on them, or `vioapr bench`.

    Args:
        out: Folder to copy scene and localizer to, and to write fused.csv, predictions.tum and
            the report to. Files of an earlier demo are replaced, others stay.
        open_report: Show the report in a browser, if there is one.
        overwrite: Replace files of the same names too that no demo wrote.

    Example:
        vioapr demo
    """
    results, planned = ResultFolder(out, overwrite=overwrite), demo_in(out)
    written = [planned.out.name, planned.predictions.name]
    results.check(written)
    check_report(planned.report, overwrite=overwrite)
    given = unpack_demo(out, overwrite=overwrite)
    say(
        f"vioapr localize --model {given.model} --recording {given.recording} "
        f"--out {given.out} --predictions {given.predictions} --report {given.report} --overwrite"
    )
    localize_(
        given.model, given.out, given.recording,
        predictions=given.predictions, report=given.report, overwrite=True,
    )  # fmt: skip
    results.add_note(written)
    if open_report and is_watched():
        webbrowser.open((given.report / "index.html").resolve().as_uri())
