"""What kills and floods do to captures: a real server, and a client that retries.

    python benchmarks/server_faults.py [--kills 20] [--frames 80] [--seed 0] [--update-docs]

Every trial serves a new folder. A client puts a capture from four threads, as the page will: it
asks what is there, puts what is missing, and begins again when the connection breaks. The server is
killed with SIGKILL at a random moment and started again. Afterwards every file that was
acknowledged before the kill must be there with its content, the capture must become a recording
that is equal to it, and nothing may lie outside of the served folder.
"""

from __future__ import annotations

import argparse
import hashlib
import http.client
import io
import json
import random
import re
import ssl
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from common import publish
from PIL import Image
from rich.table import Table

from vioapr.importers.capture_logs import FRAMES_HEADER
from vioapr.scene.check import check_scene
from vioapr.scene.scene import Scene

PAGE = "server.md"
TOKEN = "a-token-for-the-benchmark"
HEADERS = {"authorization": f"Bearer {TOKEN}"}
ROWS_A_SEGMENT = 25


class Server:
    """`vioapr serve`, which can be killed and started again at the same port."""

    def __init__(self, folder: Path, *flags: str) -> None:
        """Start it, and wait until it takes requests."""
        self.folder, self.flags, self.port = folder, flags, 0
        self.start()

    def start(self) -> None:
        """Start it again."""
        words = [sys.executable, "-m", "vioapr", "serve", str(self.folder), "--token", TOKEN]
        self.process = subprocess.Popen(
            [*words, "--port", str(self.port), *self.flags],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if found := re.search(r":(\d+)/#token=", line):
                self.port = int(found[1])
            if "Ctrl-C ends it" in line:
                return
        raise RuntimeError("the server did not start")

    def kill(self) -> None:
        """SIGKILL."""
        self.process.kill()
        self.process.communicate()

    def rss_mb(self) -> float:
        """Its memory."""
        text = Path(f"/proc/{self.process.pid}/status").read_text(encoding="ascii")
        found = re.search(r"VmRSS:\s+(\d+)", text)
        assert found is not None
        return int(found[1]) / 1e3


@dataclass
class Client:
    """A client that does not give up.

    Attributes:
        server: That it speaks to.
        context: Of TLS, or None.
        acknowledged: Names of files that the server has taken, as far as the client knows.
        retries: How often a connection broke.
    """

    server: Server
    context: ssl.SSLContext | None = None
    acknowledged: set[str] = field(default_factory=set)
    retries: int = 0

    def ask(self, method: str, path: str, body: bytes | None = None, **more: str) -> object:
        """Ask until there is an answer; its JSON."""
        while True:
            try:
                status, content = self.once(method, path, body, **more)
                if status < 500:
                    break
            except (OSError, http.client.HTTPException):
                pass
            self.retries += 1
            time.sleep(0.05)
        if status >= 400:
            raise RuntimeError(f"{method} {path}: {status} {content[:200]!r}")
        return json.loads(content) if content else None

    def once(
        self, method: str, path: str, body: bytes | None = None, **more: str
    ) -> tuple[int, bytes]:
        """Ask once."""
        host, port = "127.0.0.1", self.server.port
        connection = (
            http.client.HTTPConnection(host, port, timeout=10)
            if self.context is None
            else http.client.HTTPSConnection(host, port, timeout=10, context=self.context)
        )
        try:
            connection.request(method, path, body, {**HEADERS, **more})
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def put(self, name: str, content: bytes) -> None:
        """Put a file of the capture."""
        hashed = {"x-sha256": hashlib.sha256(content).hexdigest()}
        self.ask("PUT", f"/api/captures/walk/files/{name}", content, **hashed)
        self.acknowledged.add(name)

    def deliver(self, files: Mapping[str, bytes]) -> str:
        """Put all that is missing, and complete the capture; the job's id."""
        state = self.ask("GET", "/api/captures/walk")
        assert isinstance(state, dict)
        with ThreadPoolExecutor(4) as pool:
            missing = [name for name in files if name not in state["files"]]
            list(pool.map(lambda name: self.put(name, files[name]), missing))
        hashes = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
        wanted = {"files": hashes, "scene": "court", "recording": "noon"}
        path = "/api/captures/walk/complete"
        job = self.ask("POST", path, json.dumps(wanted).encode())
        assert isinstance(job, dict)
        return str(job["id"])

    def wait(self, job: str) -> str:
        """Wait for a job's end; its state."""
        while True:
            found = self.ask("GET", f"/api/jobs/{job}")
            assert isinstance(found, dict)
            if found["job"]["state"] not in ("queued", "running"):
                return str(found["job"]["state"])
            time.sleep(0.1)


def make_capture(frames: int, rng: np.random.Generator) -> dict[str, bytes]:
    """A walk along a line with pictures of some 90 kB."""
    files = {"capture.json": b'{"format": "vioapr capture", "version": 1}'}
    rows: list[str] = []
    for k in range(frames):
        pixels = rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, format="jpeg", quality=95)
        files[f"images/{k:06d}.jpg"] = buffer.getvalue()
        pose = f"{0.05 * k},1.5,0.0,0.0,0.0,0.0,1.0"
        rows.append(f"{0.25 * k},{k:06d}.jpg,normal,{pose},320,240,300,300,160,120,0")
    for number, start in enumerate(range(0, frames, ROWS_A_SEGMENT)):
        text = "\n".join([FRAMES_HEADER, *rows[start : start + ROWS_A_SEGMENT]]) + "\n"
        files[f"frames-{number:05d}.csv"] = text.encode()
    return files


def kill_once(files: Mapping[str, bytes], delay_s: float, *, is_late: bool) -> tuple[int, int, int]:
    """Kill a server while it receives, or, if late, after the capture is complete.

    Returns:
        Files that were acknowledged before the kill, those of them that were lost, and 1 if the
        recording is equal to the capture in the end.
    """
    with tempfile.TemporaryDirectory() as around:
        folder = Path(around) / "places"
        Scene.create(folder / "court", "Courtyard", is_outdoor=True)
        server = Server(folder)
        client = Client(server)
        before: set[str] = set()
        lost: list[str] = []

        def strike() -> None:
            time.sleep(delay_s)
            before.update(client.acknowledged)
            server.kill()
            for name in before:
                path = folder / ".vioapr-server" / "captures" / "walk" / name
                if not path.exists() or path.read_bytes() != files[name]:
                    lost.append(name)
            server.start()

        killer = threading.Thread(target=strike)
        try:
            if is_late:
                job = client.deliver(files)
                killer.start()
            else:
                killer.start()
                job = client.deliver(files)
            killer.join()
            is_done = client.wait(job) == "done"
        finally:
            killer.join()
            server.kill()
        outside = [path.name for path in Path(around).iterdir() if path.name != "places"]
        left = list((folder / ".vioapr-server" / "parts").iterdir())
        is_equal = is_done and not outside and not left and is_same(folder / "court", files)
        return len(before), len(lost), int(is_equal)


def is_same(scene_folder: Path, files: Mapping[str, bytes]) -> bool:
    """Whether a scene's recording is the capture."""
    if check_scene(scene_folder).errors:
        return False
    recording = Scene.open(scene_folder).recording("noon")
    names = [name for name in files if name.startswith("images/")]
    found = {f"images/{name}": k for k, name in enumerate(recording.frames.image)}
    return sorted(found) == sorted(names) and all(
        recording.image_path(k).read_bytes() == files[name] for name, k in found.items()
    )


def kill_table(kills: int, files: Mapping[str, bytes], rng: random.Random) -> Table:
    """Kill servers amid uploads, and after them."""
    seconds = time_upload(files)
    table = Table("kill -9", "kills", "acknowledged before", "of these lost", "recording equal")
    for title, longest_s, is_late in (
        ("amid uploads", seconds, False),
        ("after completing", 2.5, True),
    ):
        trials = [
            kill_once(files, rng.uniform(0.0, longest_s), is_late=is_late) for _ in range(kills)
        ]
        acknowledged, lost, equal = (sum(column) for column in zip(*trials, strict=True))
        table.add_row(title, str(kills), str(acknowledged), str(lost), f"{equal} of {kills}")
    return table


def with_server(
    work: Callable[[Server, Client], float], *flags: str, ca: Path | None = None
) -> float:
    """Do something with a server of a new folder."""
    with tempfile.TemporaryDirectory() as around:
        folder = Path(around) / "places"
        Scene.create(folder / "court", "Courtyard", is_outdoor=True)
        server = Server(folder, *flags)
        try:
            context = None if ca is None else ssl.create_default_context(cafile=ca)
            return work(server, Client(server, context))
        finally:
            server.kill()


def time_upload(files: Mapping[str, bytes]) -> float:
    """Seconds that a capture takes, from four threads."""

    def work(server: Server, client: Client) -> float:
        began = time.monotonic()
        client.deliver(files)
        return time.monotonic() - began

    return with_server(work)


def time_picture_ms(files: Mapping[str, bytes], *flags: str, ca: Path | None = None) -> float:
    """Median milliseconds a picture, one after the other, each over a new connection."""

    def work(server: Server, client: Client) -> float:
        took: list[float] = []
        for name, content in files.items():
            began = time.perf_counter()
            client.put(name, content)
            took.append(time.perf_counter() - began)
        return 1e3 * statistics.median(took)

    return with_server(work, *flags, ca=ca)


def flood_mb(floods: int, uploads: int, size: int) -> float:
    """By how many MB a server grows while it receives many files at once, several times."""

    def work(server: Server, client: Client) -> float:
        client.put("images/first.jpg", bytes(size))
        before = server.rss_mb()
        for flood in range(floods):
            names = [f"images/{flood}-{k}.jpg" for k in range(uploads)]
            with ThreadPoolExecutor(uploads) as pool:
                list(pool.map(lambda name: client.put(name, name.encode() * (size // 16)), names))
        return server.rss_mb() - before

    return with_server(work)


def main() -> None:
    """Inject the faults and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=80)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--update-docs", action="store_true")
    chosen = parser.parse_args()
    files = make_capture(chosen.frames, np.random.default_rng(chosen.seed))
    kills = kill_table(chosen.kills, files, random.Random(chosen.seed))
    publish(kills, PAGE, "kills", update_docs=chosen.update_docs)
    pictures = {name: content for name, content in files.items() if name.startswith("images/")}
    size_kb = statistics.median(len(content) for content in pictures.values()) / 1e3
    table = Table("what", "figure")
    plain_ms = time_picture_ms(pictures)
    table.add_row(f"a picture of {size_kb:.0f} kB over HTTP, on the disk", f"{plain_ms:.1f} ms")
    with tempfile.TemporaryDirectory() as tls:
        flags = ("--https", "--host", "127.0.0.1", "--tls", tls)
        with_server(lambda server, client: 0.0, *flags)  # makes the authority
        over_tls_ms = time_picture_ms(pictures, *flags, ca=Path(tls) / "ca.crt.pem")
    table.add_row("the same over HTTPS, with a new connection each", f"{over_tls_ms:.1f} ms")
    for floods in (1, 4):
        grown_mb = flood_mb(floods, 100, 4 << 20)
        often = "once" if floods == 1 else f"{floods} times"
        title = f"memory for 100 uploads of 4 MB side by side, {often}"
        table.add_row(title, f"{grown_mb:+.0f} MB")
    publish(table, PAGE, "cost", update_docs=chosen.update_docs)


if __name__ == "__main__":
    main()
