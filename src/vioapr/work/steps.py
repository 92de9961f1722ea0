"""Work that is done once: a marker beside a result says from which inputs it was made.

Two forms, by how much there is to keep:

* A result that is a file of its own, such as a cache, has a marker file with a fingerprint of
  its inputs: `is_current(marker, fingerprint(...))` before the work, `mark` after it.
* A chain of steps, each of which needs the results of those before it, is run by `Steps`, which
  keeps what every step returned. A killed run resumes at the step where it was.

A marker is written in one step, so it is either whole or not there. One that cannot be read, or
is of another version, counts as none: then the work is done again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import msgspec

from vioapr.errors import FileError, UnwritableError
from vioapr.files.atomic import write_atomically
from vioapr.schemas.base import Record, decode, to_plain

T = TypeVar("T")

_VERSION = 1
"""Part of every step's key: raise it when steps' results mean something else than before."""


class Marker(Record, frozen=True):
    """What a marker file says.

    Attributes:
        key: Fingerprint of the inputs.
        is_done: False while the work is under way, and if it was interrupted.
        seconds: How long the work took, over all its interrupted runs.
        result: What a step returned, as plain values.
    """

    key: str
    is_done: bool = True
    seconds: float = 0.0
    result: object = None


def fingerprint(*inputs: object) -> str:
    """The SHA-256, in hexadecimal, of plain values, records and NumPy arrays of moderate size.

    Equal for equal values, in every process and on every machine.
    """
    content = json.dumps(to_plain(list(inputs)), sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def is_current(marker: Path, key: str) -> bool:
    """Whether a marker says that the work is done, from the inputs of this fingerprint."""
    found = read_marker(marker)
    return found is not None and found.is_done and found.key == key


def mark(marker: Path, key: str) -> None:
    """Note that the work is done; only after its result has reached the disk.

    Raises:
        UnwritableError: It cannot be written.
    """
    write_marker(marker, Marker(key=key))


def read_marker(path: Path) -> Marker | None:
    """The marker, or None if there is none that can be read."""
    try:
        return decode(path, path.read_text(encoding="utf-8"), Marker)
    except (OSError, ValueError, FileError):
        return None


def write_marker(path: Path, marker: Marker) -> None:
    """Write a marker in one step.

    Raises:
        UnwritableError: It cannot be written; what was there stays.
    """
    write_atomically(path, (json.dumps(msgspec.to_builtins(marker)) + "\n").encode())


def describe_changes(
    noted: Mapping[str, object], given: Mapping[str, object], defaults: Mapping[str, object] = {}
) -> str:
    """Say which inputs of a resumed work differ from those that it was begun with.

    Args:
        noted: Those that it was begun with, by name, plain values.
        given: Those of now; names that are only noted do not count.
        defaults: Of names that are newer than the note: the work was done with these.

    Returns:
        E.g. "epochs 30 then, 40 now; seed 1 then, 2 now"; "" if nothing differs.
    """
    then = {**defaults, **noted}
    return "; ".join(
        f"{name.replace('_', ' ')} {then.get(name)} then, {now} now"
        for name, now in given.items()
        if then.get(name) != now
    )


class Steps:
    """The steps of one run, in order.

    A step runs again if its inputs have changed, or if any step before it has run: that one may
    have come out otherwise.

    Attributes:
        folder: Where markers and intermediate files are.
        reused: Names of the steps that were found done.
        seconds: How long every step took, when it ran; also of reused ones.
    """

    def __init__(self, folder: Path) -> None:
        """Begin, or resume, in a folder; it is made if needed.

        Raises:
            UnwritableError: It cannot be made.
        """
        self.folder = folder
        self.reused: list[str] = []
        self.seconds: dict[str, float] = {}
        self._chain = ""
        self._has_run = False
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UnwritableError.of(folder, error) from None

    def run(self, name: str, inputs: object, work: Callable[[bool], T], result_type: type[T]) -> T:
        """Do a step, unless it has been done with the same inputs.

        Args:
            name: The step's name; its marker is `<name>.step.json`.
            inputs: All that its result depends on beside earlier steps: plain values or records.
            work: Does it. Its argument says whether it was begun with these very inputs and
                interrupted, so that what it left may be used.
            result_type: Of what `work` returns: a record, or plain values such as `list[str]`.
                Larger results are files in `folder`.

        Returns:
            What `work` returned, now or then; as it is read from the marker in both cases.

        Raises:
            UnwritableError: The marker cannot be written.
        """
        self._chain = fingerprint(_VERSION, self._chain, name, inputs)
        path = self.folder / f"{name}.step.json"
        marker = read_marker(path)
        if marker is not None and marker.key != self._chain:
            marker = None
        if marker is not None and marker.is_done and not self._has_run:
            try:
                result = msgspec.convert(marker.result, result_type)
            except msgspec.ValidationError:
                marker = None
            else:
                self.reused.append(name)
                self.seconds[name] = marker.seconds
                return result
        self._has_run = True
        is_resumed = marker is not None and not marker.is_done
        before_s = marker.seconds if marker is not None and is_resumed else 0.0
        write_marker(path, Marker(key=self._chain, is_done=False, seconds=before_s))
        start_s = time.perf_counter()
        plain = json.loads(json.dumps(to_plain(work(is_resumed))))  # as read from the marker
        result = msgspec.convert(plain, result_type)
        self.seconds[name] = before_s + time.perf_counter() - start_s
        write_marker(path, Marker(key=self._chain, seconds=self.seconds[name], result=plain))
        return result
