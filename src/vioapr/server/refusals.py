"""Why a request is refused, as an exception and as an answer."""

from __future__ import annotations

import errno

from starlette.requests import Request
from starlette.responses import Response

from vioapr.errors import (
    AlreadyExistsError,
    DiskFullError,
    FileMissingError,
    FormatError,
    LockedError,
    ParameterError,
    VersionError,
    VioAprError,
)
from vioapr.schemas.base import Record, encode
from vioapr.schemas.server import Problem

_STATUS: tuple[tuple[type[VioAprError], int], ...] = (
    (FileMissingError, 404),
    (AlreadyExistsError, 409),
    (LockedError, 423),
    (DiskFullError, 507),
    (FormatError, 422),
    (VersionError, 422),
    (ParameterError, 422),
)


class Refusal(Exception):
    """A request is refused.

    Attributes:
        status: HTTP's number.
        problem: What is answered.
    """

    def __init__(self, status: int, error: str, missing: tuple[str, ...] = ()) -> None:
        """Say why; see the attributes."""
        self.status, self.problem = status, Problem(error=error, missing=missing)
        super().__init__(error)


def answer(record: Record | list[Record], status: int = 200) -> Response:
    """Answer with a record, or several, as JSON."""
    return Response(
        encode(record, indent=None),
        status,
        headers={"cache-control": "no-cache"},
        media_type="application/json",
    )


async def refuse(request: Request, error: Exception) -> Response:
    """Answer a request that raised one of `HANDLED`.

    Raises:
        Exception: The error, where it is a fault of ours.
    """
    status, problem = _describe(error)
    if status is None:
        raise error
    response = answer(problem, status)
    if status == 401:
        response.headers["www-authenticate"] = "Bearer"
    return response


def _describe(error: Exception) -> tuple[int | None, Problem]:
    if isinstance(error, Refusal):
        return error.status, error.problem
    if isinstance(error, VioAprError):
        status = next((number for kind, number in _STATUS if isinstance(error, kind)), 500)
        return status, Problem(error=str(error))
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return 507, Problem(error="the server's disk is full")
    return None, Problem(error="")


HANDLED: tuple[type[Exception], ...] = (Refusal, VioAprError, OSError)
