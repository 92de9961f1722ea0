"""All fusion methods. A new one is a new module and a line here."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from vioapr.errors import ParameterError
from vioapr.fusion import apr, mapnet_pgo, pose_filter, pose_graph, vio, vio_apr
from vioapr.fusion.chain import method as chain
from vioapr.fusion.types import Method

METHODS: dict[str, Method] = {
    module.METHOD.name: module.METHOD
    for module in (apr, vio, vio_apr, chain, pose_filter, mapnet_pgo, pose_graph)
}

DEFAULT_METHOD = chain.METHOD.name


def get_method(name: str) -> Method:
    """The method of a name.

    Raises:
        ParameterError: There is none; the message lists them.
    """
    if name not in METHODS:
        raise ParameterError(f"unknown method {name!r}: expected one of {', '.join(METHODS)}")
    return METHODS[name]


def default_params(names: Iterable[str]) -> dict[str, Any]:
    """The methods of some names, each with its default parameters.

    Raises:
        ParameterError: There is no method of a name.
    """
    return {name: get_method(name).params_type() for name in names}
