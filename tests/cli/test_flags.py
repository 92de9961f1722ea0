from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from vioapr.cli.flags import flag_names, name_flags
from vioapr.errors import FormatError, ParameterError


@dataclass(frozen=True)
class Window:
    size: Annotated[int, tyro.conf.arg(name="window-size")] = 3
    sigma_m: Annotated[float, tyro.conf.arg(name="window-sigma-m")] = 1.0


@dataclass(frozen=True)
class Graph:
    sigma_m: Annotated[float, tyro.conf.arg(name="graph-sigma-m")] = 1.0
    window: tyro.conf.OmitArgPrefixes[Window] = Window()


def verb(
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="IN")],
    from_: Annotated[str | None, tyro.conf.arg(name="from")] = None,
    seed: int = 0,
    rate_hz: float | None = None,
    params: tyro.conf.OmitArgPrefixes[Graph] = Graph(),
) -> None: ...


FLAGS = flag_names(verb)


def test_flags_are_those_that_the_parser_takes():
    assert FLAGS == {
        "source": "IN",
        "from_": "--from",
        "seed": "--seed",
        "rate_hz": "--rate-hz",
        "Graph.sigma_m": "--graph-sigma-m",
        "size": "--window-size",
        "Window.size": "--window-size",
        "Window.sigma_m": "--window-sigma-m",
    }


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("seed: expected at least 0, got -1", "--seed: expected at least 0, got -1"),
        ("seed and size: expected at least 0", "--seed and --window-size: expected at least 0"),
        ("source: expected a file", "IN: expected a file"),
        ("Window.sigma_m: expected above 0", "--window-sigma-m: expected above 0"),
        ("sigma_m: which of the two?", "sigma_m: which of the two?"),
        ("no times: give rate_hz", "no times: give --rate-hz"),
        ("no times: give `seed` or `rate_hz`", "no times: give --seed or --rate-hz"),
        ("the size of a seed", "the size of a seed"),
        ("walks/rate_hz/a: seed", "walks/rate_hz/a: seed"),
        ("a.rate_hz and --rate_hz", "a.rate_hz and --rate_hz"),
    ],
)
def test_parameters_in_messages_become_flags(message, expected):
    assert name_flags(ParameterError(message), FLAGS) == expected


def test_other_errors_speak_of_files():
    assert name_flags(FormatError("rate_hz", "seed: no"), FLAGS) == "rate_hz: seed: no"
    assert name_flags(FormatError("a", "needs `rate_hz`"), FLAGS) == "a: needs --rate-hz"
