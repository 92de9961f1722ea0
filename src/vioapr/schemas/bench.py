"""The figures of `vioapr bench`: how long an exported localizer takes on a machine."""

from __future__ import annotations

from vioapr.schemas.base import Record
from vioapr.schemas.contract import Regressor


class Percentiles(Record, frozen=True):
    """Percentiles of durations, ms.

    Attributes:
        p50: The median.
        p95: The 95th percentile.
        p99: The 99th percentile.
    """

    p50: float
    p95: float
    p99: float


class BenchResult(Record, frozen=True, kw_only=True):
    """Durations, memory, size and energy of an exported localizer.

    Attributes:
        file: Its name.
        file_mb: Its size, MB.
        method: Of fusion.
        precision: Of the regressor's weights.
        regressor: The network.
        image_px: Height and width of the images, pixels.
        threads: For every operator.
        machine: Processor, cores and system.
        memory_mb: Memory that the localizer takes, MB; None where the system does not say.
        ms: By part (`whole`, `preprocess`, `network`, `fusion`).
        energy_j: Energy of the processor's package a frame, J; None where it is not exposed.
        note: Why figures are missing, or None.
    """

    file: str
    file_mb: float
    method: str | None
    precision: str
    regressor: Regressor
    image_px: tuple[int, int]
    threads: int
    machine: str
    memory_mb: float | None
    ms: dict[str, Percentiles]
    energy_j: float | None
    note: str | None = None
