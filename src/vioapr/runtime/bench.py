"""Measure an exported localizer: durations by part, memory and energy."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MissingExtraError
from vioapr.runtime.machine import cpu_model, resident_bytes
from vioapr.runtime.session import open_session, require_localizer, start_session
from vioapr.schemas.bench import BenchResult, Percentiles
from vioapr.schemas.contract import Contract

PARTS = ("preprocess", "network", "fusion")
"""The parts of a localizer: prefixes of its nodes' names."""

_NETWORK_INPUT = "network_input"
_RAPL = Path("/sys/class/powercap/intel-rapl:0")
_WARM_UP = 5

Feed = dict[str, NDArray[Any]]
Run = Callable[[], Any]


def bench(
    path: Path,
    *,
    size: tuple[int, int] = (480, 640),
    repeats: int = 100,
    threads: int | None = None,
    tick: Callable[[], object] | None = None,
) -> BenchResult:
    """Measure a whole localizer.

    Args:
        path: A file that `vioapr export` wrote.
        size: Height and width of the images, pixels.
        repeats: How often every part is run.
        threads: For every operator; None for all cores.
        tick: Called after every repeat.

    Raises:
        FileError: The file cannot be read, or is none; see `open_session`.
        ContractError: The file is not a whole localizer.
    """
    before_bytes = resident_bytes()
    session, contract = open_session(path, threads)
    require_localizer(contract, path)
    feed = example_feed(contract, size)
    runs: dict[str, Run] = {"whole": partial(session.run, None, feed)}
    runs["whole"]()
    after_bytes, note = resident_bytes(), None
    try:
        runs |= part_runs(path, contract, feed, threads)
    except MissingExtraError as error:
        note = f"parts are not measured: {error}"
    seconds = time_in_turns(runs, repeats, tick)
    cores = os.cpu_count() or 1
    return BenchResult(
        file=path.name,
        file_mb=path.stat().st_size / 1e6,
        method=contract.method,
        precision=contract.precision,
        regressor=contract.regressor,
        image_px=size,
        threads=threads or cores,
        machine=f"{cpu_model()}, {cores} cores, {platform.system()}",
        memory_mb=None if after_bytes is None else (after_bytes - (before_bytes or 0)) / 1e6,
        ms={name: summarize_ms(values) for name, values in seconds.items()},
        energy_j=measure_energy(runs["whole"], repeats),
        note=note,
    )


def example_feed(contract: Contract, size: tuple[int, int]) -> Feed:
    """Make inputs of a frame with image and tracking, before which nothing is known."""
    pixels = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    feed: Feed = {
        spec.name: np.zeros([1 if isinstance(n, str) else n for n in spec.shape], np.float32)
        for spec in contract.inputs
    }
    feed["image"] = pixels
    for name in ("vio_from_cam", "image_vio_from_cam"):
        if name in feed:  # the second since version 2
            feed[name][6] = 1
    for name in ("has_image", "tracking_ok"):
        feed[name][0] = 1
    if contract.params:
        feed["params"][:] = [*contract.fill_params({}).values()]
    return feed


def part_runs(path: Path, contract: Contract, feed: Feed, threads: int | None) -> dict[str, Run]:
    """Make a function for every part that runs it alone, on the inputs that it has in the whole.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    known, runs = dict(feed), {}
    for name, content in split_parts(path, contract).items():
        session = start_session(content, threads)
        own = {value.name: known[value.name] for value in session.get_inputs()}
        outputs = [value.name for value in session.get_outputs()]
        known |= dict(zip(outputs, session.run(outputs, own), strict=True))
        runs[name] = partial(session.run, None, own)
    return runs


def split_parts(path: Path, contract: Contract) -> dict[str, bytes]:
    """Split a whole localizer into models of its parts, by the nodes' names.

    Raises:
        MissingExtraError: onnx is not installed; no other function here needs it.
    """
    try:
        import onnx
    except ImportError:
        raise MissingExtraError("measuring the parts", "onnx", "export") from None
    whole = onnx.load(str(path))
    crop = contract.image.crop
    border = onnx.helper.make_tensor_value_info(
        _NETWORK_INPUT, onnx.TensorProto.FLOAT, [1, 3, crop, crop]
    )
    borders = {value.name: value for value in (*whole.graph.input, *whole.graph.output, border)}
    parts = {}
    for name in PARTS:
        nodes = [node for node in whole.graph.node if node.name.startswith(f"{name}/")]
        taken = {name for node in nodes for name in node.input}
        made = {name for node in nodes for name in node.output}
        graph = onnx.helper.make_graph(
            nodes,
            name,
            inputs=[value for key, value in borders.items() if key in taken - made],
            outputs=[value for key, value in borders.items() if key in made],
            initializer=[tensor for tensor in whole.graph.initializer if tensor.name in taken],
        )
        model = onnx.helper.make_model(
            graph, ir_version=whole.ir_version, opset_imports=whole.opset_import
        )
        parts[name] = model.SerializeToString()
    return parts


def time_in_turns(
    runs: Mapping[str, Run], repeats: int, tick: Callable[[], object] | None = None
) -> dict[str, list[float]]:
    """Time functions in turns, so that a slow spell of the machine hits all alike.

    Args:
        runs: By name.
        repeats: How often each is timed, after a few untimed rounds.
        tick: Called after every repeat.

    Returns:
        Seconds of every repeat, by name.
    """
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for repeat in range(-_WARM_UP, repeats):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            if repeat >= 0:
                seconds[name].append(time.perf_counter() - start)
        if repeat >= 0 and tick is not None:
            tick()
    return seconds


def summarize_ms(seconds: Sequence[float]) -> Percentiles:
    """Percentiles of durations, from s to ms."""
    return Percentiles(*(1e3 * np.percentile(seconds, [50, 95, 99])).tolist())


def measure_energy(run: Run, repeats: int) -> float | None:
    """Measure the energy of the processor's package a run, J, by Intel's RAPL counter.

    None where the machine does not expose it.
    """
    try:
        largest = int((_RAPL / "max_energy_range_uj").read_text())
        start = int((_RAPL / "energy_uj").read_text())
    except (OSError, ValueError):
        return None
    for _ in range(repeats):
        run()
    spent = int((_RAPL / "energy_uj").read_text()) - start
    return (spent % (largest + 1)) / 1e6 / repeats
