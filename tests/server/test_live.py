"""The server as it runs: killed amid uploads, flooded, starved, and over TLS."""

from __future__ import annotations

import random
import signal
import socket
import ssl
import stat
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from tests.server.captures import AUTH, TOKEN, make_capture, sha256

pytest.importorskip("uvicorn", reason="the extra web is not installed")
pytest.importorskip("fcntl", reason="the server needs the locks of Linux and macOS")

from tests.server.live import files_below, free_of_parts, live

from vioapr.scene.check import check_scene
from vioapr.scene.scene import Scene

pytestmark = pytest.mark.slow


def wait_for_job(server, id_):
    end_s = time.monotonic() + 60
    while time.monotonic() < end_s:
        _, found = server.ask("GET", f"/api/jobs/{id_}")
        if found["job"]["state"] not in ("queued", "running"):
            return found["job"]
        time.sleep(0.1)
    raise AssertionError(found)


def upload(server, id_, files, acknowledged, after=None, called=lambda: None):
    """Put files from eight threads until the server is gone; call something on the way."""
    lock = threading.Lock()

    def one(item):
        name, content = item
        try:
            status = server.put(id_, name, content)
        except OSError:
            return
        assert status in (200, 201), (name, status)
        with lock:
            acknowledged.add(name)
            if len(acknowledged) == after:
                called()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(one, files.items()))


def test_a_server_that_is_killed_loses_no_acknowledged_file(served):
    capture = make_capture(count=40)
    noise = random.Random(3)
    for k in range(20):  # large enough to be killed within
        capture.files[f"images/noise-{k}.jpg"] = noise.randbytes(300_000)
    around = served.folder.parent
    before = files_below(around)
    acknowledged: set[str] = set()
    with live(served.folder) as server:
        upload(server, "walk", capture.files, acknowledged, 25, server.process.kill)
    assert 25 <= len(acknowledged) < len(capture.files)
    with live(served.folder) as server:
        assert free_of_parts(served.folder)
        kept = files_below(served.captures / "walk")
        for name in acknowledged:
            assert kept[name] == capture.files[name], name
        for name, content in kept.items():  # others may be there whole
            assert content == capture.files[name], name
        _, said = server.ask("GET", "/api/captures/walk")
        assert said["files"] == {name: len(content) for name, content in kept.items()}
        missing = {name: c for name, c in capture.files.items() if name not in said["files"]}
        upload(server, "walk", missing, acknowledged)
        wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
        status, job = server.ask("POST", "/api/captures/walk/complete", wanted)
        assert status == 200
        server.process.kill()  # the job is on the disk already, and may run
    with live(served.folder) as server:
        assert wait_for_job(server, job["id"])["state"] == "done"
        assert server.stop() == 0
    assert not check_scene(served.folder / "court").errors
    assert len(Scene.open(served.folder / "court").recording("noon").frames) == 40
    outside = {n: c for n, c in files_below(around).items() if not n.startswith("places/")}
    assert outside == {n: c for n, c in before.items() if not n.startswith("places/")}


def test_a_hundred_uploads_at_once_are_not_held_in_memory(served):
    size = 4 << 20
    with live(served.folder) as server:
        server.put("warm", "images/0.jpg", bytes(size))
        before = server.rss_bytes()
        start = threading.Barrier(100)

        def one(k):
            content = bytes([k]) * size
            start.wait()
            return server.put("walk", f"images/{k}.jpg", content)

        with ThreadPoolExecutor(100) as pool:
            statuses = list(pool.map(one, range(100)))
        grown = server.rss_bytes() - before
        _, said = server.ask("GET", "/api/captures/walk")
    assert statuses == [201] * 100
    assert set(said["files"].values()) == {size}
    assert len(said["files"]) == 100
    assert grown < 128 << 20, f"{grown / 1e6:.0f} MB for 400 MB"


def test_one_of_a_hundred_wins(served):
    with live(served.folder) as server, ThreadPoolExecutor(50) as pool:
        contents = [bytes([k]) * 1000 for k in range(100)]
        statuses = list(pool.map(lambda c: server.put("walk", "images/0.jpg", c), contents))
        assert statuses.count(201) == 1
        assert statuses.count(409) == 99
        winner = contents[statuses.index(201)]
        assert (served.captures / "walk" / "images" / "0.jpg").read_bytes() == winner
        assert free_of_parts(served.folder)


def test_a_capture_that_is_completed_many_times_at_once_is_one_recording(served):
    capture = make_capture()
    wanted = {"files": capture.hashes, "scene": "court", "recording": "noon"}
    with live(served.folder) as server, ThreadPoolExecutor(16) as pool:
        upload(server, "walk", capture.files, set())
        path = "/api/captures/walk/complete"
        answers = list(pool.map(lambda _: server.ask("POST", path, wanted), range(32)))
        assert {status for status, _ in answers} == {200}
        assert len({job["id"] for _, job in answers}) == 1
        assert wait_for_job(server, answers[0][1]["id"])["state"] == "done"
        assert len(server.ask("GET", "/api/jobs")[1]) == 1


def send(server, head, blocks=()):
    """Send a request as it is, and as much of a body as the server takes; its answer's head."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(head.replace("\n", "\r\n").encode() + b"\r\n")
        try:
            for block in blocks:
                connection.sendall(b"%x\r\n%s\r\n" % (len(block), block))
        except OSError:
            pass
        try:
            return connection.recv(4096).decode("latin-1")
        except OSError:
            return ""


def test_endless_bodies_and_odd_requests(served):
    head = "PUT /api/captures/{} HTTP/1.1\nHost: x\nX-Sha256: {}\n{}Transfer-Encoding: chunked\n"
    bearer = f"Authorization: Bearer {TOKEN}\n"
    around = served.folder.parent
    with live(served.folder) as server:
        before, files = server.rss_bytes(), set(files_below(around))
        endless = (bytes(1 << 20) for _ in range(200))
        name = "walk/files/images/0.jpg"
        answer = send(server, head.format(name, "0" * 64, bearer), endless)
        assert answer.startswith("HTTP/1.1 413") or answer == ""  # reset while we were sending
        sent = 0

        def counted():
            nonlocal sent
            for _ in range(200):
                sent += 1
                yield bytes(1 << 20)

        answer = send(server, head.format(name, "0" * 64, ""), counted())
        assert answer.startswith("HTTP/1.1 401") or answer == ""
        assert sent < 100  # nobody reads what has no token
        for path in ("../../x", "walk/files/../../../../x", "walk/files/images/../../../x",
                     "..%2f..%2f/files/x", "walk/files/%2e%2e/%2e%2e/x"):  # fmt: skip
            answer = send(server, head.format(path, sha256(b""), bearer) + "\n0\n", ())
            assert answer[9:12] in ("400", "404", "405", "422"), (path, answer)
        assert send(server, "GET " + "x" * 100_000 + " HTTP/1.1\n")[9:12] in ("400", "431")
        assert server.rss_bytes() - before < 48 << 20
        assert set(files_below(around)) == files
        assert server.ask("GET", "/api/scenes")[0] == 200


def test_a_client_that_goes_away_leaves_nothing(served):
    with live(served.folder) as server:
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            connection.sendall(
                f"PUT /api/captures/walk/files/images/0.jpg HTTP/1.1\r\nHost: x\r\n"
                f"Authorization: Bearer {TOKEN}\r\nX-Sha256: {sha256(b'x')}\r\n"
                f"Content-Length: 1000\r\n\r\nhalf".encode()
            )
            end_s = time.monotonic() + 10
            while free_of_parts(served.folder):
                assert time.monotonic() < end_s
                time.sleep(0.01)
        while not free_of_parts(served.folder):
            assert time.monotonic() < end_s
            time.sleep(0.01)
        assert server.ask("GET", "/api/captures")[1] == []
        assert server.stop(signal.SIGTERM) == 0


def test_https_by_an_authority_that_stays(served, tmp_path):
    tls = tmp_path / "tls"
    flags = ("--https", "--host", "127.0.0.1", "--tls", str(tls))
    for _ in range(2):
        with live(served.folder, *flags) as server:
            context = ssl.create_default_context(cafile=tls / "ca.crt.pem")
            connection = server.connect(context)
            connection.request("GET", "/vioapr-ca.crt")
            authority = connection.getresponse().read()
            certificate = connection.sock.getpeercert()
            connection.request("GET", "/api/scenes", headers=AUTH)
            assert connection.getresponse().status == 200
            connection.close()
            with pytest.raises(ssl.SSLError):
                server.connect(ssl.create_default_context()).request("GET", "/api")
        days = [
            (ssl.cert_time_to_seconds(certificate[key]) - time.time()) / 86400
            for key in ("notBefore", "notAfter")
        ]
        assert -2 < days[0] < 0
        assert 80 < days[1] < 100
        names = {name for _, name in certificate["subjectAltName"]}
        assert names == {"127.0.0.1", "localhost"}
    assert authority == (tls / "ca.crt.pem").read_bytes()
    for path in tls.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600, path
    assert {path.name for path in tls.iterdir()} == {"ca.crt.pem", "ca.key.pem"}


def test_a_folder_has_one_server(served):
    with live(served.folder) as server:
        words = [sys.executable, "-m", "vioapr", "serve", str(served.folder), "--port", "0"]
        ran = subprocess.run(words, capture_output=True, text=True)
        assert ran.returncode == 2
        assert f"in use by process {server.process.pid}" in ran.stderr
        other = served.folder.parent / "other"
        other.mkdir()
        words = [*words[:4], str(other), "--port", str(server.port)]
        ran = subprocess.run(words, capture_output=True, text=True)
        assert ran.returncode == 2
        assert "cannot be listened on" in ran.stderr
    assert list((other / ".vioapr-server").iterdir()) == []
