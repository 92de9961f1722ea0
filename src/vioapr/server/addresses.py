"""The server's address, as a text and as a QR code that a phone reads."""

from __future__ import annotations

import io
import ipaddress
import socket
from collections.abc import Sequence

from vioapr.errors import MissingExtraError

LOOPBACK = "127.0.0.1"
EVERYWHERE = ("0.0.0.0", "::")


def is_loopback(host: str) -> bool:
    """Whether a host's name or address is this computer alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def find_lan_address() -> str | None:
    """The address that phones in the same network reach this computer by; None without one.

    Nothing is sent: the system only says by which of its addresses it would send.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # of a network that is for documentation
        except OSError:
            return None
        found = probe.getsockname()[0]
    return None if is_loopback(found) else found


def names_of(host: str, shown: str) -> Sequence[str]:
    """Names and addresses that a certificate is for."""
    names = [shown, "localhost", LOOPBACK]
    if host not in (*EVERYWHERE, shown):
        names.append(host)
    return list(dict.fromkeys(names))


def address_of(host: str, port: int, token: str, *, is_https: bool) -> str:
    """The page's address; the token is in its fragment, which browsers never send."""
    shown = f"[{host}]" if ":" in host else host
    return f"http{'s' if is_https else ''}://{shown}:{port}/#token={token}"


def qr_code(text: str) -> str:
    """A text as a QR code for a terminal.

    Raises:
        MissingExtraError: segno is not installed.
    """
    try:
        import segno
    except ImportError:
        raise MissingExtraError("the QR code", "segno", "web") from None
    out = io.StringIO()
    segno.make(text, micro=False).terminal(out, compact=True)
    return out.getvalue()
