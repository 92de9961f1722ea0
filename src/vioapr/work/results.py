"""Folders of results, which the user may have put files of their own into.

A note says which files vioapr wrote, and their digests: only those, unchanged, are replaced. New
ones are made beside them and moved in when all are whole.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from vioapr.errors import AlreadyExistsError, FileError, UnwritableError
from vioapr.files.atomic import (
    leftovers_beside,
    partial_beside,
    sync,
    sync_folder,
    write_atomically,
)
from vioapr.schemas.base import decode, encode
from vioapr.schemas.written import WrittenFile, WrittenFiles
from vioapr.work.locks import locked_folder

WRITTEN_FILE = ".written.json"


class ResultFolder:
    """A folder that results are written into.

    Attributes:
        folder: Where it is, or will be.
        overwrite: Whether files that vioapr did not write may be replaced too.
    """

    def __init__(self, folder: Path, *, overwrite: bool = False) -> None:
        """Look at a folder; nothing is made yet."""
        self.folder, self.overwrite = folder, overwrite

    def check(self, patterns: Iterable[str]) -> None:
        """See that nothing of the user's would be replaced: to be called before the work.

        Args:
            patterns: Of the results' paths in the folder, e.g. "figures/*.png".

        Raises:
            AlreadyExistsError: A file is there that vioapr did not write, or was changed since;
                or the folder is a file.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise AlreadyExistsError(
                self.folder, "cannot be written to: expected a folder, found a file"
            )
        files = self._read_note()
        for pattern in patterns:
            for path in sorted(self.folder.glob(pattern)):
                self._check_own(path, files)

    def made_from(self, name: str) -> str | None:
        """What a result was made from: its fingerprint, or None if it is not there as written."""
        path = self.folder / name
        files = self._read_note()
        is_own = path.is_file() and self._is_own(path, files)
        return files[name].made_from if is_own else None

    @contextmanager
    def adding(self, made_from: Mapping[str, str] | None = None) -> Iterator[Path]:
        """Give an empty folder to write results to, which are then moved into this one.

        If the block raises, nothing is moved. What killed processes left is removed.

        Args:
            made_from: Fingerprints of what results are made from, by their paths.

        Yields:
            A folder within this one; this one is made if needed.

        Raises:
            AlreadyExistsError: A file of the user's is in the way.
            LockedError: Another process writes results here.
            UnwritableError: Something cannot be written; what was there stays.
        """
        with locked_folder(self.folder):
            try:
                for leftover in leftovers_beside(self.folder / "results"):
                    shutil.rmtree(leftover, ignore_errors=True)
                partial = partial_beside(self.folder / "results")
                partial.mkdir()
            except OSError as error:
                raise UnwritableError.of(self.folder, error) from None
            try:
                yield partial
                self._move_in(partial, made_from or {})
            except OSError as error:
                raise UnwritableError.of(self.folder, error) from None
            finally:
                shutil.rmtree(partial, ignore_errors=True)

    def add_note(self, names: Iterable[str]) -> None:
        """Note that results are vioapr's that were written into the folder directly.

        Raises:
            UnwritableError: The note cannot be written.
        """
        files = self._read_note()
        for name in names:
            files[name] = WrittenFile(sha256=(_digest(self.folder / name),))
        self._write_note(files)

    def _move_in(self, partial: Path, made_from: Mapping[str, str]) -> None:
        """Move finished files in; the note says first that they are vioapr's, old and new."""
        files = self._read_note()
        paths = sorted(path for path in partial.rglob("*") if path.is_file())
        for path in paths:
            name = path.relative_to(partial).as_posix()
            target = self.folder / name
            if target.exists():
                self._check_own(target, files, new=path)
            earlier = files[name].sha256[-1:] if name in files else ()
            files[name] = WrittenFile(
                sha256=(*earlier, _digest(path)), made_from=made_from.get(name, "")
            )
        sync_folder(partial)
        self._write_note(files)
        for path in paths:
            target = self.folder / path.relative_to(partial)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
        for folder in {(self.folder / path.relative_to(partial)).parent for path in paths}:
            sync(folder)

    def _check_own(
        self, path: Path, files: Mapping[str, WrittenFile], new: Path | None = None
    ) -> None:
        """See that a file may be replaced: vioapr's, or the same as the new one."""
        if path.is_dir():
            if new is not None:
                raise AlreadyExistsError(path, "expected to write a file, found a folder")
            return
        if self.overwrite or self._is_own(path, files):
            return
        if new is not None and _digest(new) == _digest(path):
            return
        raise AlreadyExistsError(
            path,
            "exists, and vioapr did not write it, or it was changed since: choose another folder, "
            "or give `overwrite`",
        )

    def _is_own(self, path: Path, files: Mapping[str, WrittenFile]) -> bool:
        noted = files.get(path.relative_to(self.folder).as_posix())
        return noted is not None and _digest(path) in noted.sha256

    def _read_note(self) -> dict[str, WrittenFile]:
        """What the note says; a note that is missing or broken says nothing."""
        path = self.folder / WRITTEN_FILE
        try:
            return dict(decode(path, path.read_text(encoding="utf-8"), WrittenFiles).files)
        except (OSError, ValueError, FileError):
            return {}

    def _write_note(self, files: dict[str, WrittenFile]) -> None:
        content = encode(WrittenFiles(files=files), indent=1).encode()
        write_atomically(self.folder / WRITTEN_FILE, content)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
