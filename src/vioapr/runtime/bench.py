"""How long an exported localizer takes, part by part, and what it needs."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vioapr.errors import MissingExtraError
from vioapr.runtime.localizer import open_session, session_options
from vioapr.runtime.machine import cpu_model, resident_bytes
from vioapr.schemas.contract import Contract, ContractError

PARTS = ("preprocess", "network", "fusion")
_NETWORK_INPUT = "network_input"
_RAPL = Path("/sys/class/powercap/intel-rapl:0")
_WARM_UP = 5

Feed = dict[str, NDArray[Any]]


def bench(
    path: Path,
    *,
    size: tuple[int, int] = (480, 640),
    repeats: int = 100,
    threads: int | None = None,
    tick: Callable[[], object] | None = None,
) -> dict[str, Any]:
    """Measure a whole localizer.

    Args:
        path: What `vioapr export` wrote.
        size: Height and width of the images, pixels.
        repeats: How often every part is run; they take turns, so that a slow spell hits all.
        threads: For every operator; None for all cores.
        tick: Called after every repeat.

    Returns:
        Times in ms, memory and file size in MB, energy in J a frame; see the keys.

    Raises:
        ContractError: The file is not a whole localizer.
    """
    before_mb = _resident_mb()
    session, contract = open_session(path, threads)
    if contract.part != "localizer":
        raise ContractError(f"{path}: expected a whole localizer, found part {contract.part!r}")
    feed = example_feed(contract, size)
    runs: dict[str, Callable[[], Any]] = {"whole": lambda: session.run(None, feed)}
    runs["whole"]()
    whole_mb = _resident_mb()
    note = None
    try:
        runs |= part_runs(path, contract, feed, threads)
    except MissingExtraError as error:
        note = f"parts are not measured: {error}"
    seconds = _time_in_turns(runs, repeats, tick)
    return {
        "file": path.name,
        "file_mb": path.stat().st_size / 1e6,
        "method": contract.method,
        "precision": contract.precision,
        "regressor": contract.regressor,
        "image_px": list(size),
        "threads": threads or os.cpu_count(),
        "machine": _machine(),
        "memory_mb": None if whole_mb is None else whole_mb - (before_mb or 0.0),
        "ms": {name: summarize_ms(values) for name, values in seconds.items()},
        "energy_j": _energy(runs["whole"], repeats),
        "note": note,
    }


def example_feed(contract: Contract, size: tuple[int, int]) -> Feed:
    """A frame with image and tracking, from no knowledge."""
    pixels = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    feed: Feed = {
        spec.name: np.zeros([1 if isinstance(n, str) else n for n in spec.shape], np.float32)
        for spec in contract.inputs
    }
    feed["image"] = pixels
    feed["vio_from_cam"][6] = 1
    for name in ("has_image", "tracking_ok"):
        feed[name][0] = 1
    if contract.params:
        feed["params"][:] = [spec.default for spec in contract.params]
    return feed


def part_runs(
    path: Path, contract: Contract, feed: Feed, threads: int | None
) -> dict[str, Callable[[], Any]]:
    """What runs every part alone, on the inputs that it has in the whole.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    import onnxruntime

    options = session_options(threads)
    known, runs = dict(feed), {}
    for name, content in split_parts(path, contract).items():
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        own = {value.name: known[value.name] for value in session.get_inputs()}
        outputs = [value.name for value in session.get_outputs()]
        known |= dict(zip(outputs, session.run(outputs, own), strict=True))
        runs[name] = lambda session=session, own=own: session.run(None, own)
    return runs


def split_parts(path: Path, contract: Contract) -> dict[str, bytes]:
    """The three parts of a whole localizer as models of their own, by the nodes' names.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    try:
        import onnx
    except ImportError:
        raise MissingExtraError("measuring the parts", "onnx", "export") from None
    whole = onnx.load(str(path))
    kinds = {value.name: value for value in (*whole.graph.input, *whole.graph.output)}
    crop = contract.image["crop"]
    kinds[_NETWORK_INPUT] = onnx.helper.make_tensor_value_info(
        _NETWORK_INPUT, onnx.TensorProto.FLOAT, [1, 3, crop, crop]
    )
    return {part: _extract(whole, part, kinds) for part in PARTS}


def _extract(whole: Any, part: str, kinds: dict[str, Any]) -> bytes:
    import onnx

    model = onnx.ModelProto()
    model.ir_version = whole.ir_version
    model.opset_import.extend(whole.opset_import)
    model.graph.name = part
    nodes = [node for node in whole.graph.node if node.name.startswith(f"{part}/")]
    taken = {name for node in nodes for name in node.input}
    made = {name for node in nodes for name in node.output}
    model.graph.node.extend(nodes)
    model.graph.initializer.extend(t for t in whole.graph.initializer if t.name in taken)
    model.graph.input.extend(v for k, v in kinds.items() if k in taken - made)
    model.graph.output.extend(v for k, v in kinds.items() if k in made)
    return model.SerializeToString()


def _time_in_turns(
    runs: dict[str, Callable[[], Any]], repeats: int, tick: Callable[[], object] | None
) -> dict[str, list[float]]:
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


def summarize_ms(seconds: list[float]) -> dict[str, float]:
    """Percentiles in ms."""
    p50, p95, p99 = (1e3 * np.percentile(seconds, [50, 95, 99])).tolist()
    return {"p50": p50, "p95": p95, "p99": p99}


def _resident_mb() -> float | None:
    size = resident_bytes()
    return None if size is None else size / 1e6


def _machine() -> str:
    return f"{cpu_model()}, {os.cpu_count()} cores, {platform.system()}"


def _energy(run: Callable[[], Any], repeats: int) -> float | None:
    """Energy of the processor's package a frame, J; None where the machine does not expose it."""
    try:
        largest = int((_RAPL / "max_energy_range_uj").read_text())
        start = int((_RAPL / "energy_uj").read_text())
    except (OSError, ValueError):
        return None
    for _ in range(repeats):
        run()
    spent = int((_RAPL / "energy_uj").read_text()) - start
    return (spent % (largest + 1)) / 1e6 / repeats
