"""Who may ask: a bearer token on all of `/api/`, and headers that keep other sites out."""

from __future__ import annotations

import asyncio
import secrets

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vioapr.schemas.server import Problem
from vioapr.server.refusals import answer

_HEARD_OUT_BYTES, _HEARD_OUT_S = 1 << 20, 5.0

_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    # Shared memory, for the localizer's threads, and no other site may embed or open the page.
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-embedder-policy", b"require-corp"),
    (b"cross-origin-resource-policy", b"same-origin"),
    # WebAssembly is compiled from the page's own files; workers and images come from blobs.
    (
        b"content-security-policy",
        b"default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self' blob:; "
        b"img-src 'self' blob: data:; connect-src 'self' blob: data:; "
        b"style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'",
    ),
)


class Guard:
    """Lets requests through to an app that know the token, or ask for what is public.

    Public are the page's own files, `/api`, which says which server this is, and the
    authority's certificate.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        """Stand before an app.

        Args:
            app: What is guarded.
            token: What clients must know.
        """
        self._app, self._wanted = app, f"Bearer {token}".encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        body = _Body(receive)

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [*message.get("headers", ()), *_HEADERS]
                # A client that is cut off while it sends does not see why: hear it out, to a point.
                if message["status"] >= 400 and not await body.is_heard_out():
                    headers.append((b"connection", b"close"))
                message["headers"] = headers
            await send(message)

        if not scope["path"].isprintable():
            # A pattern of addresses would pass over a newline at the end.
            problem = Problem(error="expected an address without control characters")
            await answer(problem, 400)(scope, body.receive, send_guarded)
            return
        if _is_private(scope["path"]) and not self._knows_token(scope):
            problem = Problem(error="expected the token that `vioapr serve` prints")
            response = answer(problem, 401)
            response.headers["www-authenticate"] = "Bearer"
            await response(scope, body.receive, send_guarded)
            return
        await self._app(scope, body.receive, send_guarded)

    def _knows_token(self, scope: Scope) -> bool:
        given = [value for name, value in scope["headers"] if name == b"authorization"]
        return len(given) == 1 and secrets.compare_digest(given[0], self._wanted)


class _Body:
    """A request's body, of which it is known whether all of it came."""

    def __init__(self, receive: Receive) -> None:
        self._receive, self._is_over = receive, False

    async def receive(self) -> Message:
        """The next block."""
        message = await self._receive()
        self._is_over = message["type"] == "http.disconnect" or not message.get("more_body", False)
        return message

    async def is_heard_out(self) -> bool:
        """Pass over the rest of the body, if it is short; whether it is over then."""
        left = _HEARD_OUT_BYTES
        try:
            async with asyncio.timeout(_HEARD_OUT_S):
                while not self._is_over and left > 0:
                    left -= len((await self.receive()).get("body", b""))
        except TimeoutError:
            return False
        return self._is_over


def _is_private(path: str) -> bool:
    return path != "/api" and (path == "/api/" or path.startswith("/api/"))
