"""Folders of results, which the user may have put files of their own into.

A note says which files vioapr wrote, and their digests: only those, unchanged, are replaced. New
ones are made beside them and moved in when all are whole.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath

from vioapr.errors import AlreadyExistsError, FileError, UnwritableError
from vioapr.files.atomic import (
    came_meanwhile,
    folder_beside,
    replacing,
    sync,
    sync_folder,
    write_atomically,
)
from vioapr.files.digests import digest_of
from vioapr.files.outputs import is_stream
from vioapr.schemas.base import decode, encode
from vioapr.schemas.written import WrittenFile, WrittenFiles
from vioapr.work.locks import LOCK_FILE, locked_folder

WRITTEN_FILE = ".written.json"


class ResultFolder:
    """A folder that results are written into.

    Attributes:
        folder: Where it is, or will be.
        overwrite: Whether files that vioapr did not write may be replaced too.
        note: The file that says which files vioapr wrote.
    """

    def __init__(
        self, folder: Path, *, overwrite: bool = False, is_noted_beside: bool = False
    ) -> None:
        """Look at a folder; nothing is made yet.

        Args:
            folder: Where it is, or will be.
            overwrite: Whether files that vioapr did not write may be replaced too.
            is_noted_beside: Whether the note is beside it, as other programs read all that is in
                it.
        """
        self.folder, self.overwrite = folder, overwrite
        beside = folder.with_name(f".{folder.name}{WRITTEN_FILE}")
        self.note = beside if is_noted_beside else folder / WRITTEN_FILE

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
    def adding(
        self, made_from: Mapping[str, str] | None = None, *, all_of: Iterable[str] = ()
    ) -> Iterator[Path]:
        """Give an empty folder to write results to, which are then moved into this one.

        If the block raises, nothing is moved. What killed processes left is removed.

        Args:
            made_from: Fingerprints of what results are made from, by their paths.
            all_of: Patterns of the results that these are all of: those that vioapr wrote before,
                and that are no more, are removed.

        Yields:
            A folder within this one; this one is made if needed.

        Raises:
            AlreadyExistsError: A file of the user's is in the way.
            LockedError: Another process writes results here.
            UnwritableError: Something cannot be written; what was there stays.
        """
        with locked_folder(self.folder):
            try:
                with folder_beside(self.folder / "results") as partial:
                    yield partial
                    self._move_in(partial, made_from or {}, all_of)
            except OSError as error:
                raise UnwritableError.of(self.folder, error) from None

    def replace_all(self, partial: Path, patterns: Iterable[str]) -> None:
        """Put results in the place of all that the folder had of their kind.

        Args:
            partial: The folder of the results, on the same disk; it is emptied.
            patterns: Of files that count as results, whoever wrote them.

        Raises:
            AlreadyExistsError: The folder has something in it, without `overwrite`; or it has a
                result that vioapr did not write and these do not replace. Nothing was moved then.
            LockedError: Another process writes results here.
            UnwritableError: Something cannot be written.
        """
        patterns = tuple(patterns)
        try:
            with locked_folder(self.folder):
                if not self.overwrite and any(
                    path.name != LOCK_FILE for path in self.folder.iterdir()
                ):
                    raise came_meanwhile(self.folder)
                self._refuse_strangers(partial, patterns)
                self._move_in(partial, {}, patterns)
        except OSError as error:
            raise UnwritableError.of(self.folder, error) from None

    def find_others(self) -> list[Path]:
        """The files in the folder that vioapr did not write, or that were changed since."""
        files = self._read_note()
        return [path for path in self._find(["**/*"]) if not self._is_own(path, files)]

    def add_note(self, names: Iterable[str]) -> None:
        """Note that results are vioapr's that were written into the folder directly.

        Raises:
            UnwritableError: The note cannot be written.
        """
        files = self._read_note()
        for name in names:
            files[name] = WrittenFile(sha256=(digest_of(self.folder / name),))
        self._write_note(files)

    def _move_in(self, partial: Path, made_from: Mapping[str, str], all_of: Iterable[str]) -> None:
        """Move finished files in; the note says first that they are vioapr's, old and new."""
        files = self._read_note()
        paths = _files_in(partial)
        for path in paths:
            name = path.relative_to(partial).as_posix()
            target = self.folder / name
            if target.exists():
                self._check_own(target, files, new=path)
            earlier = files[name].sha256[-1:] if name in files else ()
            files[name] = WrittenFile(
                sha256=(*earlier, digest_of(path)), made_from=made_from.get(name, "")
            )
        sync_folder(partial)
        self._write_note(files)
        for path in paths:
            target = self.folder / path.relative_to(partial)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
        for folder in {(self.folder / path.relative_to(partial)).parent for path in paths}:
            sync(folder)
        written = {path.relative_to(partial).as_posix() for path in paths}
        removed = self._remove_earlier(written, files, all_of)
        if removed:
            self._write_note({name: file for name, file in files.items() if name not in removed})

    def _remove_earlier(
        self, written: Set[str], files: Mapping[str, WrittenFile], patterns: Iterable[str]
    ) -> set[str]:
        """Remove what vioapr wrote before of some patterns, but for what it has just written."""
        removed: set[str] = set()
        for path in self._find(patterns):
            name = path.relative_to(self.folder).as_posix()
            if name not in written and self._is_own(path, files):
                path.unlink()
                removed.add(name)
        for folder in {path for name in removed for path in PurePosixPath(name).parents[:-1]}:
            with suppress(OSError):  # something else is in it
                (self.folder / folder).rmdir()
        return removed

    def _refuse_strangers(self, partial: Path, patterns: Iterable[str]) -> None:
        """See that no file would look like one of the results that is none."""
        files = self._read_note()
        written = {path.relative_to(partial) for path in _files_in(partial)}
        strangers = [
            path
            for path in self._find(patterns)
            if path.relative_to(self.folder) not in written and not self._is_own(path, files)
        ]
        if strangers:
            more = f", as {len(strangers) - 1} more are" if len(strangers) > 1 else ""
            raise AlreadyExistsError(
                strangers[0],
                f"would be read as a part of the result{more}, and vioapr did not write it, or it "
                "was changed since: choose another folder, or move it away",
            )

    def _find(self, patterns: Iterable[str]) -> list[Path]:
        """The files of some patterns, but for what is being written, whose names begin with "."."""
        found = {path for pattern in patterns for path in self.folder.glob(pattern)}
        return sorted(
            path
            for path in found
            if path.is_file()
            and not any(part.startswith(".") for part in path.relative_to(self.folder).parts)
        )

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
        if new is not None and digest_of(new) == digest_of(path):
            return
        raise AlreadyExistsError(
            path,
            "exists, and vioapr did not write it, or it was changed since: choose another folder, "
            "or give `overwrite`",
        )

    def _is_own(self, path: Path, files: Mapping[str, WrittenFile]) -> bool:
        noted = files.get(path.relative_to(self.folder).as_posix())
        return noted is not None and digest_of(path) in noted.sha256

    def _read_note(self) -> dict[str, WrittenFile]:
        """What the note says; a note that is missing or broken says nothing."""
        try:
            text = self.note.read_text(encoding="utf-8")
            return dict(decode(self.note, text, WrittenFiles).files)
        except (OSError, ValueError, FileError):
            return {}

    def _write_note(self, files: dict[str, WrittenFile]) -> None:
        content = encode(WrittenFiles(files=files), indent=1).encode()
        write_atomically(self.note, content)


@contextmanager
def replacing_output(
    path: Path, *, overwrite: bool, patterns: Iterable[str] = ()
) -> Iterator[Path]:
    """Give a temporary path of the same name, for writers of a file or of a whole folder.

    What was written takes its place when it has reached the disk: a file as by `replacing`, a new
    folder in one step, into a folder that exists file by file. Of a folder, a note beside
    it says which files vioapr wrote: those are replaced as a whole, and others stay.

    Args:
        path: The file or folder; folders above it are made as needed. A stream is given as it is.
        overwrite: Whether to replace what is there when the new one is whole.
        patterns: Of the files in a folder that its readers take.

    Yields:
        A path in a temporary folder beside it; a folder is there if `path` is one.

    Raises:
        AlreadyExistsError: It exists, without `overwrite`; or see `ResultFolder.replace_all`.
        UnwritableError: It cannot be written; what was there stays.
    """
    if is_stream(path):
        yield path
        return
    target = Path(os.path.realpath(path))
    try:
        with folder_beside(target) as around:
            partial = around / target.name
            if target.is_dir():
                partial.mkdir()
            try:
                yield partial
            except FileError as error:  # of a file that the user does not know
                place = error.path.replace(str(partial), str(path))
                raise type(error)(place, error.problem, error.line) from None
            if partial.is_dir():
                _put_folder(partial, target, overwrite, patterns)
            else:
                with replacing(path, overwrite=overwrite) as place:
                    partial.replace(place)
    except OSError as error:
        raise UnwritableError.of(path, error) from None


def _put_folder(partial: Path, target: Path, overwrite: bool, patterns: Iterable[str]) -> None:
    """Put a finished folder in its place, or its files into the folder that is there."""
    results = ResultFolder(target, overwrite=overwrite, is_noted_beside=True)
    if not target.is_dir():
        made = ResultFolder(partial, is_noted_beside=True)
        made.add_note(path.relative_to(partial).as_posix() for path in _files_in(partial))
        sync_folder(partial)
        try:
            partial.rename(target)
            made.note.replace(results.note)
            sync(target.parent)
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
    results.replace_all(partial, patterns)


def _files_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())
