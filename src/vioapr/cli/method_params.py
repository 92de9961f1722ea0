"""The parameters of every registered method as flags of the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field, make_dataclass
from typing import TYPE_CHECKING, Any

import tyro

from vioapr.cli.flags import split_names
from vioapr.cli.parameters import Parameter
from vioapr.errors import ParameterError
from vioapr.fusion.methods import DEFAULT_METHOD, METHODS, get_method

_PARAMS_TYPES = list(dict.fromkeys(method.params_type for method in METHODS.values()))

if TYPE_CHECKING:

    class MethodParams:
        """Made below, as its fields are those of the methods that are registered."""

else:
    MethodParams = make_dataclass(
        "MethodParams",
        [
            (kind.__name__, tyro.conf.OmitArgPrefixes[kind], field(default_factory=kind))
            for kind in _PARAMS_TYPES
            if kind.__dataclass_fields__
        ],
        frozen=True,
    )


def find_foreign_flag(given: Iterable[Parameter], values: Mapping[str, object]) -> str:
    """Find a flag that is given and that no chosen method takes.

    Args:
        given: The parameters whose flags are given.
        values: Of the verb's parameters: of them, `method` or `methods` says what is chosen.

    Returns:
        What is wrong, or nothing.
    """
    names = str(values.get("methods") or values.get("method") or DEFAULT_METHOD)
    chosen = [METHODS[name] for name in split_names(names) if name in METHODS]
    for one in given:
        takers = [method.name for method in METHODS.values() if method.params_type is one.owner]
        if takers and chosen and not set(takers) & {method.name for method in chosen}:
            which = "method" if len(takers) == 1 else "methods"
            return (
                f"{one.flag} is a flag of {which} {', '.join(takers)}: expected flags of "
                f"{', '.join(method.name for method in chosen)}, or that method"
            )
    return ""


def params_for(name: str, params: Any) -> Any:
    """A method's own parameters out of `MethodParams`.

    Raises:
        ParameterError: There is no method of that name.
    """
    kind = get_method(name).params_type
    return getattr(params, kind.__name__, None) or kind()


def parse_methods(names: str, params: Any) -> dict[str, Any]:
    """Methods of a comma-separated list, each with its parameters.

    Raises:
        ParameterError: The list is empty, or has an unknown or repeated name.
    """
    listed = split_names(names)
    if not listed:
        raise ParameterError(f"methods: expected names from {', '.join(METHODS)}, got none")
    repeated = {name for name in listed if listed.count(name) > 1}
    if repeated:
        raise ParameterError(f"methods: {', '.join(sorted(repeated))} is named twice")
    return {name: params_for(name, params) for name in listed}
