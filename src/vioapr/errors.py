"""Errors that users can cause, and mend.

Every one says what was expected, what was found, where, and what to do. The command line
prints the message as one line and exits with code 2; a traceback means a bug of ours.
"""

from __future__ import annotations

from os import PathLike


class VioAprError(Exception):
    """Root of all errors that vioapr raises on purpose."""


class FormatError(VioAprError):
    """A file's content is not what its format promises."""

    def __init__(self, path: str | PathLike[str], problem: str, line: int | None = None) -> None:
        """Compose `path:line: problem`.

        Args:
            path: The file.
            problem: What was expected and what was found.
            line: 1-based line (or row) number, if the problem has one.
        """
        self.path, self.problem, self.line = str(path), problem, line
        place = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{place}: {problem}")


class ParameterError(VioAprError):
    """A parameter has a value that it cannot have."""


class AssociationError(VioAprError):
    """Two trajectories cannot be paired: no common times or names."""


class MappingError(VioAprError):
    """A place cannot be mapped from these recordings."""


class MissingExtraError(VioAprError):
    """A feature needs an optional package that is not installed."""

    def __init__(self, feature: str, package: str, extra: str) -> None:
        """Say which extra brings the package that the feature needs."""
        super().__init__(
            f"{feature} needs the package {package}, which is not installed: "
            f"pip install 'vioapr[{extra}]'"
        )


class TrainingError(VioAprError):
    """A network cannot be trained, or its training went wrong."""
