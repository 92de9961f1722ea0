"""The entry point: parses, runs a verb, and turns users' errors into one line and exit code 2."""

from __future__ import annotations

import functools
import io
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from typing import Any

import tyro

from vioapr.cli.bench import bench_
from vioapr.cli.convert import convert
from vioapr.cli.demo import demo
from vioapr.cli.evaluate import evaluate
from vioapr.cli.export import export
from vioapr.cli.fuse import fuse
from vioapr.cli.import_ import import_
from vioapr.cli.inspect import inspect
from vioapr.cli.localize import localize_
from vioapr.cli.map_scene import map_
from vioapr.cli.predict import predict
from vioapr.cli.reproduce import reproduce_7scenes, reproduce_cambridge, reproduce_marvin
from vioapr.cli.scene import scene_check, scene_info
from vioapr.cli.simulate import simulate_courtyard
from vioapr.cli.simulate_walks import simulate_walks
from vioapr.cli.train import train
from vioapr.cli.vio_quality import vio_quality
from vioapr.errors import VioAprError

VERBS: dict[str, Callable[..., Any]] = {
    "inspect": inspect,
    "convert": convert,
    "import": import_,
    "scene check": scene_check,
    "scene info": scene_info,
    "fuse": fuse,
    "evaluate": evaluate,
    "map": map_,
    "vio-quality": vio_quality,
    "train": train,
    "predict": predict,
    "reproduce marvin": reproduce_marvin,
    "reproduce 7scenes": reproduce_7scenes,
    "reproduce cambridge": reproduce_cambridge,
    "simulate courtyard": simulate_courtyard,
    "simulate walks": simulate_walks,
    "export": export,
    "localize": localize_,
    "bench": bench_,
    "demo": demo,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Without the program's name; None for the process's own.

    Returns:
        Exit code: 0, or 2 where the user can mend what is wrong.
    """
    try:
        command = _parse(sys.argv[1:] if arguments is None else list(arguments))
        command()
        sys.stdout.flush()
    except VioAprError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output has gone, e.g. `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def _parse(arguments: list[str]) -> Callable[[], Any]:
    """The verb with its arguments, not yet run, so that only parsing errors are rewritten."""
    messages = io.StringIO()
    if " ".join(arguments[:2]) in VERBS:
        arguments = [" ".join(arguments[:2]), *arguments[2:]]
    try:
        with redirect_stderr(messages):
            return tyro.extras.subcommand_cli_from_dict(
                {name: _deferred(verb) for name, verb in VERBS.items()},
                prog="vioapr",
                description=(
                    "Robust absolute poses from a pose regressor and a phone's visual-inertial "
                    "odometry."
                ),
                args=arguments or ["--help"],
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise VioAprError(_one_line(messages.getvalue())) from None


def _deferred(verb: Callable[..., Any]) -> Callable[..., Callable[[], Any]]:
    @functools.wraps(verb)
    def bind(*args: Any, **kwargs: Any) -> Callable[[], Any]:
        return functools.partial(verb, *args, **kwargs)

    return bind


def _one_line(box: str) -> str:
    """The message out of the parser's box of several lines, drawn or plain."""
    lines = [line.strip("│╭╮╰╯ ") for line in box.splitlines()]
    sections: list[list[str]] = [[]]
    for line in lines[1:]:  # the first is the box's title
        if line and not line.strip("─-"):
            sections.append([])
        elif line:
            sections[-1].append(line)
    message, *others = (section for section in sections if section)
    if message[0].startswith("Missing from"):
        flags = [line.split()[0] for line in message if line.startswith("--")]
        return f"missing {', '.join(flags)} (see vioapr --help)"
    kept = [message, *(section for section in others if section[0].startswith("Available"))]
    return "; ".join(" ".join(section).rstrip(".") for section in kept) + " (see vioapr --help)"
