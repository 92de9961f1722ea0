"""From one trajectory file to another of any format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vioapr.errors import FormatError, ParameterError
from vioapr.files.text import is_folder
from vioapr.formats.base import Format, ReadOptions
from vioapr.formats.registry import format_of_name, get_format, recognize
from vioapr.trajectory import Trajectory


@dataclass(frozen=True)
class Conversion:
    """What was done.

    Attributes:
        source_format: Name of the format read.
        target_format: Name of the format written.
        poses: Number of poses.
        lost: What the target format cannot hold, in words.
    """

    source_format: str
    target_format: str
    poses: int
    lost: tuple[str, ...]


def convert_file(
    source: Path,
    target: Path,
    source_format: str | None = None,
    target_format: str | None = None,
    options: ReadOptions | None = None,
    *,
    overwrite: bool = False,
) -> Conversion:
    """Read a file and write it in another format.

    Args:
        source: The file or folder to read.
        target: The one to write; never the source.
        source_format: Name of the source's format; by default the likeliest.
        target_format: Name of the target's format; by default the one its name means.
        options: Rate and sequence.
        overwrite: Write over an existing file.

    Raises:
        FormatError: The source cannot be read, or the target cannot be written.
        ParameterError: No such format, none that the target's name means, the target exists,
            or its format needs what the trajectory does not have.
    """
    reader = get_format(source_format) if source_format else recognize(source)
    by_name = "target_format"  # the parameter to mention where the name means no format
    writer = get_format(target_format) if target_format else format_of_name(target, by_name)
    _check_target(source, target, overwrite=overwrite)
    trajectory = reader.read(source, options or ReadOptions())
    writer.write(target, trajectory)
    return Conversion(reader.name, writer.name, len(trajectory), _losses(trajectory, writer))


def _check_target(source: Path, target: Path, *, overwrite: bool) -> None:
    try:
        is_source = target.exists() and source.exists() and target.samefile(source)
        exists = any(target.iterdir()) if is_folder(target) else target.exists()
    except OSError as error:
        raise FormatError(target, f"cannot be looked at: {error.strerror}") from None
    if is_source:
        raise ParameterError(f"{target} is the input: write to another file")
    if exists and not overwrite:
        raise ParameterError(f"{target} exists: choose another name, or give `overwrite`")


def _losses(trajectory: Trajectory, writer: Format) -> tuple[str, ...]:
    lost = []
    if trajectory.is_timed and not writer.has_times:
        lost.append("timestamps")
    if trajectory.names is not None and not _keeps_names(trajectory.names, writer):
        lost.append("image names")
    return tuple(lost)


def _keeps_names(names: tuple[str, ...], writer: Format) -> bool:
    if writer.name == "7scenes":
        return all(name.endswith(".color.png") for name in names)
    return writer.has_names
