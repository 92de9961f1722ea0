"""Files that clients put one by one: every file is small, whole, and never changes again.

A file is written under another name, reaches the disk, is compared with the client's hash, and
is then linked to its name. So whatever is killed, and whenever: a file that was acknowledged is
there, and one that was not is not.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import secrets
import shutil
import threading
from collections.abc import Callable
from functools import partial as bound
from pathlib import Path

from anyio import to_thread
from starlette.requests import ClientDisconnect, Request

from vioapr.errors import AlreadyExistsError, FileMissingError
from vioapr.files.atomic import put_new, sync
from vioapr.files.digests import digest_of
from vioapr.files.text import read_text, write_text
from vioapr.scene.scene import check_id
from vioapr.schemas.base import decode, encode
from vioapr.schemas.server import TransferDocument, TransferState
from vioapr.server.limits import Limits
from vioapr.server.refusals import Refusal

COMPLETION_FILE = ".complete.json"
PART_SUFFIX = ".part"


class Transfers:
    """The transfers of one kind: a folder each, by id."""

    def __init__(
        self, folder: Path, parts: Path, is_allowed: Callable[[str], bool], limits: Limits
    ) -> None:
        """Take up what is there.

        Args:
            folder: Where they are; made if needed.
            parts: Where files are while they are received; on the same disk.
            is_allowed: Whether a name may be that of a file.
            limits: How much is taken.
        """
        self.folder, self._parts, self._is_allowed, self._limits = folder, parts, is_allowed, limits
        self._counts: dict[str, int] = {}
        self._change = threading.Lock()
        for made in (folder, parts):
            made.mkdir(parents=True, exist_ok=True)
            for above in (made.parent, made.parent.parent):
                sync(above)

    def ids(self) -> list[str]:
        """Ids of all transfers, in order."""
        return sorted(path.name for path in self.folder.iterdir() if path.is_dir())

    def place(self, id_: str) -> Path:
        """A transfer's folder, which need not exist.

        Raises:
            ParameterError: The id is none.
        """
        return self.folder / check_id(id_)

    def files(self, id_: str) -> dict[str, int]:
        """Bytes of all files that are there, by name."""
        folder = self.place(id_)
        return {
            path.relative_to(folder).as_posix(): path.stat().st_size
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name != COMPLETION_FILE
        }

    def state(self, id_: str) -> TransferState:
        """How far a transfer has come; of one that has not begun, no files."""
        done = self.completion(id_)
        files = self.files(id_)
        if done is None:
            return TransferState(id=id_, files=files)
        return TransferState(
            id=id_, files=files, is_complete=True, scene=done.scene,
            recording=done.recording, job=done.job,
        )  # fmt: skip

    def completion(self, id_: str) -> TransferDocument | None:
        """What was noted when a transfer was complete; None before."""
        path = self.place(id_) / COMPLETION_FILE
        return decode(path, read_text(path), TransferDocument) if path.exists() else None

    def find_missing(self, id_: str, hashes: dict[str, str]) -> list[str]:
        """Names of files that are not there, or have other content than they should.

        Raises:
            Refusal: A name can be that of no file.
        """
        folder = self.place(id_)
        for name in hashes:
            self._check_name(name)
        return [
            name
            for name, sha256 in sorted(hashes.items())
            if not (folder / name).is_file() or digest_of(folder / name) != sha256
        ]

    def complete(self, id_: str, document: TransferDocument) -> None:
        """Note that a transfer is complete; nothing can be added from then.

        Raises:
            Refusal: Files are there that its list lacks.
            UnwritableError: It cannot be noted.
        """
        with self._change:
            more = sorted(set(self.files(id_)) - set(document.files))
            if more:
                text = f"{len(more)} files are there that the list lacks, such as {more[0]}"
                raise Refusal(409, text)
            write_text(self.place(id_) / COMPLETION_FILE, encode(document))

    def remove(self, id_: str) -> None:
        """Remove a transfer with all its files; first by name, so that no half of it stays.

        Raises:
            FileMissingError: There is none of this id.
        """
        folder = self.place(id_)
        if not folder.is_dir():
            raise FileMissingError(id_, "expected a transfer, found none of this id")
        aside = self._parts / f"{secrets.token_hex(8)}{PART_SUFFIX}"
        folder.rename(aside)
        self._counts.pop(id_, None)
        shutil.rmtree(aside, ignore_errors=True)

    def empty(self, id_: str) -> None:
        """Remove the files of a complete transfer; that it was complete stays known."""
        for path in self.place(id_).iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != COMPLETION_FILE:
                path.unlink()

    async def put(self, request: Request, id_: str, name: str) -> int:
        """Receive a file.

        Args:
            request: Its body is the file, its header `X-Sha256` the hash.
            id_: The transfer's.
            name: The file's.

        Returns:
            201 if the file is new, 200 if the same was there already.

        Raises:
            Refusal: It is not taken; nothing of it is kept.
        """
        self._check_name(name)
        folder = self.place(id_)
        wanted = request.headers.get("x-sha256", "").lower()
        if len(wanted) != 64 or not set(wanted) <= set("0123456789abcdef"):
            raise Refusal(400, "expected a header X-Sha256 of 64 hexadecimal digits")
        if shutil.disk_usage(self._parts).free < self._limits.min_free_bytes:
            raise Refusal(507, "the server's disk is nearly full")
        part = self._parts / f"{secrets.token_hex(8)}{PART_SUFFIX}"
        try:
            with part.open("xb") as file:
                found = await receive_body(
                    request, file.write, self._limits.max_file_bytes, self._limits.idle_s
                )
                if found != wanted:
                    raise Refusal(422, f"expected content of SHA-256 {wanted}, got {found}")
                file.flush()
                await to_thread.run_sync(os.fsync, file.fileno())
            return await to_thread.run_sync(bound(self._keep, id_, folder / name, part, wanted))
        finally:
            part.unlink(missing_ok=True)

    def _keep(self, id_: str, target: Path, part: Path, sha256: str) -> int:
        """Give a received file its name, unless one has it."""
        with self._change:
            if not target.exists() and self.completion(id_) is not None:
                raise Refusal(409, f"{id_} is complete: no file can be added")
            count = self._counts.get(id_)
            count = len(self.files(id_)) if count is None else count
            if count >= self._limits.max_files:
                raise Refusal(413, f"expected at most {self._limits.max_files} files")
            _make_folders(target.parent, self.folder)
            try:
                put_new(part, target)
                self._counts[id_], status = count + 1, 201
            except AlreadyExistsError:
                # Nobody links here but on purpose, and then it is not the client's file.
                is_file = target.is_file() and not target.is_symlink()
                if not is_file or digest_of(target) != sha256:
                    raise Refusal(409, f"{target.name} is there with other content") from None
                status = 200
        sync(target.parent)  # also of a file that another request has just put
        return status

    def _check_name(self, name: str) -> None:
        if not self._is_allowed(name):
            raise Refusal(400, f"expected the name of a file that belongs here, got {name[:80]!r}")


def clean_parts(parts: Path) -> int:
    """Remove what a killed server left while it received; how many files that were."""
    leftovers = [*parts.glob(f"*{PART_SUFFIX}")] if parts.is_dir() else []
    for path in leftovers:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    return len(leftovers)


async def receive_body(
    request: Request, write: Callable[[bytes], object], most: int, idle_s: float
) -> str:
    """Receive a request's body block by block; its SHA-256.

    Raises:
        Refusal: It is too long, or nothing came for too long, or the client went away.
    """
    too_long = Refusal(413, f"expected at most {most} bytes")
    if int(request.headers.get("content-length", "0")) > most:
        raise too_long
    digest, size, stream = hashlib.sha256(), 0, request.stream()
    while True:
        try:
            block = await asyncio.wait_for(anext(stream), idle_s)
        except StopAsyncIteration:
            return digest.hexdigest()
        except TimeoutError:
            raise Refusal(408, f"nothing came for {idle_s:g} s") from None
        except ClientDisconnect:
            raise Refusal(400, "the client went away") from None
        size += len(block)
        if size > most:
            raise too_long
        digest.update(block)
        write(block)


def _make_folders(folder: Path, above: Path) -> None:
    """Make a folder and those between; their names reach the disk."""
    if folder == above or folder.is_dir():
        return
    _make_folders(folder.parent, above)
    folder.mkdir(exist_ok=True)
    sync(folder.parent)
