"""The parameters of verbs as the parser names them: for help, for suggestions and for messages."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass
from typing import Any, get_args, get_type_hints


@dataclass(frozen=True)
class Parameter:
    """A parameter of a verb, or a field of a dataclass that is one.

    Attributes:
        owner: The dataclass, or None for the verb's own.
        name: In Python.
        flag: On the command line: `--name`, or the metavar of a positional one.
        kind: Its type, without annotations.
        default: Its default, or `inspect.Parameter.empty`.
        markers: The annotations of its type.
        is_positional: Whether it is given without a flag.
        has_opposite: Whether it is a switch that `--no-name` turns off.
    """

    owner: type | None
    name: str
    flag: str
    kind: Any
    default: Any
    markers: tuple[Any, ...]
    is_positional: bool
    has_opposite: bool

    @property
    def is_required(self) -> bool:
        """Whether it must be given."""
        return self.default is inspect.Parameter.empty

    @property
    def flags(self) -> tuple[str, ...]:
        """What can be written on the command line; nothing where it is positional."""
        if self.is_positional:
            return ()
        return (self.flag, f"--no-{self.flag[2:]}") if self.has_opposite else (self.flag,)


def parameters_of(owner: Callable[..., Any]) -> Iterator[Parameter]:
    """Walk through the parameters of a verb and, in place, the fields of its dataclasses."""
    defaults = {name: p.default for name, p in inspect.signature(owner).parameters.items()}
    yield from _walk(owner, defaults, ())


def _walk(owner: Any, defaults: dict[str, Any], outer: tuple[str, ...]) -> Iterator[Parameter]:
    for name, hint in get_type_hints(owner, include_extras=True).items():
        kind, *markers = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
        markers_by_name = (*outer, *map(repr, markers))
        if name == "return" or name not in defaults:
            continue
        if isinstance(kind, type) and is_dataclass(kind):
            yield from _walk(kind, _defaults_of(kind, defaults[name]), markers_by_name)
            continue
        configured = [marker for marker in markers if hasattr(marker, "metavar")]
        named = [marker.name for marker in configured]
        flag = f"--{next(filter(None, named), name.strip('_').replace('_', '-'))}"
        is_positional = "Positional" in markers_by_name
        if is_positional:
            flag = next(filter(None, (one.metavar for one in configured)), name.upper())
            flag = flag.strip("[]")  # of several files, the parser would take none; verbs do not
        is_switch = kind is bool and defaults[name] is not inspect.Parameter.empty
        yield Parameter(
            owner=owner if isinstance(owner, type) else None,
            name=name,
            flag=flag,
            kind=kind,
            default=defaults[name],
            markers=tuple(markers),
            is_positional=is_positional,
            has_opposite=is_switch and "FlagCreatePairsOff" not in markers_by_name,
        )


def _defaults_of(kind: type, given: Any) -> dict[str, Any]:
    """Defaults of a dataclass's fields: of the instance that is the default, else its own."""
    defaults: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        if isinstance(given, kind):
            default = getattr(given, field.name)
        elif field.default is not dataclasses.MISSING:
            default = field.default
        elif field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        else:
            default = inspect.Parameter.empty
        defaults[field.name] = default
    return defaults
