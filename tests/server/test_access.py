"""Who may ask: everything below /api/ needs the token; the page itself does not."""

from __future__ import annotations

import stat
import subprocess
import sys

import pytest
from tests.server.captures import AUTH, TOKEN, put, sha256

from vioapr.errors import FormatError, MissingExtraError, ParameterError
from vioapr.server.addresses import address_of, is_loopback, qr_code
from vioapr.server.layout import ServedFolder
from vioapr.server.running import choose_host, serve
from vioapr.server.tokens import keep_token


def private_addresses():
    from vioapr.server.app import Api
    from vioapr.server.limits import Limits

    def of(served):
        api = Api(served, Limits())
        return [(m, r.path) for r in api.routes() for m in r.methods if r.path != "/api"]

    return of


@pytest.mark.parametrize(
    "given", [None, "", "Bearer", "Bearer wrong", f"Bearer {TOKEN}x", f"bearer {TOKEN}", TOKEN]
)
def test_no_address_answers_without_the_token(client, served, given):
    headers = {} if given is None else {"authorization": given}
    addresses = private_addresses()(served)
    assert len(addresses) > 25
    for method, path in addresses:
        path = path.replace("{name:path}", "x").replace("{id}", "court")
        path = path.replace("{recording}", "noon")
        answer = client.request(method, path, headers=headers)
        assert answer.status_code == 401, (method, path)
        assert answer.headers["www-authenticate"] == "Bearer"


def test_two_headers_are_no_token(client):
    pair = [("authorization", "Bearer wrong"), ("authorization", f"Bearer {TOKEN}")]
    assert client.get("/api/scenes", headers=pair).status_code == 401


def test_a_refused_body_is_not_kept(client, served):
    headers = {"x-sha256": sha256(b"x")}
    answer = client.put("/api/captures/w/files/images/0.jpg", content=b"x", headers=headers)
    assert answer.status_code == 401
    assert list(served.captures.iterdir()) == []


def test_the_page_and_the_name_of_the_server_are_public(client):
    assert client.get("/api").json()["format"] == "vioapr server"
    page = client.get("/")
    assert "vioapr" in page.text
    assert page.headers["cross-origin-opener-policy"] == "same-origin"
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]
    assert client.get("/status.js").status_code == 200
    for path in ("/../app.py", "/%2e%2e/app.py", "/..%2fapp.py", "/.vioapr-server/token"):
        assert client.get(path).status_code == 404


def test_the_certificate_is_public_where_there_is_one(client, open_client):
    assert client.get("/vioapr-ca.crt").status_code == 404
    answer = open_client(ca_pem=b"PEM").get("/vioapr-ca.crt")
    assert (answer.content, answer.headers["content-type"]) == (
        b"PEM",
        "application/x-x509-ca-cert",
    )


def test_the_token_is_kept_for_its_owner_alone(tmp_path):
    path = tmp_path / "state" / "token"
    first = keep_token(path, None)
    assert len(first) >= 32
    assert keep_token(path, None) == first
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert keep_token(path, "abcdefgh-abcdefgh") == "abcdefgh-abcdefgh"
    assert keep_token(path, None) == "abcdefgh-abcdefgh"
    for bad in ("short", "with a space in it", "ünicode-ünicode-ünicode"):
        with pytest.raises(ParameterError, match="at least 16"):
            keep_token(path, bad)
    path.write_text("x")
    with pytest.raises(FormatError, match="remove the file"):
        keep_token(path, None)


def test_others_are_let_in_only_with_https_or_when_asked_for():
    assert choose_host(None, https=False, plain_http=False) == "127.0.0.1"
    assert choose_host("localhost", https=False, plain_http=False) == "localhost"
    assert choose_host(None, https=True, plain_http=False) == "0.0.0.0"
    assert choose_host("192.168.1.5", https=False, plain_http=True) == "192.168.1.5"
    for host in ("0.0.0.0", "::", "192.168.1.5", "laptop.local"):
        with pytest.raises(ParameterError, match="`https`"):
            choose_host(host, https=False, plain_http=False)


def test_addresses():
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    assert (
        address_of("192.168.1.5", 8000, "t", is_https=True) == "https://192.168.1.5:8000/#token=t"
    )
    assert address_of("::1", 80, "t", is_https=False) == "http://[::1]:80/#token=t"
    pytest.importorskip("segno", reason="the extra web is not installed")
    lines = qr_code("https://192.168.1.5:8000/#token=t").splitlines()
    assert len({len(line) for line in lines}) == 1
    assert len(lines) > 10


def test_a_scene_itself_is_not_served(served):
    with pytest.raises(FormatError, match="around it"):
        ServedFolder.open(served.folder / "court")


def test_unknown_addresses_and_methods(client):
    assert client.get("/api/nothing", headers=AUTH).status_code == 404
    assert client.post("/api/jobs", headers=AUTH).status_code == 405
    assert put(client, "walk", "", b"x").status_code in (400, 404, 405)


def test_without_the_extra_the_verb_says_what_is_missing(tmp_path, monkeypatch):
    for name in ("starlette", "uvicorn"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'vioapr\[web\]'"):
        serve(tmp_path, on_start=lambda running: None)


def test_the_verbs_help_needs_no_extra():
    hide = "import sys; sys.modules['starlette'] = sys.modules['uvicorn'] = None; "
    code = f"{hide}from vioapr.cli import main; sys.exit(main(['serve', '--help']))"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert "--plain-http" in ran.stdout
