"""Errors that users can cause, and mend.

Every one says what was expected, what was found, where, and what to do. The command line prints
the message as one line and exits with code 2; a traceback means a bug of ours. Which class it is
says what went wrong, so that a server can choose a status code:

    VioAprError
    ├── FileError             something is wrong with a file or folder
    │   ├── FileMissingError      it is not there
    │   ├── AlreadyExistsError    it is there, and must not be replaced
    │   ├── UnreadableError       the system does not let it be read
    │   ├── UnwritableError       the system does not let it be written
    │   │   └── DiskFullError         for want of space
    │   ├── LockedError           another process is using it
    │   ├── FormatError           its content is malformed
    │   └── VersionError          it is of a version that this program does not know
    ├── ParameterError        a value that a parameter cannot have
    ├── AssociationError      trajectories that cannot be paired
    ├── SuspectTrackError     poses that look wrong, where warnings are errors
    ├── ContractError         not what an exported file's contract says
    ├── MappingError          a place that cannot be mapped
    ├── TrainingError         a network that cannot be trained
    └── MissingExtraError     an optional package is not installed
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from os import PathLike


class VioAprError(Exception):
    """The root of all errors that vioapr raises on purpose.

    Errors can be pickled, so they pass between processes as they are.
    """

    def __reduce__(self) -> tuple[Callable[..., VioAprError], tuple[object, ...]]:
        """Pickle message and attributes; the constructors take others than the message."""
        return _restore, (type(self), self.args, self.__dict__)


def _restore(
    kind: type[VioAprError], args: tuple[object, ...], attributes: dict[str, object]
) -> VioAprError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


class FileError(VioAprError):
    """Something is wrong with a file or folder.

    Attributes:
        path: The file or folder.
        problem: What was expected and what was found.
        line: 1-based line (or row) number, or None where the problem has none.
    """

    def __init__(self, path: str | PathLike[str], problem: str, line: int | None = None) -> None:
        """Compose `path:line: problem`; see the attributes."""
        self.path, self.problem, self.line = str(path), problem, line
        place = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{place}: {problem}")


class FileMissingError(FileError):
    """A file or folder is not there."""


class AlreadyExistsError(FileError):
    """A file or folder is there already, and must not be replaced."""


class UnreadableError(FileError):
    """The system does not let a file be read."""

    @staticmethod
    def of(path: str | PathLike[str], error: OSError) -> FileError:
        """The error of ours for one of the system's that reading caused."""
        if isinstance(error, FileNotFoundError):
            return FileMissingError(path, "expected a file, found none of this name")
        return UnreadableError(path, f"cannot be read: {error.strerror or error}")


class UnwritableError(FileError):
    """The system does not let a file or folder be written."""

    @staticmethod
    def of(path: str | PathLike[str], error: OSError) -> UnwritableError:
        """The error of ours for one of the system's that writing caused."""
        kind = DiskFullError if error.errno in (errno.ENOSPC, errno.EDQUOT) else UnwritableError
        return kind(path, f"cannot be written: {error.strerror or error}")


class DiskFullError(UnwritableError):
    """There is no space left for a file."""


class LockedError(FileError):
    """Another process is using a folder."""


class FormatError(FileError):
    """A file's content is not what its format promises."""


class VersionError(FileError):
    """A file is of a version that this program does not know."""


class ParameterError(VioAprError):
    """A parameter has a value that it cannot have.

    Messages begin with the name (`seed: expected ...`), or with `Class.name` where several
    classes have it, or have it in backticks: the command line puts its flags there.
    """


class AssociationError(VioAprError):
    """Two trajectories cannot be paired: no common times or names."""


class SuspectTrackError(VioAprError):
    """Poses look wrong, and warnings are to be errors."""


class ContractError(VioAprError):
    """A file, or what is fed to it, is not what its contract says."""


class MappingError(VioAprError):
    """A place cannot be mapped from these recordings."""


class TrainingError(VioAprError):
    """A network cannot be trained, or its training went wrong."""


class MissingExtraError(VioAprError):
    """A feature needs an optional package that is not installed."""

    def __init__(self, feature: str, package: str, extra: str) -> None:
        """Say which extra brings the package that the feature needs."""
        super().__init__(
            f"{feature} needs the package {package}, which is not installed: "
            f"pip install 'vioapr[{extra}]'"
        )
