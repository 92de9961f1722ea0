"""Steps that are done once: each leaves a marker, so that a killed run resumes where it was.

A marker says which inputs a step had. It is written beside its place and moved there, so it is
either whole or not there. A step whose inputs, or whose predecessors' inputs, have changed runs
again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vioapr.errors import UnwritableError
from vioapr.files.atomic import write_atomically

_VERSION = 1
"""Part of every key: raise it when a step's results mean something else than before."""


class Steps:
    """The steps of one run, in order.

    Attributes:
        folder: Where markers and intermediate files are.
        reused: Names of the steps that were found done.
        seconds: How long every step took, when it ran; also of reused ones.
    """

    def __init__(self, folder: Path) -> None:
        """Begin, or resume, in a folder; it is made if needed.

        Raises:
            FormatError: It cannot be made.
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

    def run(self, name: str, inputs: Any, work: Callable[[bool], Any]) -> Any:
        """Do a step, unless it has been done with the same inputs.

        Args:
            name: The step's name.
            inputs: All that its result depends on beside earlier steps, as plain data.
            work: Does it. Its argument says whether it was begun with these very inputs and
                interrupted, so that what it left may be used. It returns plain data.

        Returns:
            What `work` returned, now or then.
        """
        content = json.dumps([_VERSION, self._chain, name, inputs], sort_keys=True)
        self._chain = hashlib.sha256(content.encode()).hexdigest()
        marker = self._read(name)
        is_same = marker.get("key") == self._chain
        is_done = bool(marker.get("is_done"))
        # Done anew, an earlier step may have come out otherwise: what followed it is void.
        if is_same and is_done and not self._has_run:
            self.reused.append(name)
            self.seconds[name] = marker["seconds"]
            return marker["result"]
        self._has_run = True
        is_resumed = is_same and not is_done
        before = marker.get("seconds", 0.0) if is_resumed else 0.0
        self._write(name, {"key": self._chain, "is_done": False, "seconds": before})
        start = time.perf_counter()
        result = json.loads(json.dumps(work(is_resumed)))
        self.seconds[name] = before + time.perf_counter() - start
        done = {"key": self._chain, "is_done": True, "seconds": self.seconds[name]}
        self._write(name, {**done, "result": result})
        return result

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.step.json"

    def _read(self, name: str) -> dict[str, Any]:
        try:
            content = json.loads(self._path(name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}

    def _write(self, name: str, content: dict[str, Any]) -> None:
        write_atomically(self._path(name), (json.dumps(content) + "\n").encode())
