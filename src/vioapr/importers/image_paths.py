"""Images by paths that were written on another machine, in another folder, or without ending."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

from vioapr.files.images import IMAGE_SUFFIXES

_MAX_FILES = 500_000


class ImagePaths:
    """Finds the images that a file names by paths.

    Attributes:
        folder: That of the file.
        moved: Paths as written that were found elsewhere, with where.
        ambiguous: Paths as written of which several images could be.
    """

    def __init__(self, folder: Path) -> None:
        """Begin with nothing found."""
        self.folder = folder
        self.moved: dict[str, Path] = {}
        self.ambiguous: list[str] = []

    def find(self, written: str) -> Path:
        """An image by its path in the file.

        It is looked for where the file says, with and without an ending, and then by the longest
        end of its path that only one image below the folder has.

        Returns:
            Where it is; or, if it is nowhere, where it should be.
        """
        path = self.folder / written.strip().replace("\\", "/")
        if path.is_file():  # even of a kind that is not read, which is said then
            return path
        if (found := with_ending(path)) is not None:
            return found
        parts = tuple(part for part in path.parts if part not in ("/", ".", ".."))
        for count in range(len(parts), 0, -1):
            matches = self._by_end.get(_end(parts[-count:]), [])
            if len(matches) == 1:
                self.moved[written] = matches[0]
                return matches[0]
            if matches:
                self.ambiguous.append(written)
                break
        has_ending = path.suffix.lower() in IMAGE_SUFFIXES
        # As instant-ngp takes it.
        return path if has_ending else path.with_name(path.name + ".png")

    @cached_property
    def _by_end(self) -> dict[tuple[str, ...], list[Path]]:
        """Images below the folder by every end of their paths, in lower case, without ending."""
        found: dict[tuple[str, ...], list[Path]] = {}
        count = 0
        for root, folders, names in os.walk(self.folder):
            folders[:] = sorted(name for name in folders if name[0] != ".")
            for name in names:
                if not name.lower().endswith(IMAGE_SUFFIXES) or name[0] == ".":
                    continue
                count += 1
                if count > _MAX_FILES:
                    return found
                path = Path(root) / name
                parts = path.relative_to(self.folder).parts
                for first in range(len(parts)):
                    found.setdefault(_end(parts[first:]), []).append(path)
        return found


def with_ending(path: Path) -> Path | None:
    """A path that is there: as it is, with an ending added, or with another one."""
    if path.suffix.lower() in IMAGE_SUFFIXES and path.is_file():
        return path
    endings = [*IMAGE_SUFFIXES, *(ending.upper() for ending in IMAGE_SUFFIXES)]
    is_image = path.suffix.lower() in IMAGE_SUFFIXES
    stem = path.name[: -len(path.suffix)] if is_image else path.name
    for ending in endings:
        if stem and (found := path.with_name(stem + ending)).is_file():
            return found
    return None


def _end(parts: tuple[str, ...]) -> tuple[str, ...]:
    *folders, name = (part.lower() for part in parts)
    for ending in IMAGE_SUFFIXES:
        name = name.removesuffix(ending)
    return (*folders, name)
