"""HTTPS without a public name: an authority of the user's own, and certificates by it.

The authority's key can vouch for any site to a phone that has installed it. So it stays in the
user's own folder, readable for its owner alone, never in a folder that may be shared.
"""

from __future__ import annotations

import os
import ssl
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from vioapr.errors import FormatError, MissingExtraError, UnreadableError
from vioapr.server.tokens import write_secret

CA_KEY_FILE, CA_FILE = "ca.key.pem", "ca.crt.pem"
_OWNER = "vioapr on this computer"
SERVER_DAYS = 90
"""Phones refuse certificates of more than 398 days; this one is made at every start."""


@dataclass(frozen=True)
class Identity:
    """What an HTTPS server shows.

    Attributes:
        context: Has the server's key and certificate.
        ca_pem: The authority's certificate, for phones to install.
        ca_path: Where it is.
    """

    context: ssl.SSLContext
    ca_pem: bytes
    ca_path: Path


def default_folder() -> Path:
    """Where the user's authority is."""
    home = os.environ.get("XDG_DATA_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share") / "vioapr" / "tls"


def make_identity(folder: Path, names: Sequence[str]) -> Identity:
    """Make a certificate for names and addresses, by an authority that is made once.

    Args:
        folder: The authority's; made if needed.
        names: Host names and IP addresses of the server.

    Raises:
        FormatError: The authority's files are broken.
        FileError: They cannot be read or written.
        MissingExtraError: trustme is not installed.
    """
    try:
        import trustme
    except ImportError:
        raise MissingExtraError("HTTPS", "trustme", "web") from None
    key_path, ca_path = folder / CA_KEY_FILE, folder / CA_FILE
    if not (key_path.exists() and ca_path.exists()):
        made = trustme.CA(organization_name=_OWNER, organization_unit_name="vioapr authority")
        write_secret(key_path, made.private_key_pem.bytes())
        write_secret(ca_path, made.cert_pem.bytes())
    try:
        ca = trustme.CA.from_pem(ca_path.read_bytes(), key_path.read_bytes())
    except OSError as error:
        raise UnreadableError.of(key_path, error) from None
    except (ValueError, TypeError):
        text = f"expected a key: remove {folder} for a new authority, and install that on phones"
        raise FormatError(key_path, text) from None
    now = datetime.now(UTC)
    leaf = ca.issue_cert(
        *names,
        not_before=now - timedelta(days=1),  # clocks differ
        not_after=now + timedelta(days=SERVER_DAYS),
        organization_name=_OWNER,
        organization_unit_name="vioapr server",
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    with tempfile.TemporaryDirectory() as private:  # of mode 0700
        chain = Path(private) / "server.pem"
        write_secret(chain, leaf.private_key_and_cert_chain_pem.bytes())
        context.load_cert_chain(chain)
    return Identity(context, ca.cert_pem.bytes(), ca_path)
