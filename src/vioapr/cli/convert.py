"""`vioapr convert`: from one trajectory format to another."""

from __future__ import annotations

from typing import Annotated

import tyro

from vioapr.cli.console import say, say_notes, warn
from vioapr.cli.streams import InputFile, OutputFile
from vioapr.formats.base import ReadOptions, TimeUnit
from vioapr.formats.conversion import convert_file
from vioapr.formats.corrections import Corrections
from vioapr.plurals import count_of

_NAMED = 5
"""Of files that were kept."""


def convert(
    source: Annotated[tyro.conf.Positional[InputFile], tyro.conf.arg(metavar="IN")],
    target: Annotated[tyro.conf.Positional[OutputFile], tyro.conf.arg(metavar="OUT")],
    source_format: Annotated[str | None, tyro.conf.arg(name="from", metavar="FORMAT")] = None,
    target_format: Annotated[str | None, tyro.conf.arg(name="to", metavar="FORMAT")] = None,
    rate_hz: float | None = None,
    sequence: str | None = None,
    time_unit: TimeUnit | None = None,
    reading: str | None = None,
    scale: float = 1.0,
    shift_s: float = 0.0,
    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Convert a trajectory file to another format, and say what was lost.

    Args:
        source: File, or folder of a format that is one; gzip is read as it is; - is standard input.
        target: File or folder to write; gzipped where its name ends in .gz; - is
            standard output, and needs --to.
        source_format: Format of IN; by default the one it looks like.
        target_format: Format of OUT; by default the one its name means.
        rate_hz: Frames per second of image names' numbers, for formats without timestamps.
        sequence: Folder part of the image names to keep, or the device (kapture), chunk
            (Metashape) or track (Spectacular AI), where IN holds several.
        time_unit: Unit of IN's times; by default found from their values.
        reading: What IN really holds, where its poses are in another convention than its format
            has: opengl, inverted, inverted-rotations, wxyz or xyzw (the order in which
            quaternions were written and read as the other), left-handed-x (or -y, -z), mirror-x
            (or -y, -z; positions alone), positions-y-up, positions-z-up, or one of the first
            five with -opengl. `vioapr inspect IN --against` another track says which fits.
        scale: Factor of all positions: 0.01 for centimetres.
        shift_s: To add to all timestamps, s.
        strict: Refuse a file with rows that give no pose, or with anything that looks wrong, rather
            than warn.
        overwrite: Write over an existing OUT. Of a folder, what vioapr wrote is replaced, and
            other files stay; poses among them that would be read with the new ones are refused.

    Example:
        vioapr convert vio.csv vio.tum
        vioapr convert poses.txt out.txt --from colmap --to kitti

    Raises:
        VioAprError: IN cannot be read or OUT cannot be written.
    """
    options = ReadOptions(rate_hz, sequence, time_unit, strict)
    done = convert_file(
        source,
        target,
        source_format,
        target_format,
        options,
        corrections=Corrections(reading, scale, shift_s),
        overwrite=overwrite,
    )
    say_notes(source, done.notes)
    for warning in done.warnings:
        warn(f"{target}: {warning}")
    if done.kept:
        names = ", ".join(path.name for path in done.kept[:_NAMED])
        more = f" and {len(done.kept) - _NAMED} more" if len(done.kept) > _NAMED else ""
        say(f"{target}: kept {names}{more}, which vioapr did not write")
    lost = f"; lost: {' and '.join(done.lost)}" if done.lost else ""
    say(
        f"{source} ({done.source_format}) -> {target} ({done.target_format}): "
        f"{count_of(done.poses, 'pose')}{lost}"
    )
