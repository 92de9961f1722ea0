"""Running the server until it is stopped."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vioapr.errors import MissingExtraError, ParameterError, VioAprError
from vioapr.server.addresses import (
    EVERYWHERE,
    LOOPBACK,
    address_of,
    find_lan_address,
    is_loopback,
    names_of,
)
from vioapr.server.certificates import Identity, default_folder, make_identity
from vioapr.server.layout import ServedFolder
from vioapr.server.tokens import keep_token
from vioapr.work.held import require_locks
from vioapr.work.locks import locked_folder

if TYPE_CHECKING:
    import uvicorn
    from starlette.types import ASGIApp

_CONNECTIONS = 512
_GOODBYE_S = 3


@dataclass(frozen=True)
class Running:
    """A server that takes requests.

    Attributes:
        address: For a browser, with the token.
        port: That it listens on.
        identity: Of HTTPS, else None.
    """

    address: str
    port: int
    identity: Identity | None


def choose_host(host: str | None, *, https: bool, plain_http: bool) -> str:
    """The address to listen on; other computers only reach it where that is safe, or asked for.

    Raises:
        ParameterError: They would, without HTTPS.
    """
    chosen = host or (EVERYWHERE[0] if https else LOOPBACK)
    if not is_loopback(chosen) and not (https or plain_http):
        raise ParameterError(
            f"host: {chosen} lets others in the network read the token and the pictures: give "
            "`https`, or `plain_http` if that is what you want"
        )
    return chosen


def serve(
    folder: Path,
    *,
    host: str | None = None,
    port: int = 8000,
    token: str | None = None,
    https: bool = False,
    plain_http: bool = False,
    tls_folder: Path | None = None,
    on_start: Callable[[Running], object],
) -> None:
    """Serve a folder of scenes until the process is asked to end.

    Args:
        folder: The scenes are folders in it.
        host: Address to listen on; by default this computer alone, and with `https` all.
        port: 0 for any that is free.
        token: What clients must know; by default the folder's own.
        https: Encrypt, with a certificate by the user's own authority.
        plain_http: Let others in the network in without encryption.
        tls_folder: The authority's; by default in the user's own folder.
        on_start: Called once requests are taken.

    Raises:
        MissingExtraError: A package of the extra `web` is not installed.
        ParameterError: The host needs HTTPS, or the token is too short.
        LockedError: Another server serves the folder.
        VioAprError: The folder cannot be served, or the port is taken.
    """
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("the server", str(error.name), "web") from None
    require_locks("vioapr serve")
    served = ServedFolder.open(folder)
    chosen = choose_host(host, https=https, plain_http=plain_http)
    shown = (find_lan_address() or LOOPBACK) if chosen in EVERYWHERE else chosen
    with ExitStack() as held:
        held.enter_context(locked_folder(served.state))
        listener = held.enter_context(_listen(chosen, port))
        real_port = listener.getsockname()[1]
        known = keep_token(served.token_file, token)
        names = names_of(chosen, shown)
        identity = make_identity(tls_folder or default_folder(), names) if https else None
        from vioapr.server.app import make_app

        app = make_app(served, known, ca_pem=None if identity is None else identity.ca_pem)
        address = address_of(shown, real_port, known, is_https=https)
        running = Running(address, real_port, identity)
        server = _make_server(app, identity, lambda: on_start(running))
        with suppress(KeyboardInterrupt):  # the usual end, by Ctrl-C or a service manager
            server.run(sockets=[listener])


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        VioAprError: The address is not this computer's, or the port is taken.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or error
        raise VioAprError(f"{host}:{port}: cannot be listened on: {reason}") from None
    return listener


def _make_server(
    app: ASGIApp, identity: Identity | None, on_start: Callable[[], object]
) -> uvicorn.Server:
    import uvicorn

    class Server(uvicorn.Server):
        """Says when it takes requests."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            on_start()

    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        limit_concurrency=_CONNECTIONS,
        timeout_graceful_shutdown=_GOODBYE_S,
        ws="none",
        ssl_context_factory=None if identity is None else (lambda *_: identity.context),
    )
    return Server(config)
