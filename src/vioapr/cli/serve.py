"""`vioapr serve`: the server that phones send captures to and fetch localizers from."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from vioapr.cli.console import explain, say
from vioapr.server.addresses import LOOPBACK, qr_code
from vioapr.server.running import Running, serve


def serve_(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")],
    https: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    token: str | None = None,
    host: str | None = None,
    port: int = 8000,
    plain_http: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    tls: Path | None = None,
) -> None:
    """Serve a folder of scenes to phones: take captures in, give localizers and content out.

    Prints an address, and the same as a QR code. Who has the address may read and write: it holds
    the token. The interface is in docs/reference/server.md, and needs the extra `web`. Ctrl-C ends
    the server; jobs that it has begun go on, and it finds them again.

    Args:
        folder: Every scene is a folder in it; the server keeps its own files in .vioapr-server.
        https: Encrypt, by a certificate for this computer's address in the network, and let the
            network in. A phone trusts it once it has installed the authority that is printed.
        token: What clients must know, at least 16 letters and digits; by default one that is made
            once and kept in the folder.
        host: Address to listen on; by default this computer alone, and with --https all of its
            addresses.
        port: Port to listen on; 0 for any that is free.
        plain_http: Let the network in without --https: everybody in it can read along.
        tls: Folder of your own certificate authority; by default in your home folder, for all
            folders that you serve.

    Example:
        vioapr serve places --https

    Raises:
        VioAprError: The folder cannot be served, or the port is taken.
    """
    serve(
        folder,
        host=host,
        port=port,
        token=token,
        https=https,
        plain_http=plain_http,
        tls_folder=tls,
        on_start=lambda running: _say_address(folder, running, is_host_given=host is not None),
    )


def _say_address(folder: Path, running: Running, *, is_host_given: bool) -> None:
    say(qr_code(running.address))
    say(f"{folder}: {running.address}", "bold")
    is_alone = running.address.partition("://")[2].startswith(LOOPBACK)
    if running.identity is not None:
        if is_alone and not is_host_given:
            explain("No address in a network was found: give it by --host.", "yellow")
        explain(
            f"A phone warns of the certificate until it has installed your own authority: open "
            f"{running.address.partition('#')[0]}vioapr-ca.crt there. Its key stays in "
            f"{running.identity.ca_path.parent}: whoever has it can pose as any site to that phone."
        )
    elif is_alone:
        explain(
            f"Only this computer is let in. A phone on a cable is after `adb reverse "
            f"tcp:{running.port} tcp:{running.port}`; over the network, use --https."
        )
    else:
        explain("Everybody in the network can read along: tokens and pictures are not encrypted.")
    explain("Ctrl-C ends it.")
    sys.stdout.flush()  # who reads from a pipe waits for the address
