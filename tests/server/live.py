"""A server in a process of its own, and clients in threads that speak HTTP to it."""

from __future__ import annotations

import http.client
import json
import re
import signal
import ssl
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from tests.server.captures import AUTH, TOKEN, sha256


class LiveServer:
    """`vioapr serve` for a folder, at a port that was free."""

    def __init__(self, folder: Path, *flags: str) -> None:
        words = [sys.executable, "-m", "vioapr", "serve", str(folder), "--port", "0"]
        self.process = subprocess.Popen(
            [*words, "--token", TOKEN, *flags], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        self.said = ""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line
            if found := re.search(r"(https?)://(?:127\.0\.0\.1|localhost):(\d+)/#token=", line):
                self.port = int(found[2])
            if "Ctrl-C ends it" in line:
                return
        _, error = self.process.communicate()
        raise AssertionError(error)

    def stop(self, number: int = signal.SIGINT) -> int:
        self.process.send_signal(number)
        self.process.wait(timeout=20)
        assert self.process.stderr.read() == ""
        return self.process.returncode

    def rss_bytes(self) -> int:
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+) kB", text)[1]) * 1024

    def connect(self, context: ssl.SSLContext | None = None) -> http.client.HTTPConnection:
        if context is not None:
            return http.client.HTTPSConnection("127.0.0.1", self.port, context=context, timeout=30)
        return http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)

    def put(self, id_: str, name: str, content: bytes) -> int:
        """The answer's status; the connection's errors pass."""
        connection = self.connect()
        try:
            headers = {"x-sha256": sha256(content), **AUTH}
            connection.request("PUT", f"/api/captures/{id_}/files/{name}", content, headers)
            return connection.getresponse().status
        finally:
            connection.close()

    def ask(self, method: str, path: str, body: object = None) -> tuple[int, object]:
        connection = self.connect()
        try:
            content = None if body is None else json.dumps(body)
            connection.request(method, path, content, AUTH)
            answer = connection.getresponse()
            text = answer.read()
            return answer.status, json.loads(text) if text else None
        finally:
            connection.close()


@contextmanager
def live(folder: Path, *flags: str):
    server = LiveServer(folder, *flags)
    try:
        yield server
    finally:
        server.process.kill()
        server.process.wait()
        for stream in (server.process.stdout, server.process.stderr):
            stream.close()


def files_below(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def free_of_parts(folder: Path) -> bool:
    return not list((folder / ".vioapr-server" / "parts").iterdir())
