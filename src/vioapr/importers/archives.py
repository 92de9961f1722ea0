"""Sources that are packed: a zip, or a file in numbered pieces, unpacked for as long as it is read.

Phones hand over exports as zips, and large files travel in pieces (`export.zip.000`, `.001`, ...),
as 7-Zip makes them too. A zip comes from elsewhere: what its list says is checked before a byte is
written.
"""

from __future__ import annotations

import bisect
import io
import itertools
import os
import re
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from vioapr.errors import FileMissingError, FormatError, UnreadableError, UnwritableError
from vioapr.files.atomic import folder_beside
from vioapr.work.progress import Progress

_PIECE = re.compile(r"(.+)\.(\d{3,6})")
_DRIVE = re.compile(r"[A-Za-z]:")
_KEPT_PACKED = (".r3d",)
"""Zips that their importers read as they are."""

_LITTER = ("__MACOSX",)
_MAX_FILES = 1_000_000
_SPARE_BYTES = 256 << 20
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Opened:
    """A source, ready to be read.

    Attributes:
        path: The source itself, or what was unpacked.
        packed: The files that it was unpacked from; none if it is the source itself.
    """

    path: Path
    packed: tuple[Path, ...] = ()


@contextmanager
def opened_source(
    source: Path, out: Path, progress: Progress, is_known: Callable[[Path], bool]
) -> Iterator[Opened]:
    """Give a source as files: unpacked, if it is a zip or pieces of a file.

    Args:
        source: A file or folder; of pieces, any of them.
        out: What it is imported into; what is unpacked lies beside it, and is removed.
        progress: Opened for unpacking, with the number of files.
        is_known: Whether a folder is what an importer reads.

    Raises:
        FormatError: A zip is broken, encrypted, or names files outside of it; a piece is missing.
        UnwritableError: It cannot be unpacked.
    """
    pieces = find_pieces(source)
    name = source.name if not pieces else pieces[0].name.rpartition(".")[0]
    is_kept = name.lower().endswith(_KEPT_PACKED)
    if not pieces and (is_kept or not source.is_file() or not zipfile.is_zipfile(source)):
        yield Opened(source)
        return
    with ExitStack() as held:
        try:
            folder = held.enter_context(folder_beside(out.resolve()))
        except OSError as error:
            raise UnwritableError.of(out, error) from None
        files = pieces or [source]
        with io.BufferedReader(PiecesReader(files), _BLOCK) as content:
            try:
                if not is_kept and zipfile.is_zipfile(content):
                    unpack(content, folder / Path(name).stem, source, progress)
                    path = find_content(folder / Path(name).stem, is_known)
                else:
                    path = folder / name
                    content.seek(0)
                    with path.open("wb") as file:
                        shutil.copyfileobj(content, file, _BLOCK)
            except OSError as error:
                raise UnwritableError.of(folder, error) from None
        yield Opened(path, tuple(files))


def find_pieces(source: Path) -> list[Path]:
    """All pieces of a file, in order, of which one is given; none if it is no piece.

    Raises:
        FormatError: A piece is missing.
    """
    found = _PIECE.fullmatch(source.name)
    if found is None or source.is_dir():
        return []
    numbered = {
        int(match[2]): path
        for path in source.parent.iterdir()
        if (match := _PIECE.fullmatch(path.name)) and match[1] == found[1]
    }
    numbers = sorted(numbered)
    for number, following in itertools.pairwise([-1 if numbers[0] == 0 else 0, *numbers]):
        if following != number + 1:
            text = f"expected a piece {number + 1:03d} beside it, found {following:03d}"
            raise FormatError(numbered[following], text)
    return [numbered[number] for number in numbers]


def unpack(content: BinaryIO, target: Path, source: Path, progress: Progress) -> None:
    """Unpack a zip into a new folder.

    Args:
        content: The zip.
        target: The folder.
        source: The zip's file, for messages.
        progress: Opened with the number of files.

    Raises:
        FormatError: It is broken or encrypted, or names files outside of it, or unpacks to more
            than the disk has.
    """
    try:
        with zipfile.ZipFile(content) as archive:
            members = [one for one in archive.infolist() if not _is_left_out(one.filename)]
            _check_members(members, target.parent, source)
            with progress(f"unpacking {source.name}", len(members)) as tick:
                for member in members:
                    _unpack_one(archive, member, target)
                    tick(1)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError) as error:
        raise FormatError(source, f"expected a zip that can be unpacked: {error}") from None


def find_content(folder: Path, is_known: Callable[[Path], bool]) -> Path:
    """The folder that a zip's files are in: zips mostly hold one folder with all."""
    found = folder
    while not is_known(found):
        inside = list(found.iterdir())
        if len(inside) != 1 or not inside[0].is_dir():
            break
        found = inside[0]
    return found if is_known(found) else folder


def _is_left_out(name: str) -> bool:
    """Whether a member is a folder, or what systems add on their own."""
    parts = PurePosixPath(name).parts
    is_litter = not parts or parts[0] in _LITTER or parts[-1] == ".DS_Store"
    return name.endswith("/") or is_litter or parts[-1].startswith("._")


def _check_members(members: Sequence[zipfile.ZipInfo], folder: Path, source: Path) -> None:
    """See that a zip's list can be unpacked.

    Raises:
        FormatError: It cannot, or must not.
    """
    if not members:
        raise FormatError(source, "expected files in the zip, found none")
    if len(members) > _MAX_FILES:
        raise FormatError(source, f"expected at most {_MAX_FILES} files, found {len(members)}")
    for member in members:
        path = PurePosixPath(member.filename.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or _DRIVE.match(path.parts[0]):
            text = f"names a file outside of it, {member.filename[:80]!r}: not unpacked"
            raise FormatError(source, text)
        if member.flag_bits & 1:
            raise FormatError(source, "is encrypted: export it without a password")
    size, free = sum(one.file_size for one in members), shutil.disk_usage(folder).free
    if size > free - _SPARE_BYTES:
        text = f"unpacks to {size / 1e9:.1f} GB, and the disk has {free / 1e9:.1f} GB left"
        raise FormatError(source, text)


def _unpack_one(archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path) -> None:
    # Not `extract`, which makes links of members that say they are some.
    path = target / PurePosixPath(member.filename.replace("\\", "/"))
    path.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(member) as packed, path.open("wb") as file:
        shutil.copyfileobj(packed, file, _BLOCK)


class PiecesReader(io.RawIOBase):
    """Several files, read as one."""

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open the files.

        Raises:
            FileMissingError: One is not there.
            UnreadableError: One cannot be read.
        """
        self._files: list[BinaryIO] = []
        self._at = 0
        try:
            self._files += [path.open("rb") for path in paths]
            sizes = [os.fstat(file.fileno()).st_size for file in self._files]
        except FileNotFoundError as error:
            raise FileMissingError(str(error.filename), "expected a piece, found none") from None
        except OSError as error:
            raise UnreadableError.of(str(error.filename), error) from None
        self._ends = list(itertools.accumulate(sizes))

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a byte."""
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._ends[-1]}[whence]
        if start + offset < 0:
            raise OSError("before the beginning")
        self._at = start + offset
        return self._at

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Read from one file; the next call goes on with the next."""
        number = bisect.bisect_right(self._ends, self._at)
        if number == len(self._files):
            return 0
        begin = self._ends[number - 1] if number else 0
        file = self._files[number]
        file.seek(self._at - begin)
        content = file.read(min(len(buffer), self._ends[number] - self._at))
        buffer[: len(content)] = content
        self._at += len(content)
        return len(content)

    def close(self) -> None:
        """Close all files."""
        for file in self._files:
            file.close()
        super().close()
